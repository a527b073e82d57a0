"""Few pixels of a picture for many."""

from __future__ import annotations

import pytest
import torch

from torchrender.effects.upsampling.joint import joint_upsampled
from torchrender.raster import rasterize_visibility
from torchrender.scene.load import load
from torchrender_service.renderers.streaming.lattice import middles, part_of, spacing_of, widen, widened


@pytest.mark.parametrize(("side", "spacing"), [(48, 1), (48, 3), (50, 7), (64, 5), (432, 7), (3, 5), (1, 9)])
def test_every_run_of_pixels_has_one_that_stands_for_it(side: int, spacing: int) -> None:
    found = middles(side, spacing)
    assert len(found) == -(-side // spacing), "no more for the end, where runs do not fit"
    assert found.tolist() == [min(k * spacing + spacing // 2, side - 1) for k in range(len(found))]


def test_a_lattice_has_about_as_many_pixels_as_there_is_room_for() -> None:
    for count, room in ((1000, 1000), (40_000, 1024), (332_000, 4096), (5, 0)):
        spacing = spacing_of(count, room)
        assert spacing % 2 == 1 and count / spacing**2 <= max(room, 1)
        assert spacing <= 2 or count / (spacing - 2) ** 2 > max(room, 1)


def test_pixels_at_the_end_of_a_picture_are_filled_from_where_the_lattice_stands() -> None:
    """A ramp stays one, up to the border, where sides are no multiples of the spacing."""
    scene = load("cornell_box")
    seen = rasterize_visibility(scene.geometry, scene.camera(width=64, height=48))
    wall = torch.zeros_like(seen.triangle)  # one surface everywhere
    seen = type(seen)(seen.cameras, torch.ones_like(seen.depth), wall, wall, seen.barycentric)
    spacing = 7
    rows, columns = (middles(side, spacing) for side in (48, 64))
    ramp = (torch.arange(64) + 2.0 * torch.arange(48)[:, None])[..., None].expand(48, 64, 3)
    size = spacing * len(rows), spacing * len(columns)
    wanted = widen(torch.ones(1, 48, 64, dtype=torch.bool), size, False)
    few, colors = part_of(seen, rows[:, None], columns), ramp[rows[:, None], columns][None].contiguous()
    filled = joint_upsampled(colors, few, widened(seen, size), scene.geometry.material, wanted)[0]
    inner = slice(3, 46), slice(3, 60)  # beyond the outermost ones the nearest is taken
    assert float((filled[inner] - ramp[inner]).abs().max()) < 1e-3
    assert float((filled[:48, :64] - ramp).abs().max()) <= 3.0 * spacing
    assert not bool(filled[48:].any()) and not bool(filled[:, 64:].any()), "nobody asks for what lies beyond"
