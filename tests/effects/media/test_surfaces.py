"""Light from everywhere on its way through media to surfaces: closed forms and brute force."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from torchrender.effects.media.surfaces import surroundings_left
from torchrender.errors import InputError
from torchrender.scene.medium import Medium

WIDE = {"low": [-1e4, -1, -1e4], "high": [1e4, 2, 1e4]}


def places(*points: tuple[float, float, float]) -> tuple[Tensor, Tensor, Tensor]:
    """Places on a floor, as an image of one row."""
    position = torch.tensor([[points]], dtype=torch.float64).reshape(1, 1, -1, 3)
    normal = torch.tensor([0.0, 1.0, 0.0]).expand(position.shape)
    return position, normal, torch.ones(position.shape[:3], dtype=torch.bool)


def below_slab(depth: float) -> float:
    """2 E3(depth): the share of even light that a slab of that optical depth lets pass."""
    cosine = (torch.arange(100000, dtype=torch.float64) + 0.5) / 100000
    return float((2.0 * cosine * torch.exp(-depth / cosine)).mean())


@pytest.mark.parametrize("depth", (0.02, 0.1, 0.5, 1.0, 3.0))
def test_below_a_slab(depth: float) -> None:
    """In colours, each for itself, and above it all."""
    color = torch.tensor([1.0, 0.5, 0.0])
    medium = Medium(absorption=color * depth / 2.0, scattering=0.0, **WIDE)
    found = surroundings_left((medium,), *places((0.0, 0.0, 0.0), (0.0, 2.1, 0.0)))
    assert found is not None and found.shape == (1, 1, 2, 3)
    wanted = torch.tensor([below_slab(depth), below_slab(depth / 2), 1.0])
    assert torch.allclose(found[0, 0, 0], wanted, atol=6e-3), (found, wanted)
    assert torch.equal(found[0, 0, 1], torch.ones(3))


def test_media_in_one_place_add_up_and_scattering_gives_back_its_share() -> None:
    spot = places((0.0, 0.0, 0.0))
    two = (Medium(absorption=0.1, scattering=0.0, **WIDE), Medium(absorption=0.0, scattering=0.3, **WIDE))
    one = (Medium(absorption=0.1, scattering=0.3, **WIDE),)
    found, wanted = surroundings_left(two, *spot), surroundings_left(one, *spot)
    assert found is not None and wanted is not None and torch.allclose(found, wanted, atol=1e-6)
    passed = surroundings_left(one, *spot, scattered=False)
    assert passed is not None and torch.allclose(wanted, passed + (1.0 - passed) * 0.75, atol=1e-6)


def test_a_ball_of_density_beside_many_directions() -> None:
    """A grid, on a floor that it stands beside: against 40,000 directions, each in small steps."""
    edge = torch.linspace(-1.0, 1.0, 16)
    radius = (edge[:, None, None] ** 2 + edge[:, None] ** 2 + edge**2).sqrt()
    ball = Medium(
        low=[-1, 0, -1], high=[1, 2, 1], absorption=1.0, scattering=0.0, density=(1.5 - 1.5 * radius).clamp_min(0.0)
    )
    spot = places((0.6, 0.0, 0.3))
    found = surroundings_left((ball,), *spot)
    number = torch.arange(40000, dtype=torch.float64)
    up = ((number + 0.5) / 40000).sqrt()
    across, angle = (1.0 - up**2).sqrt(), number * (math.pi * (3.0 - math.sqrt(5.0)))
    direction = torch.stack([across * angle.cos(), up, across * angle.sin()], dim=-1)
    step = (torch.arange(400, dtype=torch.float64) + 0.5) * 0.01
    at = (spot[0].reshape(1, 1, 3) + direction[:, None] * step[:, None] - torch.tensor([0.0, 1.0, 0.0])).float()
    looked_up = torch.nn.functional.grid_sample(
        ball.density[None, None], at[None, None], align_corners=False, padding_mode="border"
    )[0, 0, 0]
    inside = (at.abs() <= 1.0).all(dim=-1)
    wanted = float(torch.exp(-(looked_up * inside).sum(dim=-1) * 0.01).mean())
    assert found is not None and wanted < 0.9
    assert abs(float(found) - wanted) < 0.02, (found, wanted)


def test_nothing_is_left_out_where_nothing_is_lost() -> None:
    spot = places((0.0, 0.0, 0.0))
    assert surroundings_left((), *spot) is None
    assert surroundings_left((Medium(absorption=0.0, scattering=0.5, **WIDE),), *spot) is None
    below = Medium(absorption=1.0, scattering=0.0, low=[-1, -2, -1], high=[1, -1, 1])
    assert surroundings_left((below,), *spot) is None
    assert surroundings_left((below,), spot[0], spot[1], ~spot[2]) is None
    with pytest.raises(InputError, match="position"):
        surroundings_left((below,), spot[0][0], spot[1], spot[2])
