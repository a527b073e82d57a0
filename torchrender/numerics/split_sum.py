"""How much light a rough mirror returns in all: the numbers of the split-sum approximation.

The share that a surface with a GGX lobe mirrors out of a white surrounding is, with Schlick's Fresnel term, linear in
its reflectance at normal incidence: ``F0 A + B``, where A and B depend on the cosine to the normal and on the
roughness alone (Karis, *Real shading in Unreal Engine 4*, 2013). What Fresnel's own term of a dielectric adds to
Schlick's is a sum of two such factors more (:func:`torchrender.numerics.ggx.refraction`). They are integrated here,
over the normals that the eye sees, with Smith's height-correlated masking (Heitz 2014), and kept in a small table.
That comes with the package, as integrating it would be a quarter of a second of every process's first picture.

    python -m torchrender.numerics.split_sum    integrates and writes it
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_finite
from torchrender.errors import InputError
from torchrender.numerics.ggx import EXCESS_OF, fifth_power, fresnel_excess

TABLE_SIZE = 32
"""Entries per axis. Interpolation between them is wrong by 5e-4 on average, and by up to 0.01 within 2 degrees of
grazing on nearly smooth mirrors."""

SHIPPED = Path(__file__).parent.parent / "data" / "split_sum.npy"

ANGLES, HEIGHTS = 24, 48
"""Quadrature points about and along the visible hemisphere of normals: 2e-4 away from the limit."""


def directional_albedo(cosine: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Factors A, B, C and D (...) of the share of light from everywhere that is mirrored: ``F0 A + B`` by Schlick's
    term, to which Fresnel's adds ``x C + y D``; x and y: :attr:`torchrender.numerics.ggx.Refraction.excess`.

    Args:
        cosine: (...) between the normal and the direction to the eye; clamped to [0,1].
        roughness: (...) square root of the GGX alpha, clamped to [0,1]; broadcast with ``cosine``.

    ``A + B`` is the share at a reflectance of one: what is missing to 1 is what a single bounce between microfacets
    loses. Differentiable in both arguments.

    Raises:
        InputError: values that are not finite, or shapes that do not broadcast.
    """
    check_finite("cosine", cosine)
    check_finite("roughness", roughness)
    try:
        cosine, roughness = torch.broadcast_tensors(cosine, roughness)
    except RuntimeError as problem:
        raise InputError(f"roughness: {problem}") from problem
    # The square root is steep at 0: a clamp keeps its derivative finite.
    row, i = _place(cosine.clamp(1e-8, 1.0).sqrt())
    column, j = _place(roughness.clamp(0.0, 1.0))
    table = split_sum_table().to(row.dtype)
    nearer = torch.lerp(table[i, j], table[i, j + 1], column[..., None])
    farther = torch.lerp(table[i + 1, j], table[i + 1, j + 1], column[..., None])
    a, b, c, d = torch.lerp(nearer, farther, row[..., None]).unbind(-1)
    return a, b, c, d


