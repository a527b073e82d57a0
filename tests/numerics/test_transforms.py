"""Laws of camera matrices: rigid, looking where they should, and true at any place and size."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import CameraError
from torchrender.numerics.transforms import look_at_matrix, pinhole_matrix
from torchrender.scene.camera import Cameras

exponents = st.floats(-8, 8)
seeds = st.integers(0, 2**31)


def vectors(seed: int, count: int = 3) -> torch.Tensor:
    return torch.randn(count, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@settings(deadline=None, max_examples=80)
@given(seed=seeds, place=exponents, reach=exponents, height=exponents)
def test_look_at_is_a_rigid_motion_that_looks_at_its_target(
    seed: int, place: float, reach: float, height: float
) -> None:
    eye, toward, up = vectors(seed)
    eye, toward, up = eye * 10**place, toward * 10**reach, up * 10**height
    target = eye + toward
    if not (target - eye).norm() > 0:
        return
    matrix = look_at_matrix(eye, target, up)
    rotation = matrix[:3, :3]
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3, dtype=torch.float64), rtol=0, atol=1e-12)
    assert float(torch.linalg.det(rotation)) == pytest.approx(1.0, abs=1e-12)
    moved = rotation @ target + matrix[:3, 3]
    size = float(eye.norm() + target.norm())
    assert float(moved[:2].abs().max()) <= 1e-14 * size and float(moved[2]) > -1e-14 * size
    assert float((rotation @ eye + matrix[:3, 3]).norm()) <= 1e-14 * size
    assert matrix[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    # "up" is on the side of the image's upper edge, since y points down.
    assert float(rotation[1] @ up) <= 1e-9 * float(up.norm())


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("up", [[0.0, 1.0, 0.0], [0.0, 1e-12, 0.0], [0.0, 0.0, 0.0]])
def test_looking_along_up_or_without_one(sign: float, up: list[float]) -> None:
    eye, target = torch.zeros(3), torch.tensor([0.0, 5.0 * sign, 0.0])
    rotation = look_at_matrix(eye, target, torch.tensor(up))[:3, :3]
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3, dtype=torch.float64))
    assert rotation[2].tolist() == [0.0, sign, 0.0]


def test_no_direction_is_refused() -> None:
    with pytest.raises(CameraError, match="differ"):
        look_at_matrix(torch.ones(3), torch.ones(3), torch.tensor([0.0, 1.0, 0.0]))


@settings(deadline=None, max_examples=60)
@given(seed=seeds, place=st.floats(-6, 6), depth=st.floats(-3, 6), fov=st.floats(0.01, 179))
def test_unprojecting_undoes_projecting(seed: int, place: float, depth: float, fov: float) -> None:
    eye = vectors(seed, 1)[0] * 10**place
    camera = Cameras.look_at(eye, eye + vectors(seed + 1, 1)[0] * 10**place, width=37, height=23, fov_deg=fov)
    pixels = torch.rand(1, 20, 2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    pixels = pixels * torch.tensor([37.0, 23.0], dtype=torch.float64)
    depths = torch.full((1, 20), 10.0**depth, dtype=torch.float64)
    found, z = camera.project(camera.unproject(pixels, depths))
    # World coordinates are rounded at the size of the eye's distance from the origin.
    rounding = 1e-14 * (1 + 10**place / 10**depth)
    assert float((z / depths - 1).abs().max()) <= 100 * rounding
    focal = float(camera.intrinsics[0, 0, 0])
    assert float((found - pixels).abs().max()) <= 100 * rounding * (focal + 37 * math.tan(math.radians(fov) / 2) + 37)


def test_pinhole_matrix() -> None:
    point = torch.tensor([0.5, -0.25, 1.0], dtype=torch.float64)
    assert (pinhole_matrix(10.0, 20.0, 3.0, 4.0) @ point).tolist() == [8.0, -1.0, 1.0]
