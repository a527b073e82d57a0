"""The GGX lobe against brute-force integration, and the table of its albedo."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from torchrender.numerics.ggx import (
    dielectric_fresnel,
    fifth_power,
    ggx_alpha,
    ggx_lobe,
    half_vector_terms,
    refraction,
    sheen_lobe,
)
from torchrender.numerics.lobe import ggx_directions
from torchrender.numerics.lobe_albedo import albedo_table, mean_albedo, sheen_albedo
from torchrender.numerics.split_sum import directional_albedo


def hemisphere(steps: int) -> tuple[Tensor, float]:
    """Directions (3,N) float64, evenly in cosine and azimuth, and the solid angle of each."""
    t = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps
    z, turn = torch.meshgrid(t, 2 * math.pi * t, indexing="ij")
    z, turn = z.reshape(-1), turn.reshape(-1)
    r = (1 - z * z).sqrt()
    return torch.stack([r * torch.cos(turn), r * torch.sin(turn), z]), 2 * math.pi / len(z)


def integrated(cosine: float, roughness: float, steps: int = 700) -> tuple[float, float]:
    """The two terms of the mirrored share by summing over directions."""
    light, angle = hemisphere(steps)
    eye = torch.tensor([math.sqrt(1 - cosine**2), 0.0, cosine], dtype=torch.float64)[:, None].expand_as(light)
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)[:, None].expand_as(light)
    sine, half = half_vector_terms(up, eye, light)
    alpha = ggx_alpha(torch.full_like(half, roughness))
    value = ggx_lobe(sine, light[2], torch.full_like(half, cosine), alpha) * light[2] * angle
    grazing = fifth_power(half)
    return float((value * (1 - grazing)).sum()), float((value * grazing).sum())


@pytest.mark.parametrize("roughness", [0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("cosine", [0.15, 0.5, 0.95])
def test_the_table_is_the_integral_of_the_lobe(cosine: float, roughness: float) -> None:
    a, b, _, _ = directional_albedo(torch.tensor(cosine), torch.tensor(roughness))
    wanted = integrated(cosine, roughness)
    assert float(a) == pytest.approx(wanted[0], abs=4e-3) and float(b) == pytest.approx(wanted[1], abs=4e-3)


def test_no_more_light_leaves_than_comes_and_a_smooth_surface_keeps_none() -> None:
    table = albedo_table().split
    assert bool((table[..., :2] >= 0).all()) and float((table[..., 0] + table[..., 1]).max()) <= 1.0 + 1e-6
    assert float((table[0, 8:, 0] + table[0, 8:, 1]).min()) > 0.998


def test_alpha_one_facing_the_eye_has_a_closed_form() -> None:
    """D = 1/pi and G/(4 cos cos) = 1/(2 (1 + cos)): the sum over directions is 1 - ln 2."""
    a, b, _, _ = directional_albedo(torch.tensor(1.0), torch.tensor(1.0))
    assert float(a + b) == pytest.approx(1 - math.log(2), abs=3e-3)


def test_means_are_means_over_the_hemisphere() -> None:
    cosine = (torch.arange(4000) + 0.5) / 4000
    for roughness in (0.0, 0.4, 1.0):
        terms = directional_albedo(cosine, torch.full_like(cosine, roughness))
        for term, mean in zip(terms, mean_albedo(torch.tensor(roughness))):
            assert float((term * 2 * cosine).mean()) == pytest.approx(float(mean), abs=3e-3)


@pytest.mark.parametrize("ior", [1.0, 1.01, 1.04, 1.05, 1.2, 1.5, 2.0, 3.0, 10.0, 100.0])
def test_fresnels_term_stays_within_its_bounds_and_ends_at_one(ior: float) -> None:
    cosine = torch.linspace(0.0, 1.0, 500)
    bent = refraction(ior)
    term = bent.share * dielectric_fresnel(bent.slowed, cosine)
    along = ((ior - 1) / (ior + 1)) ** 2
    assert float(term[-1]) == pytest.approx(along, rel=2e-4 if ior >= 1.05 else 1.0, abs=1e-3 * (ior < 1.05))
    assert float(term[0]) == pytest.approx(min((ior - 1) / 0.05, 1.0), abs=1e-6)
    assert bool((term >= 0).all()) and bool((term <= 1 + 1e-6).all())
    brewster = math.cos(math.atan(ior))  # light polarised along passes in whole
    if ior >= 1.05:
        wanted = 0.5 * ((1 - ior**2) / (1 + ior**2)) ** 2
        at = dielectric_fresnel(bent.slowed, torch.tensor(brewster, dtype=torch.float64))
        assert float(at) == pytest.approx(wanted, rel=1e-6)


def test_sheen_sends_back_what_the_table_says() -> None:
    light, angle = hemisphere(300)
    for cosine, roughness in ((0.3, 0.5), (0.8, 0.8)):
        eye = torch.tensor([math.sqrt(1 - cosine**2), 0.0, cosine], dtype=torch.float64)[:, None].expand_as(light)
        up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)[:, None].expand_as(light)
        sine, _ = half_vector_terms(up, eye, light)
        value = sheen_lobe(sine, light[2], torch.full_like(sine, cosine), torch.full_like(sine, roughness))
        found = float((value * light[2] * angle).sum())
        assert float(sheen_albedo(torch.tensor(cosine), torch.tensor(roughness))) == pytest.approx(found, abs=0.02)


def test_roughness_zero_is_finite_everywhere() -> None:
    one = torch.ones(1)
    for sine in (0.0, 1e-12, 1.0):
        value = ggx_lobe(torch.tensor([sine]), one, 0 * one, ggx_alpha(0 * one))
        assert bool(torch.isfinite(value).all())


@pytest.mark.parametrize(("cosine", "roughness"), [(0.95, 0.3), (0.5, 0.6), (0.3, 0.9), (0.9, 1.0)])
def test_the_mean_of_facets_that_the_eye_sees_is_the_integral(cosine: float, roughness: float) -> None:
    """Of the share that is mirrored, of the directions that it comes from, and of their squares."""
    up = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    eye = torch.tensor([[math.sqrt(1 - cosine**2), 0.0, cosine]], dtype=torch.float64)
    alpha = torch.tensor([roughness**2], dtype=torch.float64)
    found, weight = ggx_directions(eye, up, alpha, 20000, torch.zeros(1, dtype=torch.float64))
    light, angle = hemisphere(900)
    eyes, normals = eye.T.expand_as(light), up.T.expand_as(light)
    sine, half = half_vector_terms(normals, eyes, light)
    lobe = ggx_lobe(sine, light[2], torch.full_like(half, cosine), torch.full_like(half, roughness**2))
    share = lobe * light[2] * angle
    for moment in (torch.ones_like, lambda d: d, lambda d: d * d):
        mean = (weight[0, :, None] * moment(found[0])).mean(dim=0)
        wanted = (share * moment(light)).sum(dim=1)
        torch.testing.assert_close(mean, wanted, atol=4e-3, rtol=4e-3)
