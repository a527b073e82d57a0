"""Images of keyframes drawn together."""

from __future__ import annotations

from typing import Any, cast

import torch

from torchrender.client.drawing import NEARER, draw_keyframes
from torchrender.scene.camera import Cameras
from torchrender.wire.containers import KeyframeImage

CAMERA = Cameras.look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), width=24, height=16)
CORNER = (slice(0, 5), slice(0, 5))
MIDDLE = (slice(6, 10), slice(10, 16))


def image(depth: torch.Tensor, grey: int) -> KeyframeImage:
    known = torch.isfinite(depth)
    codes = torch.full((*depth.shape, 3), grey, dtype=torch.uint8)
    return KeyframeImage(header=cast("Any", None), camera=CAMERA, depth=depth, codes=codes, known=known)


def wall(z: float) -> torch.Tensor:
    return torch.full((16, 24), z)


def drawn(*images: KeyframeImage):
    codes = torch.stack([one.codes for one in images]).float()
    return draw_keyframes(images, CAMERA, colors=codes)


def test_a_first_image_without_holes_is_all_that_is_shown() -> None:
    other = wall(2.0)
    made = drawn(image(wall(4.0), 10), image(other, 200))
    assert bool((made.source == 0).all())
    assert float(made.color.min()) == float(made.color.max()) == 10.0


def test_others_fill_holes_and_stand_in_front() -> None:
    first, other = wall(4.0), torch.full((16, 24), torch.inf)
    first[CORNER] = torch.inf
    other[CORNER], other[MIDDLE] = 5.0, 2.0
    made = drawn(image(first, 10), image(other, 200))
    assert bool(made.valid.all())
    for place in (CORNER, MIDDLE):
        assert bool((made.source[0][place] == 1).all())
        assert bool((made.color[0][place] == 200.0).all())
    assert int((made.source == 1).sum()) == 25 + 24
    assert float(made.depth[0][MIDDLE].mean()) == 2.0


def test_samples_of_one_surface_come_from_the_first_image() -> None:
    first, other = wall(4.0), wall(4.0 * (1.0 - 0.5 * NEARER))
    first[CORNER] = torch.inf
    made = drawn(image(first, 10), image(other, 200))
    assert int((made.source == 1).sum()) == 25
