"""Wide rays bring the mean of the sky that they spread over."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
import torch

from torchrender.pipeline.sky_pyramid import SkyPyramid
from torchrender.scene.environment import Environment, latlong_directions


def sky(height: int = 64) -> Environment:
    generator = torch.Generator().manual_seed(3)
    return Environment(radiance=torch.rand(height, 2 * height, 3, generator=generator), intensity=2.0)


def test_narrow_rays_see_the_picture_itself() -> None:
    environment = sky()
    directions = latlong_directions(20, 40).reshape(-1, 3)
    found = SkyPyramid.of(environment).lookup(directions, torch.full((len(directions),), 1e-3))
    assert torch.equal(found, environment.lookup(directions))


def test_every_picture_sends_as_much_light_in_all() -> None:
    levels = SkyPyramid.of(sky()).levels
    assert len(levels) == 5
    totals = []
    for level in levels:
        height = level.radiance.shape[0]
        polar = (torch.arange(height) + 0.5) * math.pi / height
        rows = level.radiance.mean(dim=(1, 2))
        totals.append(float((rows * torch.sin(polar)).sum() / torch.sin(polar).sum()))
    # The means of rows are exact; the sum of a coarse picture's sines is not that of a fine one.
    assert totals == pytest.approx([totals[0]] * 5, rel=0.02)


def test_wider_rays_vary_less_and_widths_between_lie_between() -> None:
    pyramid = SkyPyramid.of(sky())
    directions = latlong_directions(40, 80).reshape(-1, 3)
    spreads = [float(pyramid.lookup(directions, torch.full((3200,), w)).std()) for w in (0.01, 0.08, 0.11, 0.3, 10.0)]
    assert all(a > b for a, b in pairwise(spreads))


def test_a_sky_of_one_colour_and_odd_sizes() -> None:
    for environment in (Environment.constant(torch.ones(3)), Environment(radiance=torch.ones(7, 9, 3))):
        pyramid = SkyPyramid.of(environment)
        assert len(pyramid.levels) == 1
        assert torch.allclose(pyramid.lookup(latlong_directions(3, 5).reshape(-1, 3), torch.ones(15)), torch.ones(1))
