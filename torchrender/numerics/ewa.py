"""Weights of elliptical weighted averaging: a Gaussian cut off at radius one. Source: specification 06, section 5."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def kernel_polynomial(kappa: float) -> Tensor:
    """(9,) float32 coefficients of exp(-q / (2 kappa^2)) for q in [0,1], lowest first (Chebyshev nodes)."""
    count = 9
    nodes = 0.5 + 0.5 * torch.cos(math.pi * (torch.arange(count, dtype=torch.float64) + 0.5) / count)
    powers = nodes[:, None] ** torch.arange(count, dtype=torch.float64)
    values = torch.exp(-nodes / (2 * kappa * kappa))
    return torch.linalg.solve(powers, values).float()


def low_pass_stamps(r_h: float, kappa: float, steps: int) -> Tensor:
    """(steps,steps,K,K) weights of the pixels about a point, by its position within a pixel (y, x); 0 beyond r_h."""
    side = math.ceil(2 * r_h)
    offset = r_h - (torch.arange(steps, dtype=torch.float64) + 0.5) / steps
    square = (torch.arange(side, dtype=torch.float64) - offset[:, None]) ** 2
    q = (square[:, None, :, None] + square[None, :, None, :]) / (r_h * r_h)
    return torch.where(q <= 1.0, torch.exp(-q / (2 * kappa * kappa)), 0.0).float()
