"""The split-sum factors beside the reflection integral over directions of light, and their limits."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from torchrender.errors import InputError
from torchrender.numerics.ggx import refraction
from torchrender.numerics.split_sum import (
    TABLE_SIZE,
    dielectric_albedo,
    directional_albedo,
    integrate_split_sum,
    integrated_table,
    split_sum_table,
)

unit = st.floats(0.0, 1.0)


def mirrored(cosine: float, roughness: float, fresnel: Callable[[Tensor], Tensor]) -> float:
    """Light out of a white surrounding, as an integral of the reflection function over directions of light."""
    angles, heights = 720, 800
    azimuth = (torch.arange(angles, dtype=torch.float64) + 0.5) * math.pi / angles
    polar = (torch.arange(heights, dtype=torch.float64) + 0.5) * math.pi / 2 / heights
    z, x, y = (
        polar.cos()[:, None],
        polar.sin()[:, None] * azimuth.cos(),
        polar.sin()[:, None] * azimuth.sin(),
    )
    vx, vz = math.sqrt(1 - cosine * cosine), cosine
    hx, hy, hz = x + vx, y, z + vz
    length = (hx * hx + hy * hy + hz * hz).sqrt()
    nh, vh = hz / length, (vx * hx + vz * hz) / length
    a2 = roughness**4
    d = a2 / (math.pi * (nh * nh * (a2 - 1) + 1) ** 2)
    masking = 0.5 / (vz * (a2 + (1 - a2) * z * z).sqrt() + z * math.sqrt(a2 + (1 - a2) * vz * vz))
    weight = polar.sin()[:, None] * (math.pi / 2 / heights) * (2 * math.pi / angles)
    return float((d * masking * fresnel(vh) * z * weight).sum())


def test_the_table_that_comes_with_the_package_is_what_is_integrated() -> None:
    table = split_sum_table()
    assert table.shape == (TABLE_SIZE, TABLE_SIZE, 4) and table.dtype == torch.float32
    torch.testing.assert_close(table, integrated_table(), atol=2e-7, rtol=0)


@pytest.mark.parametrize("roughness", [0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("cosine", [0.06, 0.31, 0.7, 1.0])
def test_the_factors_are_the_reflection_integral(cosine: float, roughness: float) -> None:
    a, b, _, _ = directional_albedo(torch.tensor(cosine), torch.tensor(roughness))
    for f0 in (0.0, 0.04, 1.0):
        wanted = mirrored(cosine, roughness, lambda c, f0=f0: f0 + (1 - f0) * (1 - c) ** 5)  # type: ignore[misc]
        assert float(f0 * a + b) == pytest.approx(wanted, abs=2.5e-3, rel=2e-3)


@pytest.mark.parametrize("ior", [1.2, 1.33, 1.5, 1.77, 2.42])
@pytest.mark.parametrize(("cosine", "roughness"), [(0.1, 0.3), (0.31, 0.5), (0.31, 1.0), (0.7, 0.3), (1.0, 0.8)])
def test_dielectrics_mirror_the_integral_of_fresnels_term(cosine: float, roughness: float, ior: float) -> None:
    """Its two polarisations as in textbooks, from the cosines on both sides."""

    def fresnel(c: Tensor) -> Tensor:
        within = (1 - (1 - c * c) / ior**2).sqrt()
        across, along = (c - ior * within) / (c + ior * within), (ior * c - within) / (ior * c + within)
        return (across.square() + along.square()) / 2

    bent = refraction(ior)
    weights = torch.tensor([1.0, *bent.excess])
    found = dielectric_albedo(torch.tensor(bent.reflectance), weights, torch.tensor(cosine), torch.tensor(roughness))
    assert float(found) == pytest.approx(mirrored(cosine, roughness, fresnel), abs=2e-3, rel=4e-3)


def test_a_smooth_surface_mirrors_schlicks_share() -> None:
    cosine = torch.linspace(0.05, 1.0, 40)
    a, b, _, _ = directional_albedo(cosine, torch.tensor(0.0))
    assert torch.allclose(b, (1 - cosine) ** 5, atol=2e-3)
    assert torch.allclose(a + b, torch.ones(40), atol=1e-5)


@settings(deadline=None, max_examples=60)
@given(cosine=unit, roughness=unit)
def test_no_more_light_leaves_than_arrives(cosine: float, roughness: float) -> None:
    a, b, _, _ = directional_albedo(torch.tensor(cosine), torch.tensor(roughness))
    assert a >= 0 and b >= 0 and a + b <= 1.0 + 1e-6


def test_the_table_is_the_integral() -> None:
    steps = torch.arange(TABLE_SIZE, dtype=torch.float64) / (TABLE_SIZE - 1)
    fine = torch.stack([integrate_split_sum(c, steps, angles=48, heights=160) for c in steps.square()])
    assert split_sum_table().shape == (TABLE_SIZE, TABLE_SIZE, 4)
    assert float((split_sum_table() - fine).abs().max()) < 1e-3


def test_between_its_entries_the_table_stays_near_the_integral() -> None:
    made = torch.Generator().manual_seed(5)
    cosine = torch.rand(400, generator=made, dtype=torch.float64)
    roughness = torch.rand(400, generator=made, dtype=torch.float64)
    error = (torch.stack(directional_albedo(cosine, roughness), -1) - integrate_split_sum(cosine, roughness)).abs()
    assert float(error.mean()) < 7e-4 and float(error[cosine > 0.05].max()) < 6e-3


def test_it_is_differentiable_even_at_grazing_angles() -> None:
    cosine = torch.tensor([0.0, 0.2, 0.9], requires_grad=True)
    roughness = torch.tensor([0.3, 0.6, 1.0], requires_grad=True)
    a, b, c, d = directional_albedo(cosine, roughness)
    (a + 2 * b + 3 * c + 4 * d).sum().backward()
    assert cosine.grad is not None and roughness.grad is not None
    assert bool(torch.isfinite(cosine.grad).all()) and bool((roughness.grad != 0).all())


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="cosine"):
        directional_albedo(torch.tensor(math.nan), torch.tensor(0.5))
    with pytest.raises(InputError, match="roughness"):
        directional_albedo(torch.ones(3), torch.ones(2))
