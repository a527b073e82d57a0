"""Kernel weights of splatting against their closed forms."""

from __future__ import annotations

import math

import pytest
import torch

from torchrender.numerics.ewa import kernel_polynomial, low_pass_stamps


@pytest.mark.parametrize("kappa", [0.35, 0.5, 0.7, 1.0])
def test_the_polynomial_is_the_gaussian(kappa):
    q = torch.linspace(0, 1, 1001, dtype=torch.float64)
    powers = q[:, None] ** torch.arange(9, dtype=torch.float64)
    wanted = torch.exp(-q / (2 * kappa**2))
    found = powers @ kernel_polynomial(kappa).double()
    assert float((found / wanted - 1).abs().max()) < 3e-4
    assert bool((found > 0).all())


@pytest.mark.parametrize("r_h", [0.5, 1.0, 1.7, 2.0])
def test_stamps_are_the_gaussian_about_their_place(r_h):
    steps, kappa = 16, 0.5
    stamps = low_pass_stamps(r_h, kappa, steps)
    for j in range(steps):
        for i in range(0, steps, 5):
            for y in range(stamps.shape[2]):
                for x in range(stamps.shape[3]):
                    dy, dx = y - (r_h - (j + 0.5) / steps), x - (r_h - (i + 0.5) / steps)
                    q = (dx * dx + dy * dy) / r_h**2
                    wanted = math.exp(-q / (2 * kappa**2)) if q <= 1 else 0.0
                    assert float(stamps[j, i, y, x]) == pytest.approx(wanted, abs=1e-6)
    # Every pixel that a point can reach is in its stamp: the last row and column stay empty or are just reached.
    assert stamps.shape[2] >= 2 * r_h
