"""Round lobes for those of facets seen aslant: the kept table is what the fit gives; skies beside sums over them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from torchrender.numerics.split_sum import integrate_split_sum
from torchrender.report.shading.glossy_sky import Glossy
from torchrender.scene.environment import Environment
from torchrender.scene.sky.irradiance import latlong_directions
from torchrender.shade import shade
from torchrender.shading.sky import sky_lobe, sky_lobes
from torchrender.tuning.sky_lobes import SIZE, SMOOTH, WORTH, Fit, entry, facets, harmonics, legendre, pairs_of


@pytest.fixture(scope="module")
def fit() -> Fit:
    return Fit()


def cost(fit: Fit, lobes: list[tuple[float, float, float]], cosine: float, roughness: float) -> float:
    """Weighed squared difference of lobes (share, angle to the normal, roughness) to that of facets, of its size."""
    toward, weight, _ = facets(cosine, roughness)
    values, degrees = harmonics(np.clip(toward[:, 2], -1.0, 1.0), np.arctan2(toward[:, 1], toward[:, 0]))
    exact = (weight / weight.sum()) @ values
    made = np.zeros_like(exact)
    for share, lean, rough in lobes:
        grid = np.linspace(0.02, 1.0, 99)
        zonal = np.array([np.interp(rough, grid, column) for column in fit.round.T])
        at, _ = harmonics(np.array([math.cos(lean)]), np.array([math.pi if lean >= 0.0 else 0.0]))
        made += share * zonal[degrees] * at[0]
    spread = fit.spread[degrees]
    return float((spread * (exact - made) ** 2).sum() / (spread * exact**2).sum())


def lobes_of(numbers: list[float], share: float, cosine: float, roughness: float) -> list[tuple[float, float, float]]:
    """Share, angle to the normal and roughness of two lobes, for part and width of each."""
    mirror, found = math.acos(cosine), []
    for number in (0, 2):
        part = numbers[number]
        chord = np.array([math.sin(mirror) * part, math.cos(mirror) * part + 1.0 - part])
        found.append((share if number == 0 else 1.0 - share, math.atan2(*chord), numbers[number + 1] * roughness))
    return found


@pytest.mark.parametrize(("row", "column"), [(8, 20), (13, 8), (19, 14), (25, 30), (31, 10)])
def test_kept_entries_are_as_close_as_the_fit_gets(fit: Fit, row: int, column: int) -> None:
    assert sky_lobes().shape == (SIZE, SIZE, 12)
    cosine, roughness = min(max((column / (SIZE - 1)) ** 2, 0.01), 0.995), row / (SIZE - 1)
    kept = sky_lobes()[row, column].tolist()
    numbers = entry(pairs_of(fit, cosine, roughness, []), cosine, roughness)
    wanted = cost(fit, lobes_of(numbers[:4], numbers[8], cosine, roughness), cosine, roughness)
    assert cost(fit, lobes_of(kept[:4], kept[8], cosine, roughness), cosine, roughness) < 1.02 / WORTH * wanted


@pytest.mark.parametrize(("cosine", "roughness"), [(0.83, 0.31), (0.6, 0.42), (0.33, 0.55), (0.12, 0.44), (0.5, 0.7)])
def test_two_lobes_are_closer_than_any_one_also_between_entries(fit: Fit, cosine: float, roughness: float) -> None:
    """By 1 dB at least."""
    toward, weight, _ = facets(cosine, roughness)
    values, degrees = harmonics(np.clip(toward[:, 2], -1.0, 1.0), np.arctan2(toward[:, 1], toward[:, 0]))
    exact = (weight / weight.sum()) @ values
    single = 1.0 + float((fit.own - 2.0 * fit.common(values, weight)).min()) / float(
        (fit.spread[degrees] * exact**2).sum()
    )
    first, second = sky_lobe(torch.tensor([cosine]), torch.tensor([roughness]), torch.zeros(1))
    assert float(first.share + second.share) == pytest.approx(1.0, abs=1e-6)
    numbers = [float(v) for lobe in (first, second) for v in (lobe.part, lobe.roughness / roughness)]
    found = cost(fit, lobes_of(numbers, float(first.share), cosine, roughness), cosine, roughness)
    assert found < 0.8 * single


def test_a_mirror_looks_along_the_mirrored_direction_and_roughness_one_near_the_normal() -> None:
    cosine = torch.linspace(0.0, 1.0, 20)
    for grazing in (0.0, 1.0):
        for lobe in sky_lobe(cosine, torch.zeros(20), torch.full((20,), grazing)):
            torch.testing.assert_close(lobe.part, torch.ones(20))
            assert bool((lobe.roughness == 0).all())
    first, second = sky_lobe(cosine, torch.ones(20), torch.zeros(20))
    middle = first.share * first.part + second.share * second.part
    assert float(middle.max()) < 0.6 and bool((torch.maximum(first.roughness, second.roughness) > 0.8).all())


def test_lobes_narrower_than_the_harmonics_scale() -> None:
    cosine = torch.full((2,), 0.4)
    for lobe in sky_lobe(cosine, torch.tensor([3.0, 6.0]) / (SIZE - 1), torch.zeros(2)):
        assert float(lobe.roughness[1] / lobe.roughness[0]) == pytest.approx(2.0, rel=1e-3)
        wide, narrow = float(1.0 - lobe.part[1]), float(1.0 - lobe.part[0])
        assert wide == pytest.approx(4.0 * narrow, abs=1e-5)
    assert 6.0 / (SIZE - 1) < SMOOTH


def test_legendre_polynomials_are_numpys() -> None:
    x = np.linspace(-1.0, 1.0, 21)
    for degree in (0, 1, 7, 48):
        wanted = np.polynomial.legendre.Legendre.basis(degree)(x)
        np.testing.assert_allclose(legendre(x)[degree], wanted, atol=1e-12)


def test_harmonics_are_orthonormal_over_the_sphere() -> None:
    points, weights = np.polynomial.legendre.leggauss(64)
    turn = (np.arange(128) + 0.5) / 128 * 2 * math.pi
    z, a = (v.reshape(-1) for v in np.meshgrid(points, turn, indexing="ij"))
    values, degrees = harmonics(z, a)
    chosen = values[:, degrees <= 12]
    weight = np.repeat(weights, 128) * 2 * math.pi / 128
    np.testing.assert_allclose(chosen.T @ (chosen * weight[:, None]), np.eye(chosen.shape[1]), atol=1e-10)


@pytest.mark.parametrize(("cosine", "roughness"), [(0.2, 0.4), (0.7, 0.8)])
def test_facets_send_what_the_split_sum_says(cosine: float, roughness: float) -> None:
    toward, share, grazing = facets(cosine, roughness)
    a, b, _, _ = integrate_split_sum(torch.tensor(cosine), torch.tensor(roughness)).tolist()
    assert share.sum() == pytest.approx(a + b, abs=2e-3) and (share * grazing).sum() == pytest.approx(b, abs=2e-3)
    np.testing.assert_allclose(np.linalg.norm(toward, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize(
    ("roughness", "f0", "decibels"),
    [(0.3, 1.0, 33), (0.6, 1.0, 33), (0.8, 1.0, 33), (0.3, 0.04, 30), (0.6, 0.04, 33)],
)
def test_balls_under_a_sky_of_soft_lamps_are_the_sum_over_it(roughness: float, f0: float, decibels: int) -> None:
    """With one lobe about the mirrored direction rough metals were at 20."""
    toward = latlong_directions(48, 96).float()
    lamps = torch.nn.functional.normalize(torch.randn(8, 3, generator=torch.Generator().manual_seed(4)), dim=-1)
    radiance = (20.0 * (toward @ lamps.T - 1.0)).exp().sum(-1, keepdim=True) * torch.tensor([1.0, 0.9, 0.8]) + 0.05
    ball = Glossy.of(Environment(radiance=radiance), roughness, f0)
    found, wanted = shade(ball.scene, ball.gbuffer)[ball.gbuffer.covered], ball.exact()
    assert float((found - wanted).square().mean().sqrt()) < 10 ** (-decibels / 20) * float(wanted.max())
    assert float(found.mean() / wanted.mean()) == pytest.approx(1.0, abs=0.05)
