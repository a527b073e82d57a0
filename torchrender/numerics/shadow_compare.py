"""Shadow-map arithmetic on tensors: slopes of a plane in a light's image, bias, and a comparison with gradients.

The compiled lookup does the same for hard comparisons; this is the differentiable form, and the one place where the
bias of a pixel can be read. Source of the soft comparison: a sigmoid in place of the step, as in differentiable
rasterisers (Liu et al., Soft Rasterizer, 2019).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor


class LightView(NamedTuple):
    """One view of a light, float64."""

    rotation: Tensor  # (3,3) world to view
    translation: Tensor  # (3,)
    focal: tuple[float, float]  # pixels (orthographic: pixels per scene unit)
    centre: tuple[float, float]  # pixels
    near: float
    far: float
    orthographic: bool


class Projected(NamedTuple):
    """N points in a light's image."""

    u: Tensor  # (N,) pixels; the principal point where the depth is not positive
    v: Tensor
    z: Tensor  # (N,)
    slope_u: Tensor  # (N,) dz/du of the plane through the point, scene units per pixel
    slope_v: Tensor


def project_with_slope(points: Tensor, normals: Tensor, view: LightView) -> Projected:
    """Image, depth and depth slopes of points (N,3) on planes with normals (N,3).

    Perspective: ``dz/du = -z^2 n_x / (fx c)`` with ``c = n.p`` in the light's frame; orthographic:
    ``dz/du = -n_x / (fx n_z)``. A plane seen edge-on has the slope +inf.
    """
    p = points.double() @ view.rotation.T + view.translation
    n = normals.double() @ view.rotation.T
    z = p[:, 2]
    (fx, fy), (cx, cy) = view.focal, view.centre
    if view.orthographic:
        u, v = p[:, 0] * fx + cx, p[:, 1] * fy + cy
        divisor, scale = n[:, 2], torch.ones_like(z)
    else:
        safe = torch.where(z > 0, z, torch.inf)
        u, v = p[:, 0] / safe * fx + cx, p[:, 1] / safe * fy + cy
        divisor, scale = (n * p).sum(-1), z * z
    usable = divisor.abs() > 1e-12 * scale.sqrt()
    divisor = torch.where(usable, divisor, torch.ones_like(divisor))
    slope_u = torch.where(usable, -scale * n[:, 0] / (fx * divisor), torch.inf)
    slope_v = torch.where(usable, -scale * n[:, 1] / (fy * divisor), torch.inf)
    return Projected(u, v, z, slope_u, slope_v)


def texel_width(at: Projected, view: LightView) -> Tensor:
    """Width (N,) of a texel where points lie, scene units."""
    width = 1.0 / min(view.focal)
    return torch.full_like(at.z, width) if view.orthographic else at.z.detach().clamp_min(0.0) * width


def depth_bias(
    at: Projected, view: LightView, limits: tuple[float, float, float], reach: float
) -> tuple[Tensor, Tensor]:
    """Slope-scaled bias ``b0 + k (1/2 + reach)(|dz/du| + |dz/dv|)`` (N,), scene units, and where it exceeds b_max.

    Where it does, the receiver's plane takes over and the bias is b0; an edge-on plane has neither and gets b_max.

    Args:
        limits: b0 (texels), k, and b_max (texels).
        reach: texels beyond the nearest one that the filter touches.

    Returns:
        Bias, and (N,) bool: compare the plane's depth at each tap instead of the point's.
    """
    texel = texel_width(at, view)
    b0, k, b_max = limits[0] * texel, limits[1], limits[2] * texel
    slope = at.slope_u.abs() + at.slope_v.abs()
    grown = b0 + (k * (0.5 + reach) * slope if k > 0 else torch.zeros_like(slope))
    steep = grown > b_max
    usable = torch.isfinite(slope)
    bias = torch.where(steep & usable, b0, torch.minimum(grown, b_max))
    return bias, steep & usable


def soft_window(
    depth: Tensor,
    at: Projected,
    bias: tuple[Tensor, Tensor],
    tau: Tensor,
    n: int | None,
    outside: float | None,
    orthographic: bool,
) -> Tensor:
    """Soft visibility (N,): the bilinear window of (2n+1)^2 taps over ``sigmoid((d + b - z) / tau)``.

    Args:
        depth: (H,W) light depths, +inf where empty.
        bias: from :func:`depth_bias`.
        tau: (N,) width of the soft step, scene units.
        n: radius in texels; None: the nearest texel alone.
        outside: value of taps outside the image; None: the nearest texel inside counts.

    Gradients flow into the points (through ``at``) and depths; biases, slopes and the choice of texels have none.
    """
    height, width = depth.shape
    flat = depth.reshape(-1).double()
    lift, steep = bias[0].detach(), bias[1]
    slope_u, slope_v = (torch.where(steep, s.detach(), 0.0) for s in (at.slope_u, at.slope_v))

    def plane_depth(row: Tensor, column: Tensor) -> Tensor:
        change = slope_u * (column + 0.5 - at.u.detach()) + slope_v * (row + 0.5 - at.v.detach())
        if orthographic:
            return at.z + change
        share = 1.0 - change / at.z.detach().clamp_min(1e-30)  # 1/z is linear in the image
        return torch.where(share > 1e-3, at.z / share.clamp_min(1e-3), at.z)

    def tap(row: Tensor, column: Tensor) -> Tensor:
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        stored = flat[row.clamp(0, height - 1) * width + column.clamp(0, width - 1)]
        empty = torch.isinf(stored)
        z = plane_depth(row, column)
        lit = torch.sigmoid((torch.where(empty, z.detach(), stored) + lift - z) / tau)
        lit = torch.where(empty, 1.0, lit)
        return lit if outside is None else torch.where(inside, lit, outside)

    if n is None:
        return tap(at.v.detach().floor().long(), at.u.detach().floor().long())
    left, top = (at.u.detach() - 0.5).floor(), (at.v.detach() - 0.5).floor()
    a, b = at.u - 0.5 - left, at.v - 0.5 - top
    total = torch.zeros_like(at.z)
    for j in range(-n, n + 2):
        weight_v = 1 - b if j == -n else b if j == n + 1 else torch.ones_like(b)
        for i in range(-n, n + 2):
            weight_u = 1 - a if i == -n else a if i == n + 1 else torch.ones_like(a)
            total = total + weight_v * weight_u * tap(top.long() + j, left.long() + i)
    return (total / (2 * n + 1) ** 2).clamp(0.0, 1.0)


@lru_cache(maxsize=32)
def disc_points(count: int, seed: int = 0) -> Tensor:
    """(count,2) float64 points in the unit disc, far apart: best of many candidates, then spread by repulsion.

    The set is centred and scaled so that its mean squared radius is 1/2, that of the full disc: a filter over it is
    then neither narrower nor wider than the disc. Source: Mitchell, Spectrally optimal sampling, 1991.
    """
    random = np.random.default_rng(seed)

    def candidates(size: int) -> np.ndarray:
        radius, angle = np.sqrt(random.random(size)), 2 * math.pi * random.random(size)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)

    points = np.zeros((count, 2))
    for i in range(count):
        offered = candidates(20 * (i + 1))
        distance = np.linalg.norm(offered[:, None] - points[None, :i], axis=-1).min(axis=1, initial=np.inf)
        points[i] = offered[distance.argmax()]
    points -= points.mean(axis=0)
    spread = np.sqrt((points**2).sum(axis=1).mean())
    points *= math.sqrt(0.5) / spread if spread > 0 else 0.0
    return torch.from_numpy(points)
