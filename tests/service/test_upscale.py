"""Colours scaled up along surfaces."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from service.upscale import LEFT_OVER, SAME_SURFACE, surface_colors, upscaled
from torchrender.options import RenderOptions
from torchrender.renderer import render
from torchrender.scene.load import load


def test_colours_stay_on_their_surface() -> None:
    """An outline between rendered pixels: each side keeps its colour up to the outline."""
    depth = torch.full((24, 40), 8.0)
    depth[:, 17:] = 2.0
    rendered = torch.full((6, 10), 8.0)
    rendered[:, 4:] = 2.0
    coarse = torch.where(rendered[..., None] < 5, torch.tensor([0.9, 0.1, 0.0]), torch.tensor([0.0, 0.2, 0.7]))
    blocks = coarse.repeat_interleave(4, 0).repeat_interleave(4, 1)
    wanted = torch.where(depth[..., None] < 5, torch.tensor([0.9, 0.1, 0.0]), torch.tensor([0.0, 0.2, 0.7]))
    assert float((upscaled(blocks, depth, rendered) - wanted).abs().max()) < 1e-3
    assert float((blocks - wanted).abs().max()) > 0.5


def test_one_surface_and_sky_are_filtered_linearly() -> None:
    ramp = torch.arange(8.0).expand(4, 8)
    blocks = ramp.repeat_interleave(2, 0).repeat_interleave(2, 1)[..., None].expand(8, 16, 3)
    places = ((torch.arange(16) + 0.5) / 2 - 0.5).clamp(0, 7)
    for z in (3.0, torch.inf):
        made = upscaled(blocks, torch.full((8, 16), z), torch.full((4, 8), z))
        assert float((made[..., 0] - places).abs().max()) < 1e-5


def test_a_surface_that_was_not_rendered_gets_colours_from_around() -> None:
    depth = torch.full((8, 8), 5.0)
    depth[3, 3] = 1.0
    made = upscaled(torch.full((8, 8, 3), 0.25), depth, torch.full((2, 2), 5.0))
    assert float((made - 0.25).abs().max()) < 1e-5


def slowly(colors: Tensor, depth: Tensor, rendered: Tensor) -> Tensor:
    (height, width), (rows, columns) = depth.shape, rendered.shape
    out = torch.zeros(height, width, 3)
    for j in range(height):
        for i in range(width):
            y, x = (j + 0.5) * rows / height - 0.5, (i + 0.5) * columns / width - 0.5
            total, weights = torch.zeros(3), 0.0
            for row in (math.floor(y), math.floor(y) + 1):
                for column in (math.floor(x), math.floor(x) + 1):
                    place = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
                    own, other = 1 / float(depth[j, i]), 1 / float(rendered[place])
                    share = abs(own - other) / max(own, other, 1e-30)
                    weight = math.exp(-((share / SAME_SURFACE) ** 2)) + LEFT_OVER
                    weight *= (1 - abs(row - y)) * (1 - abs(column - x))
                    total, weights = total + weight * colors[place], weights + weight
            out[j, i] = total / weights
    return out


def test_the_kernel_has_a_slow_twin() -> None:
    random = torch.Generator().manual_seed(2)
    colors = torch.rand(5, 7, 3, generator=random)
    rendered = 1.0 + 0.2 * torch.rand(5, 7, generator=random)
    rendered[1, 2] = torch.inf
    depth = 1.0 + 0.2 * torch.rand(15, 21, generator=random)
    depth[4:7, 6:9] = torch.inf
    blocks = colors.repeat_interleave(3, 0).repeat_interleave(3, 1)
    assert float((upscaled(blocks, depth, rendered) - slowly(colors, depth, rendered)).abs().max()) < 1e-5


def test_pictures_with_few_pixels_come_nearer_to_whole_ones() -> None:
    scene = load("cornell_box")
    whole = render(scene, width=128, height=128)
    few = render(scene, width=128, height=128, options=RenderOptions(supersample=0.25, upscaling="nearest"))
    truth = whole.radiance[0].clamp(max=1.0)
    error = [float(((p.clamp(max=1.0) - truth) ** 2).mean()) for p in (few.radiance[0], surface_colors(few))]
    assert error[1] < 0.9 * error[0]
    assert torch.equal(surface_colors(whole), whole.radiance[0])
