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
from torchrender.tuning.sky_lobes import SIZE, Fit, entry, facets, harmonics


@pytest.mark.parametrize(("row", "column"), [(0, 5), (4, 20), (13, 8), (19, 14), (25, 30), (31, 10)])
def test_the_kept_table_is_what_the_fit_gives(row: int, column: int) -> None:
    assert sky_lobes().shape == (SIZE, SIZE, 4)
    cosine = min(max((column / (SIZE - 1)) ** 2, 0.01), 0.995)
    wanted = entry(Fit(), cosine, row / (SIZE - 1))
    np.testing.assert_allclose(sky_lobes()[row, column].numpy(), wanted, atol=2e-3)


def test_a_mirror_looks_along_the_mirrored_direction_and_roughness_one_along_the_normal() -> None:
    cosine = torch.linspace(0.0, 1.0, 20)
    for grazing in (0.0, 1.0):
        part, rough = sky_lobe(cosine, torch.zeros(20), torch.full((20,), grazing))
        torch.testing.assert_close(part, torch.ones(20))
        assert bool((rough == 0).all())
    part, rough = sky_lobe(cosine, torch.ones(20), torch.zeros(20))
    assert float(part.abs().max()) < 0.05 and bool((rough > 0.8).all())


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


@pytest.mark.parametrize(("roughness", "f0"), [(0.3, 1.0), (0.6, 1.0), (0.8, 1.0), (0.3, 0.04), (0.6, 0.04)])
def test_balls_under_a_sky_of_soft_lamps_are_the_sum_over_it(roughness: float, f0: float) -> None:
    """30 dB; with the lobe about the mirrored direction rough metals were at 20."""
    toward = latlong_directions(48, 96).float()
    lamps = torch.nn.functional.normalize(torch.randn(8, 3, generator=torch.Generator().manual_seed(4)), dim=-1)
    radiance = (20.0 * (toward @ lamps.T - 1.0)).exp().sum(-1, keepdim=True) * torch.tensor([1.0, 0.9, 0.8]) + 0.05
    ball = Glossy.of(Environment(radiance=radiance), roughness, f0)
    found, wanted = shade(ball.scene, ball.gbuffer)[ball.gbuffer.covered], ball.exact()
    assert float((found - wanted).square().mean().sqrt()) < 10 ** (-30 / 20) * float(wanted.max())
    assert float(found.mean() / wanted.mean()) == pytest.approx(1.0, abs=0.05)
