"""Lambert's polygon formula against a sum over the polygon, closed forms and degenerate receivers."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from torchrender.errors import InputError
from torchrender.numerics.polygon_light import polygon_irradiance

SQUARE = torch.tensor([[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [1.0, 2.0, 1.0], [-1.0, 2.0, 1.0]])


def slow_irradiance(corners: Tensor, position: Tensor, normal: Tensor, per_side: int = 256) -> float:
    """Sum of cos cos / (pi r^2) over small cells of a parallelogram, times pi: no formula for the angle in it."""
    corners, position, normal = corners.double(), position.double(), normal.double()
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    t = (torch.arange(per_side, dtype=torch.float64) + 0.5) / per_side
    points = corners[0] + t[:, None, None] * u + t[None, :, None] * v
    facing = torch.linalg.cross(u, v)
    offset = points - position
    square = offset.square().sum(-1)
    direction = offset / square.sqrt()[..., None]
    cosines = (direction @ normal).clamp_min(0) * (direction @ torch.nn.functional.normalize(facing, dim=0)).abs()
    return float((cosines / square).sum() * facing.norm() / per_side**2)


def receive(corners: Tensor, position: Tensor, normal: Tensor) -> float:
    return float(polygon_irradiance(corners, position[:, None], normal[:, None])[0])


def test_disc_like_polygon_matches_the_disc_closed_form() -> None:
    angle = torch.arange(720) * (2 * math.pi / 720)
    radius, height = 1.5, 0.8
    disc = torch.stack([radius * torch.cos(angle), torch.full_like(angle, height), radius * torch.sin(angle)], dim=1)
    value = receive(disc, torch.zeros(3), torch.tensor([0.0, 1.0, 0.0]))
    assert value == pytest.approx(math.pi * radius**2 / (radius**2 + height**2), rel=1e-4)


def test_half_space_of_light_gives_pi_times_its_share() -> None:
    huge = SQUARE * torch.tensor([1e4, 0.5, 1e4])
    up = torch.tensor([0.0, 1.0, 0.0])
    assert receive(huge, torch.zeros(3), up) == pytest.approx(math.pi, rel=1e-3)
    # Tilted by 60 degrees a wall of light over the whole upper half space fills (1 + cos)/2 of the cosine lobe.
    tilted = torch.tensor([math.sin(math.pi / 3), 0.5, 0.0])
    assert receive(huge, torch.zeros(3), tilted) == pytest.approx(math.pi * 0.75, rel=1e-3)


vector = st.tuples(*[st.floats(-1, 1, width=32)] * 3).map(torch.tensor).filter(lambda v: float(v.norm()) > 0.1)


@given(vector, vector, vector, vector)
@settings(max_examples=40, deadline=None)
def test_agrees_with_a_sum_over_the_light(corner: Tensor, u: Tensor, v: Tensor, normal: Tensor) -> None:
    corners = torch.stack([corner, corner + u, corner + u + v, corner + v]) + torch.tensor([0.0, 3.5, 0.0])
    normal = normal / normal.norm()
    expected = slow_irradiance(corners, torch.zeros(3), normal)
    assert receive(corners, torch.zeros(3), normal) == pytest.approx(expected, rel=2e-3, abs=2e-5)


@pytest.mark.parametrize("tilt_deg", [0, 20, 60, 85, 95, 120, 150, 179])
def test_the_part_below_the_horizon_is_cut_off(tilt_deg: float) -> None:
    tilt = math.radians(tilt_deg)
    normal = torch.tensor([math.sin(tilt), math.cos(tilt), 0.0])
    expected = slow_irradiance(SQUARE, torch.zeros(3), normal, 1024)
    assert receive(SQUARE, torch.zeros(3), normal) == pytest.approx(expected, rel=1e-3, abs=1e-5)


def test_winding_does_not_matter_and_two_halves_make_the_whole() -> None:
    position, normal = (
        torch.tensor([0.4, 0.3, -0.2]),
        torch.nn.functional.normalize(torch.tensor([0.8, 0.5, 0.1]), dim=0),
    )
    whole = receive(SQUARE, position, normal)
    assert receive(SQUARE.flip(0), position, normal) == pytest.approx(whole, rel=1e-5)
    left, right = SQUARE.clone(), SQUARE.clone()
    left[1:3, 0] = 0.25
    right[(0, 3), 0] = 0.25
    assert receive(left, position, normal) + receive(right, position, normal) == pytest.approx(whole, rel=1e-5)


@pytest.mark.parametrize("distance", [1e2, 1e4])
def test_far_small_light_acts_like_a_point(distance: float) -> None:
    far = SQUARE + torch.tensor([0.0, distance, 0.0])
    value = receive(far, torch.zeros(3), torch.tensor([0.0, 1.0, 0.0]))
    assert value == pytest.approx(4.0 / (distance + 2.0) ** 2, rel=2e-3)


def test_receivers_on_the_light_stay_finite() -> None:
    points = torch.cat([SQUARE, (SQUARE + SQUARE.roll(1, 0)) / 2, SQUARE.mean(0, keepdim=True)])
    for normal in ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 0.0]):
        value = polygon_irradiance(SQUARE, points.T, torch.tensor(normal)[:, None].expand(3, len(points)))
        assert torch.isfinite(value).all()
        assert bool((value <= math.pi + 1e-4).all())


def test_line_and_point_give_nothing() -> None:
    line = torch.tensor([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    for light in (line, line[:1].repeat(4, 1)):
        assert receive(light, torch.zeros(3), torch.tensor([0.0, 1.0, 0.0])) == pytest.approx(0.0, abs=1e-6)


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(InputError, match="positions"):
        polygon_irradiance(SQUARE, torch.zeros(5, 3), torch.zeros(3, 5))


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**31),
    size=st.floats(-6, 6),
    reach=st.floats(-6, 6),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_irradiance_lies_between_nothing_and_a_whole_sky(
    seed: int, size: float, reach: float, dtype: torch.dtype
) -> None:
    """A light of radiance one can give pi at most, whatever its size and distance, in either precision."""
    generator = torch.Generator().manual_seed(seed)
    corner, u, v = torch.randn(3, 3, generator=generator, dtype=torch.float64) * 10**size
    corners = torch.stack([corner, corner + u, corner + u + v, corner + v]).to(dtype)
    places = (torch.randn(3, 24, generator=generator, dtype=torch.float64) * 10**reach).to(dtype)
    places[:, :4] = corners.T  # on the light itself
    normals = torch.nn.functional.normalize(torch.randn(3, 24, generator=generator, dtype=torch.float64), dim=0)
    found = polygon_irradiance(corners, places, normals.to(dtype))
    assert found.dtype == dtype
    assert bool(((found >= 0) & (found <= math.pi * (1 + 1e-5))).all())
    twice = polygon_irradiance(2 * corners, 2 * places, normals.to(dtype))
    # Only angles count; beside a corner of a tiny light squares of float32 lengths underflow.
    close = {torch.float32: (1e-3, 1e-4), torch.float64: (1e-5, 1e-6)}[dtype]
    torch.testing.assert_close(twice, found, rtol=close[0], atol=close[1])
