"""Closed forms of light in media. Source: specification 09, section 3."""

from __future__ import annotations

import torch
from torch import Tensor

LEVEL = 1e-6
"""Change of the exponent below which a way counts as level."""


def height_optical_depth(first: Tensor, last: Tensor, length: Tensor, falloff: float) -> Tensor:
    """Integral of ``exp(-falloff h)`` along straight ways from height ``first`` to ``last``; all (...), scene units.

    Differentiable; never a quotient of two small numbers.
    """
    q = falloff * (last - first)
    level = q.abs() < LEVEL
    safe = torch.where(level, 1.0, q)
    mean = torch.where(level, 1.0 - q / 2 + q * q / 6, -torch.expm1(-safe) / safe)
    return length * torch.exp(-falloff * first) * mean
