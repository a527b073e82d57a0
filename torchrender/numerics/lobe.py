"""Mirrored directions, how much is mirrored, and the rays that stand for a glossy lobe: of GGX facets, or a cone."""

from __future__ import annotations

import math

import torch
from torch import Tensor

WIDEST_LOBE_DEG = 30.0
"""Half angle of the lobe of gloss 1 (specification 03, section 8)."""

_GRAZING = 1e-7
"""Least cosine between eye and normal of a facet surface."""

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


def ggx_directions(to_eye: Tensor, normal: Tensor, alpha: Tensor, rays: int, turn: Tensor) -> tuple[Tensor, Tensor]:
    """Directions (N,rays,3) of light that GGX facets mirror to the eye, and the weight (N,rays) of what arrives there.

    The mean of weight times radiance is the integral of ``D G2 / (4 n.v)`` over the hemisphere, Fresnel's share left
    out: facets are drawn as the eye sees them, along a golden-angle spiral, and the weight ``G2 / G1`` is what others
    hide of the light. Directions below the surface have weight 0. ``alpha`` 0 gives the mirrored direction, exactly.
    Sources: Dupuy and Benyoub, Sampling visible GGX normals with spherical caps, 2023; Heitz 2014 (eq. 99).

    Args:
        to_eye: (N,3) unit.
        normal: (N,3) unit shading normal.
        alpha: (N,) width in [0,1]: roughness squared.
        turn: (N,) radians by which each spiral is turned, so that neighbouring pixels do not repeat one pattern.
    """
    first, second = frame(normal)
    local = torch.stack([(to_eye * first).sum(-1), (to_eye * second).sum(-1), (to_eye * normal).sum(-1)], dim=-1)
    # A bent shading normal may face away from an eye that sees the surface.
    local[:, 2] = local[:, 2].clamp_min(_GRAZING)
    local = torch.nn.functional.normalize(local, dim=-1)
    stretched = torch.stack([alpha * local[:, 0], alpha * local[:, 1], local[:, 2]], dim=-1)
    stretched = torch.nn.functional.normalize(stretched, dim=-1)
    steps = torch.arange(rays, dtype=to_eye.dtype)
    angle = turn[:, None] + _GOLDEN_ANGLE * steps
    z = (1.0 - (steps + 0.5) / rays) * (1.0 + stretched[:, 2:]) - stretched[:, 2:]
    sine = (1.0 - z * z).clamp_min(0.0).sqrt()
    half = torch.stack([sine * torch.cos(angle), sine * torch.sin(angle), z], dim=-1) + stretched[:, None]
    wide = alpha[:, None]
    facet = torch.stack([wide * half[..., 0], wide * half[..., 1], half[..., 2].clamp_min(0.0)], dim=-1)
    flat = facet.square().sum(-1, keepdim=True) < 1e-60  # the spiral's end may stand upright on a mirror
    up = torch.tensor([0.0, 0.0, 1.0], dtype=facet.dtype)
    facet = torch.nn.functional.normalize(torch.where(flat, up, facet), dim=-1, eps=1e-300)
    out = 2.0 * (local[:, None] * facet).sum(-1, keepdim=True) * facet - local[:, None]
    to_light, to_viewer = _masking(out[..., 2], wide), _masking(local[:, 2:], wide)
    weight = torch.where(out[..., 2] > 0, (1.0 + to_viewer) / (1.0 + to_viewer + to_light), 0.0)
    axes = torch.stack([first, second, normal], dim=1)
    return torch.nn.functional.normalize(out @ axes, dim=-1, eps=1e-300), weight


def _masking(cosine: Tensor, alpha: Tensor) -> Tensor:
    """Smith's Lambda of GGX facets: hidden over seen area in a direction of that cosine to the normal."""
    square = cosine.clamp_min(_GRAZING).square()
    return ((1.0 + alpha.square() * (1.0 - square).clamp_min(0.0) / square).sqrt() - 1.0) / 2.0


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
