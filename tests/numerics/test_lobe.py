"""Laws of mirrored directions, Schlick's share and glossy lobes, in both precisions."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from torchrender.numerics.lobe import WIDEST_LOBE_DEG, frame, lobe_directions, reflect, schlick

PRECISION = {torch.float32: 2e-6, torch.float64: 1e-12}
seeds = st.integers(0, 2**31)
types = st.sampled_from(list(PRECISION))


def units(count: int, seed: int, dtype: torch.dtype) -> Tensor:
    vectors = torch.randn(count, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.nn.functional.normalize(vectors, dim=-1).to(dtype)


@settings(deadline=None, max_examples=40)
@given(seed=seeds, dtype=types)
def test_reflection_keeps_length_and_angle_and_undoes_itself(seed: int, dtype: torch.dtype) -> None:
    direction, normal = units(64, seed, dtype), units(64, seed + 1, dtype)
    mirrored = reflect(direction, normal)
    tolerance = PRECISION[dtype]
    assert mirrored.dtype == dtype
    torch.testing.assert_close(mirrored.norm(dim=-1), torch.ones(64, dtype=dtype), rtol=0, atol=tolerance)
    torch.testing.assert_close((mirrored * normal).sum(-1), -(direction * normal).sum(-1), rtol=0, atol=tolerance)
    torch.testing.assert_close(reflect(mirrored, normal), direction, rtol=0, atol=2 * tolerance)


@settings(deadline=None, max_examples=60)
@given(degree=st.floats(0, 1), low=st.floats(-0.5, 1.5), high=st.floats(-0.5, 1.5), dtype=types)
def test_schlick_stays_between_its_degree_and_one(degree: float, low: float, high: float, dtype: torch.dtype) -> None:
    cosine = torch.tensor(sorted((low, high)), dtype=dtype)
    share = schlick(torch.tensor([degree, degree], dtype=dtype), cosine)
    if degree == 0 or float(torch.tensor(degree, dtype=dtype)) == 0:
        assert share.tolist() == [0.0, 0.0]
        return
    eps = PRECISION[dtype]
    assert degree - eps <= float(share[1]) <= float(share[0]) + eps <= 1.0 + 2 * eps  # more at grazing angles
    assert float(schlick(torch.tensor(degree, dtype=dtype), torch.tensor(0.0, dtype=dtype))) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("degree", "cosine", "share"),
    [(0.04, 0.5, 0.07), (0.5, 0.5, 0.515625), (0.2, 0.2, 0.462144), (0.04, 0.9, 0.0400096), (1.0, 0.5, 1.0)],
)
def test_schlick_at_known_angles(degree: float, cosine: float, share: float) -> None:
    """``F0 + (1 - F0)(1 - cos)^5``, worked out by hand."""
    found = schlick(torch.tensor([degree], dtype=torch.float64), torch.tensor([cosine], dtype=torch.float64))
    assert float(found) == pytest.approx(share, rel=1e-9)


@settings(deadline=None, max_examples=40)
@given(seed=seeds, dtype=types)
def test_frames_are_orthonormal(seed: int, dtype: torch.dtype) -> None:
    axis = units(64, seed, dtype)
    corner_cases = torch.tensor([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0], [1e-7, 0, -1]], dtype=dtype)
    axis = torch.cat([axis, torch.nn.functional.normalize(corner_cases, dim=-1)])
    first, second = frame(axis)
    matrix = torch.stack([first, second, axis], dim=1)
    identity = torch.eye(3, dtype=dtype).expand_as(matrix)
    torch.testing.assert_close(matrix @ matrix.transpose(1, 2), identity, rtol=0, atol=5 * PRECISION[dtype])


@settings(deadline=None, max_examples=40)
@given(seed=seeds, gloss=st.floats(0, 1), rays=st.integers(1, 64), dtype=types)
def test_lobes_lie_in_their_cone_and_above_the_surface(seed: int, gloss: float, rays: int, dtype: torch.dtype) -> None:
    axis, normal = units(16, seed, dtype), units(16, seed + 1, dtype)
    normal = normal * torch.where((axis * normal).sum(-1, keepdim=True) < 0, -1.0, 1.0).to(dtype)
    turn = torch.rand(16, generator=torch.Generator().manual_seed(seed), dtype=torch.float64).to(dtype)
    found = lobe_directions(axis, normal, torch.full((16,), gloss, dtype=dtype), rays, turn)
    eps = 20 * PRECISION[dtype]
    torch.testing.assert_close(found.norm(dim=-1), torch.ones(16, rays, dtype=dtype), rtol=0, atol=eps)
    assert float((found * normal[:, None]).sum(-1).min()) >= -eps
    inside = (found * axis[:, None]).sum(-1)
    # A ray that is mirrored out of the surface may leave the cone, but not by more than the cone's own width.
    assert float(inside.min()) >= math.cos(math.radians(2 * WIDEST_LOBE_DEG * gloss)) - eps


@settings(deadline=None, max_examples=20)
@given(seed=seeds, gloss=st.floats(0.01, 1))
def test_every_ray_stands_for_the_same_share_of_the_cone(seed: int, gloss: float) -> None:
    """The mean over the rays is the mean over the cap: its centre of mass lies at (1 + cos) / 2 on the axis."""
    axis = units(4, seed, torch.float64)
    turn = torch.zeros(4, dtype=torch.float64)
    found = lobe_directions(axis, axis, torch.full((4,), gloss, dtype=torch.float64), 4096, turn)
    centre = found.mean(dim=1)
    expected = axis * (1 + math.cos(math.radians(WIDEST_LOBE_DEG * gloss))) / 2
    torch.testing.assert_close(centre, expected, rtol=0, atol=1e-3)
