"""Some pixels of a view, apart from the others: they are what they are in the whole picture."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
import torch

from torchrender.buffers import GBuffer
from torchrender.pipeline.history import RenderHistory
from torchrender.raster import rasterize, rasterize_visibility
from torchrender.renderer import render, shade_samples
from torchrender.scene.load import load
from torchrender_service.renderers.streaming.samples import (
    BUSY,
    FEW_BUSY,
    MOST_BUSY,
    PACKED_WIDTH,
    busiest,
    shade_pixels,
)
from torchrender_service.renderers.streaming.stream_renderer import STREAMED

SIZE = (112, 84)


@pytest.mark.parametrize("name", ["cornell_box", "washroom"])
def test_chosen_pixels_are_shaded_as_in_the_whole_picture(name: str) -> None:
    scene = load(name)
    camera = scene.camera(width=SIZE[0], height=SIZE[1])
    past = render(scene, camera, options=STREAMED, history=RenderHistory()).history
    assert past is not None
    whole = rasterize(scene, camera)
    wanted = torch.rand(1, SIZE[1], SIZE[0], generator=torch.Generator().manual_seed(4)) < 0.2
    chosen = (wanted & whole.covered)[0]
    made = shade_pixels(scene, rasterize_visibility(scene.geometry, camera), wanted, STREAMED, past)
    own = shade_samples(scene, packed(whole, chosen), options=STREAMED, history=past).reshape(-1, 3)
    count = int(chosen.sum())
    assert made.radiance.shape == (count, 3) and count > 3 * PACKED_WIDTH
    assert float((made.radiance - own[:count]).abs().max()) < 1e-5


def packed(whole: GBuffer, chosen: torch.Tensor) -> GBuffer:
    """The chosen pixels of a whole G-buffer in rows, pixel by pixel."""
    places = chosen.nonzero().tolist()
    height = -(-len(places) // PACKED_WIDTH)
    camera = whole.cameras.sub_camera(0, 0, PACKED_WIDTH, height)
    made = {}
    for name in (f.name for f in fields(GBuffer) if f.name != "cameras"):
        image = getattr(whole, name)
        if image is not None:
            empty = {"triangle": -1, "object_id": -1, "material": -1, "depth": torch.inf}.get(name, 0)
            made[name] = torch.full((1, height, PACKED_WIDTH, *image.shape[3:]), empty, dtype=image.dtype)
            for number, (row, column) in enumerate(places):
                made[name][0, number // PACKED_WIDTH, number % PACKED_WIDTH] = image[0, row, column]
    return GBuffer(cameras=camera, **made)


def test_of_a_busy_picture_the_busiest_part_is_busy() -> None:
    random = np.random.default_rng(2)
    codes = random.integers(0, 256, (400, 500, 3), np.uint8)
    assert 0 < int(busiest(codes).sum()) <= max(FEW_BUSY, MOST_BUSY * codes[..., 0].size)
    calm = np.full((320, 400, 3), 90, np.uint8)
    calm[160:, 200:] += BUSY + 1
    assert int(busiest(calm).sum()) == 2 * 160 + 2 * 200
