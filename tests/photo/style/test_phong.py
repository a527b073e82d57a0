"""The Phong fit: its equations, their correction, and what it recovers."""

from __future__ import annotations

import math

import pytest
import torch

from torchrender.photo.style.options import FitOptions
from torchrender.photo.style.phong import corrected_exponent, design, fit_phong, printed_design

FREE = FitOptions(ridge=0.0)


def sphere_terms(count: int = 3000, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """d and s over the half of a sphere that an eye at the side of the light sees."""
    generator = torch.Generator().manual_seed(seed)
    normal = torch.nn.functional.normalize(torch.randn(count, 3, dtype=torch.float64, generator=generator), dim=1)
    light = torch.nn.functional.normalize(torch.tensor([0.3, 0.5, 1.0], dtype=torch.float64), dim=0)
    eye = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    normal = normal[normal[:, 2] > 0]
    cosine = normal @ light
    mirrored = 2 * cosine[:, None] * normal - light
    lit = cosine > 0
    return cosine.clamp_min(0), torch.where(lit, (mirrored @ eye).clamp_min(0), 0.0)


def phong(d, s, ambient, diffuse, specular, exponent):
    return (
        torch.tensor(ambient, dtype=torch.float64)
        + d[:, None] * torch.tensor(diffuse, dtype=torch.float64)
        + specular * s[:, None] ** exponent
    )


def test_the_printed_design_is_the_symbolic_expansion() -> None:
    """Checked term by term in another form: derivatives by the exponent, not products."""
    d, s = sphere_terms(200)
    s = s.clamp_min(1e-3)
    rows = printed_design(d, s, 20.0, 0.5)
    alpha = torch.tensor(20.0, dtype=torch.float64, requires_grad=True)
    power = torch.pow(s, alpha)
    slope = torch.autograd.functional.jacobian(lambda a: torch.pow(s, a), alpha.detach())
    expected = torch.stack([torch.ones_like(d), d, power.detach() - 20.0 * slope, 0.5 * slope], dim=1)
    assert float((rows - expected).abs().max()) < 1e-12
    ours = design(d, s, 20.0)
    assert float((ours[:, 2:] - torch.stack([power.detach(), 20.0 * slope], dim=1)).abs().max()) < 1e-12
    # The same column space: k_s (s^a - a s') + k_s0 s' alpha = k_s s^a + delta a s' with delta = k_s0 alpha/a - k_s.
    ks, printed = 0.3, 12.0
    left = rows @ torch.tensor([0.1, 0.4, ks, printed], dtype=torch.float64)
    right = ours @ torch.tensor([0.1, 0.4, ks, 0.5 * printed / 20.0 - ks], dtype=torch.float64)
    assert float((left - right).abs().max()) < 1e-12


@pytest.mark.parametrize(("specular", "printed"), [(0.8, 32.0), (0.3, 12.0), (0.5, 20.0)])
def test_the_exponent_as_printed_and_as_it_is(specular: float, printed: float) -> None:
    d, s = sphere_terms()
    light = 0.1 + 0.4 * d + specular * s**20
    rows = printed_design(d, s)
    solved = torch.linalg.lstsq(rows, light[:, None], driver="gelsd").solution[:, 0]
    assert float(solved[3]) == pytest.approx(printed, abs=1e-6)
    assert float(corrected_exponent(solved[3], solved[2])) == pytest.approx(20.0, abs=1e-6)


def test_without_a_highlight_the_exponent_says_nothing() -> None:
    assert float(corrected_exponent(torch.tensor(3.0), torch.tensor(0.0))) == 20.0


@pytest.mark.parametrize("exponent", [12.0, 20.0, 30.0, 40.0, 60.0])
def test_a_sphere_gives_its_material_back(exponent: float) -> None:
    d, s = sphere_terms()
    ambient, diffuse = (0.1, 0.05, 0.02), (0.5, 0.3, 0.2)
    color = phong(d, s, ambient, diffuse, 0.4, exponent)
    row = fit_phong(color, d, s, FREE)
    truth = torch.tensor([*ambient, *diffuse, 0.4], dtype=torch.float64)
    assert float((row[:7] - truth).abs().max()) < 1e-3
    assert float(row[7]) == pytest.approx(exponent, rel=2e-3)
    assert float(fit_phong(color, d, s)[7]) == pytest.approx(exponent, rel=0.08)


def test_one_solve_has_the_error_of_the_first_order() -> None:
    d, s = sphere_terms()
    color = phong(d, s, (0.1,) * 3, (0.4,) * 3, 0.5, 30.0)
    once = float(fit_phong(color, d, s, FitOptions(ridge=0.0, refine=0))[7])
    assert 25.0 < once < 29.0


def test_a_flat_matt_thing_stays_matt() -> None:
    """A near light over a flat thing: d nearly constant, s in a narrow range, noise of 2 %."""
    found = []
    for seed in range(40):
        generator = torch.Generator().manual_seed(seed)
        d = 0.8 + 0.03 * torch.rand(400, dtype=torch.float64, generator=generator)
        s = 0.55 + 0.1 * torch.rand(400, dtype=torch.float64, generator=generator)
        noise = 0.02 * torch.randn(400, 3, dtype=torch.float64, generator=generator)
        found.append(fit_phong(phong(d, s, (0.1,) * 3, (0.5,) * 3, 0.0, 20.0) + noise, d, s))
    rows = torch.stack(found)
    assert float(rows[:, 6].std()) < 0.03 and float(rows[:, 6].mean()) < 0.03
    # Ambient and diffuse light cannot be told apart here; their sum can.
    assert float(((rows[:, :3] + 0.815 * rows[:, 3:6]) - 0.5075).abs().max()) < 0.03


def test_bounds_hold_and_the_fit_is_the_bounded_minimum() -> None:
    """Against a dense search over the exponent with non-negative least squares: no other row within the bounds fits
    this picture better to first order about the exponent found."""
    d, s = sphere_terms(800)
    color = phong(d, s, (0.0,) * 3, (0.9,) * 3, 1.4, 25.0).clamp(0, None)
    row = fit_phong(color, d, s, FREE)
    assert bool((row[:7] >= 0).all()) and bool((row[:7] <= 1).all()) and 1 <= float(row[7]) <= 200
    assert float(row[6]) == pytest.approx(1.0)

    def error(r: torch.Tensor) -> float:
        return float((phong(d, s, r[:3].tolist(), r[3:6].tolist(), float(r[6]), float(r[7])) - color).square().mean())

    best = error(row)
    generator = torch.Generator().manual_seed(5)
    for _ in range(200):
        other = row + 0.05 * torch.randn(8, dtype=torch.float64, generator=generator) * torch.tensor([1.0] * 7 + [40.0])
        other[:7] = other[:7].clamp(0, 1)
        other[7] = other[7].clamp(1, 200)
        assert error(other) > 0.98 * best


def test_coloured_highlights() -> None:
    d, s = sphere_terms()
    tint = torch.tensor([0.5, 0.3, 0.1], dtype=torch.float64)
    color = phong(d, s, (0.1,) * 3, (0.3,) * 3, 0.0, 20.0) + tint * s[:, None] ** 25.0
    row = fit_phong(color, d, s, FitOptions(ridge=0.0, spec_color=True))
    assert row.shape == (10,) and float((row[6:9] - tint).abs().max()) < 0.01
    assert float(row[9]) == pytest.approx(25.0, rel=0.01)


def test_no_light_no_gloss_no_pixels() -> None:
    color = torch.full((60, 3), 0.2, dtype=torch.float64)
    dark = fit_phong(color, torch.zeros(60), torch.zeros(60))
    assert torch.allclose(dark[:3], torch.full((3,), 0.2, dtype=torch.float64)) and float(dark[6]) == 0.0
    d, s = sphere_terms()
    matt = fit_phong(phong(d, s, (0.1,) * 3, (0.3,) * 3, 0.5, 20.0), d, s, FitOptions(specular=False))
    assert float(matt[6]) == 0.0 and float(matt[7]) == 20.0
    assert bool(torch.isfinite(fit_phong(torch.zeros(0, 3), torch.zeros(0), torch.zeros(0))).all())


def test_a_mirror_of_zero_gives_no_infinite_row() -> None:
    rows = design(torch.ones(3), torch.tensor([0.0, 1e-5, 1.0]))
    assert bool(torch.isfinite(rows).all()) and rows[0, 2] == rows[0, 3] == 0.0
    assert math.isclose(float(rows[2, 2]), 1.0) and float(rows[2, 3]) == 0.0
