"""Mirrored directions, how much is mirrored, and the cone of rays that stands for a glossy lobe."""

from __future__ import annotations

import math

import torch
from torch import Tensor

WIDEST_LOBE_DEG = 30.0
"""Half angle of the lobe of gloss 1 (specification 03, section 8)."""

_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def reflect(direction: Tensor, normal: Tensor) -> Tensor:
    """``d - 2 (d.n) n`` for (...,3) directions and unit normals."""
    return direction - 2.0 * (direction * normal).sum(-1, keepdim=True) * normal


def schlick(degree: Tensor, cosine: Tensor) -> Tensor:
    """Share of light that a surface of specular degree (...) mirrors at an angle of that cosine to its normal.

    ``F = s + (1 - s)(1 - cos)^5``; 0 where the degree is 0 (Schlick 1994; specification 04, section 8).
    """
    share = degree + (1.0 - degree) * (1.0 - cosine.clamp(0.0, 1.0)).pow(5)
    return torch.where(degree > 0, share, 0.0)


def lobe_directions(axis: Tensor, normal: Tensor, gloss: Tensor, rays: int, turn: Tensor) -> Tensor:
    """Directions (N,rays,3) spread evenly over the cone of half angle ``gloss * 30`` degrees about each axis.

    The cap is cut into rings of equal area along a golden-angle spiral, so every ray counts the same. Directions below
    the surface are mirrored about its tangent plane. Gloss 0 gives the axis, exactly.

    Args:
        axis: (N,3) unit, above the surface.
        normal: (N,3) unit geometric normal.
        gloss: (N,) in [0,1].
        turn: (N,) radians by which each spiral is turned, so that neighbouring pixels do not repeat one pattern.
    """
    steps = torch.arange(rays, dtype=axis.dtype)
    rise = (1.0 - torch.cos(gloss * math.radians(WIDEST_LOBE_DEG)))[:, None] * ((steps + 0.5) / rays)
    radius = (rise * (2.0 - rise)).clamp_min(0.0).sqrt()  # sine of the angle to the axis
    angle = turn[:, None] + _GOLDEN_ANGLE * steps
    first, second = frame(axis)
    x, y = (radius * torch.cos(angle))[..., None], (radius * torch.sin(angle))[..., None]
    spread = (1.0 - rise)[..., None] * axis[:, None] + x * first[:, None] + y * second[:, None]
    below = (spread * normal[:, None]).sum(-1, keepdim=True).clamp_max(0.0)
    return spread - 2.0 * below * normal[:, None]


def frame(axis: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors (N,3) at right angles to each unit axis (N,3) and to each other, continuous but at -z.

    Source: Duff et al., Building an orthonormal basis, revisited, 2017.
    """
    x, y, z = axis.unbind(-1)
    sign = torch.copysign(torch.ones_like(z), z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = torch.stack([1.0 + sign * x * x * a, sign * b, -sign * x], dim=-1)
    second = torch.stack([b, sign + y * y * a, -y], dim=-1)
    return first, second
