"""How light is spread where it is scattered."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.checks import check_range
from torchrender.scene.sky.harmonics import harmonics_2


def henyey_greenstein(cosine: Tensor, asymmetry: float) -> Tensor:
    """Share per steradian ``(1 - g^2) / (4 pi (1 + g^2 - 2 g c)^(3/2))``; isotropic for g = 0.

    Args:
        cosine: c between the ways of the light before and after; of any shape.
        asymmetry: g, the mean cosine: positive where light goes on more than it turns back.

    Source: Henyey, Greenstein, Diffuse radiation in the galaxy, 1941. Differentiable.

    Raises:
        OptionError: g outside [-0.99, 0.99].
    """
    g = check_range("asymmetry", asymmetry, -0.99, 0.99)
    # Without cancellation where light hardly turns.
    base = (1.0 - g) ** 2 + 2.0 * g * (1.0 - cosine)
    return (1.0 - g * g) / (4.0 * math.pi) / (base * torch.sqrt(base))


def scattered_surroundings(coefficients: Tensor, directions: Tensor, asymmetry: float) -> Tensor:
    """Radiance (...,3) that surroundings bring to a place and a medium there sends back along ``directions``.

    Band l of the surroundings arrives with the factor g^l, the phase function's own coefficient.

    Args:
        coefficients: (9,3) spherical harmonics of the surroundings, up to band 2.
        directions: (...,3) unit, away from the eye.
    """
    bands = torch.tensor([1.0] + [asymmetry] * 3 + [asymmetry**2] * 5, dtype=directions.dtype)
    basis = harmonics_2(directions) * bands
    return (basis @ coefficients.to(directions.dtype)).clamp_min(0.0)
