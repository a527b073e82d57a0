"""Colours scaled up along surfaces."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from service.upscale import LEFT_OVER, OTHER_SURFACE, SAME_SURFACE, surface_colors, upscaled
from torchrender.options import RenderOptions
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene


def pixels(depth: Tensor, surface: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """One surface everywhere unless another is given."""
    return depth, torch.zeros(depth.shape, dtype=torch.int32) if surface is None else surface.int()


def test_colours_stay_on_their_surface() -> None:
    """An outline between rendered pixels: each side keeps its colour up to the outline."""
    left, right = torch.tensor([0.9, 0.1, 0.0]), torch.tensor([0.0, 0.2, 0.7])
    side, rough_side = (torch.arange(40) >= 17).expand(24, 40), (torch.arange(10) >= 4).expand(6, 10)
    blocks = torch.where(rough_side[..., None], right, left).repeat_interleave(4, 0).repeat_interleave(4, 1)
    wanted = torch.where(side[..., None], right, left)
    assert float((blocks - wanted).abs().max()) > 0.5

    def error(few: tuple[Tensor, Tensor], many: tuple[Tensor, Tensor]) -> float:
        return float((upscaled(blocks, few, many) - wanted).abs().max())

    def depth(right_side: Tensor) -> Tensor:
        return torch.where(right_side, 2.0, 8.0)

    assert error(pixels(depth(rough_side)), pixels(depth(side))) < 1e-3
    flat, rough_flat = torch.full((24, 40), 3.0), torch.full((6, 10), 3.0)
    assert error(pixels(rough_flat, rough_side), pixels(flat, side)) < 2e-2
    assert error(pixels(rough_flat), pixels(flat)) > 0.5


def test_thin_surfaces_find_their_colour_further_away() -> None:
    """A post between the four rendered pixels around its pixels is met by one a row further on."""
    depth, surface = torch.full((16, 16), 3.0), torch.zeros(16, 16)
    surface[:, 7] = 1
    rough = torch.zeros(4, 4)
    rough[0, 1] = 1
    blocks = rough.repeat_interleave(4, 0).repeat_interleave(4, 1)[..., None].expand(16, 16, 3)
    made = upscaled(blocks, pixels(torch.full((4, 4), 3.0), rough), pixels(depth, surface))
    assert float(made[:8, 7].min()) > 0.9
    assert float(made[:, :7].max()) < 0.01


def test_one_surface_and_sky_are_filtered_linearly() -> None:
    ramp = torch.arange(8.0).expand(4, 8)
    blocks = ramp.repeat_interleave(2, 0).repeat_interleave(2, 1)[..., None].expand(8, 16, 3)
    places = ((torch.arange(16) + 0.5) / 2 - 0.5).clamp(0, 7)
    for z in (3.0, torch.inf):
        made = upscaled(blocks, pixels(torch.full((4, 8), z)), pixels(torch.full((8, 16), z)))
        assert float((made[..., 0] - places).abs().max()) < 1e-5


def test_a_surface_that_was_not_rendered_gets_colours_from_around() -> None:
    depth = torch.full((8, 8), 5.0)
    depth[3, 3] = 1.0
    surface = (depth < 2.0).int()
    made = upscaled(torch.full((8, 8, 3), 0.25), pixels(torch.full((2, 2), 5.0)), pixels(depth, surface))
    assert float((made - 0.25).abs().max()) < 1e-5


def slowly(colors: Tensor, few: tuple[Tensor, Tensor], many: tuple[Tensor, Tensor]) -> Tensor:
    """The kernel as loops over tensors."""
    (rows, columns), (height, width) = few[0].shape, many[0].shape
    out = torch.zeros(height, width, 3, dtype=torch.float64)
    for j in range(height):
        for i in range(width):
            y, x = (j + 0.5) * rows / height - 0.5, (i + 0.5) * columns / width - 0.5
            for reach in (1, 2):
                total, weights, likeness = torch.zeros(3, dtype=torch.float64), 0.0, 0.0
                for row in range(math.floor(y) + 1 - reach, math.floor(y) + 1 + reach):
                    for column in range(math.floor(x) + 1 - reach, math.floor(x) + 1 + reach):
                        r, c = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
                        own, other = 1 / float(many[0][j, i]), 1 / float(few[0][r, c])
                        apart = abs(own - other) / max(own, other, 1e-30)
                        like = math.exp(-((apart / SAME_SURFACE) ** 2))
                        like *= 1.0 if few[1][r, c] == many[1][j, i] else OTHER_SURFACE
                        weight = (reach - abs(y - row)) * (reach - abs(x - column))
                        likeness += weight * like
                        total += weight * (like + LEFT_OVER) * colors[r, c]
                        weights += weight * (like + LEFT_OVER)
                if likeness > OTHER_SURFACE * reach**4:
                    break
            out[j, i] = total / weights
    return out


def test_the_kernel_has_a_slow_twin() -> None:
    random = torch.Generator().manual_seed(2)
    colors = torch.rand(5, 7, 3, generator=random)
    rendered = 1.0 + 0.2 * torch.rand(5, 7, generator=random)
    rendered[1, 2] = torch.inf
    depth = 1.0 + 0.2 * torch.rand(15, 21, generator=random)
    depth[4:7, 6:9] = torch.inf
    few = pixels(rendered, torch.randint(3, (5, 7), generator=random))
    many = pixels(depth, torch.randint(4, (15, 21), generator=random))
    blocks = colors.repeat_interleave(3, 0).repeat_interleave(3, 1)
    assert float((upscaled(blocks, few, many) - slowly(colors, few, many)).abs().max()) < 1e-5


def test_pictures_with_few_pixels_come_nearer_to_whole_ones() -> None:
    scene = load("cornell_box")
    whole = render(scene, width=128, height=128)
    few = render(scene, width=128, height=128, options=RenderOptions(supersample=0.25, upscaling="nearest"))
    truth = whole.radiance[0].clamp(max=1.0)
    error = [float(((p.clamp(max=1.0) - truth) ** 2).mean()) for p in (few.radiance[0], surface_colors(few))]
    assert error[1] < 0.5 * error[0]
    assert torch.equal(surface_colors(whole), whole.radiance[0])


def test_a_picture_without_triangles_is_its_background() -> None:
    camera = Cameras.look_at((0, 0, 3), (0, 0, 0), width=16, height=8)
    empty = render(Scene(), camera, options=RenderOptions(supersample=0.5))
    torch.testing.assert_close(surface_colors(empty), empty.radiance[0], atol=0.01, rtol=0.0)