def dielectric_albedo(reflectance: Tensor, refraction: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """Share (...) of light from everywhere that the dielectric part of a material mirrors, in [0,1].

    Args:
        reflectance: (...) along the normal, weight and tint within.
        refraction: (3,...) weight at grazing angles, and the two numbers of
            :attr:`torchrender.numerics.ggx.Refraction.excess`.
        cosine, roughness: (...) as in :func:`directional_albedo`.
    """
    a, b, c, d = directional_albedo(cosine, roughness)
    weight, first, second = refraction
    return (reflectance * a + weight * (b + first * c + second * d)).clamp(0.0, 1.0)


def split_sum_table() -> Tensor:
    """(N,N,4) float32 factors A, B, C and D, N = :data:`TABLE_SIZE`, to be interpolated linearly, not to be written to.

    Row i holds the cosine ``(i / (N - 1))^2``, which is finer where mirrors change most, column j the roughness
    ``j / (N - 1)``.
    """
    return _table()


@lru_cache(maxsize=1)
def _table() -> Tensor:
    with torch.inference_mode(False):
        return torch.from_numpy(np.load(SHIPPED, allow_pickle=False))


def integrated_table() -> Tensor:
    """What :func:`split_sum_table` holds, integrated anew."""
    with torch.inference_mode(False), torch.no_grad():
        steps = torch.arange(TABLE_SIZE, dtype=torch.float64) / (TABLE_SIZE - 1)
        return torch.stack([integrate_split_sum(c, steps) for c in steps.square()]).float()


def _place(value: Tensor) -> tuple[Tensor, Tensor]:
    """Fraction and number of the table's interval that holds values in [0,1]."""
    scaled = value * (TABLE_SIZE - 1)
    index = scaled.detach().long().clamp(0, TABLE_SIZE - 2)
    return scaled - index, index


def integrate_split_sum(cosine: Tensor, roughness: Tensor, *, angles: int = ANGLES, heights: int = HEIGHTS) -> Tensor:
    """Factors (...,4) by quadrature; shapes, units and limits as in :func:`directional_albedo`.

    The visible normals of a GGX surface are the sums of the eye's direction, in a space where the surface has
    roughness one, and the directions of a spherical cap (Dupuy and Benyoub, *Sampling visible GGX normals with
    spherical caps*, 2023). Mirrored there, light weighs ``G2 / G1`` times the Fresnel term.
    """
    cosine, alpha = torch.broadcast_tensors(cosine.clamp(1e-4, 1.0), roughness.clamp(0.0, 1.0).square())
    cosine, alpha = cosine[..., None, None], alpha[..., None, None]
    angle, height, weight = (v.to(alpha.dtype) for v in _quadrature(angles, heights))
    sine = (1.0 - cosine * cosine).sqrt()
    length = (alpha * alpha * sine * sine + cosine * cosine).sqrt()
    x, z = alpha * sine / length, cosine / length  # direction to the eye, where the surface has roughness one
    cap = (1.0 - height) * (1.0 + z) - z
    across = (1.0 - cap * cap).clamp_min(0.0).sqrt()
    hx, hy, hz = alpha * (across * angle.cos() + x), alpha * across * angle.sin(), cap + z
    half = (sine * hx + cosine * hz) / (hx * hx + hy * hy + hz * hz).sqrt().clamp_min(1e-12)
    up = hz / (hx * hx + hy * hy + hz * hz).sqrt().clamp_min(1e-12)
    half = half.clamp(0.0, 1.0)
    light = 2.0 * half * up - cosine  # cosine of the mirrored direction
    share = (1.0 + _masked(cosine, alpha)) / (1.0 + _masked(cosine, alpha) + _masked(light.clamp_min(1e-6), alpha))
    share = torch.where(light > 0, share * weight, 0.0)
    schlick = (share * fifth_power(half)).sum(dim=(-1, -2))
    more = [(share * fresnel_excess(ior, half)).sum(dim=(-1, -2)) for ior in EXCESS_OF]
    return torch.stack([share.sum(dim=(-1, -2)) - schlick, schlick, *more], dim=-1)


def _masked(cosine: Tensor, alpha: Tensor) -> Tensor:
    """Smith's Lambda of GGX."""
    slope = alpha * alpha * (1.0 / (cosine * cosine) - 1.0).clamp_min(0.0)
    return 0.5 * ((1.0 + slope).sqrt() - 1.0)


def _quadrature(angles: int, heights: int) -> tuple[Tensor, Tensor, Tensor]:
    """Half a turn (angles,1), heights (1,heights) in [0,1], denser at the horizon where masking sets in, weights."""
    angle = (torch.arange(angles, dtype=torch.float64) + 0.5) * math.pi / angles
    points, weights = np.polynomial.legendre.leggauss(heights)
    free = torch.from_numpy((1.0 - points) / 2.0)
    return angle[:, None], (1.0 - free * free)[None], (torch.from_numpy(weights) * free / angles)[None]


if __name__ == "__main__":
    np.save(SHIPPED, integrated_table().numpy())
