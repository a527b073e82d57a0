"""Ambient visibility by rays: the reference of quicker ways, and what hits and parallel views take."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.checks import check_range
from torchrender.effects.ambient.visibility import AmbientVisibility, as_images
from torchrender.numerics.lobe import frame
from torchrender.rays import RayCaster

CHUNK = 1 << 18
"""Rays at a time."""


def traced_ambient(
    caster: RayCaster,
    samples: GBuffer | RaySurface,
    *,
    rays: int,
    reach: float,
    gap: float,
    turned: bool | None = None,
) -> AmbientVisibility:
    """Visibility (B,H,W) from ``rays`` cosine-weighted directions about each shading normal.

    Args:
        caster: rays against all that hides.
        samples: what cameras see, or what rays hit as an image.
        reach: scene units within which something hides near light.
        gap: scene units above the surface at which rays start.

        turned: directions follow a spiral that is another one for each sample. None: from pixel to pixel, but not from
            hit to hit, where few rays must leave no noise. Hits go by their place, whatever else was hit.

    Directions below the geometric surface see nothing.

    Raises:
        OptionError: no rays, a negative reach or gap.
    """
    check_range("rays", rays, 1, 1 << 16)
    check_range("reach", reach, 0.0, math.inf)
    check_range("gap", gap, 0.0, math.inf)
    covered = samples.covered
    normal, surface = samples.normal[covered], samples.geometric_normal[covered]
    start = samples.position[covered] + surface.double() * gap
    number = _numbers(samples, start, isinstance(samples, GBuffer) if turned is None else turned)
    sky, near, bent = torch.zeros(len(start)), torch.zeros(len(start)), torch.zeros(len(start), 3)
    for rows in torch.arange(len(start)).split(max(1, CHUNK // rays)):
        toward = _cosine_directions(normal[rows], rays, number[rows])
        up = (toward * surface[rows, None]).sum(-1) > 0
        chosen = up.reshape(-1).nonzero().reshape(-1)
        t = torch.zeros(up.numel(), dtype=torch.float64)
        origins = start[rows, None].expand(-1, rays, -1).reshape(-1, 3)
        t[chosen] = caster.first_hit(origins[chosen], toward.reshape(-1, 3)[chosen].double()).t
        t = t.reshape(up.shape)
        is_open = torch.isinf(t)
        sky[rows] = is_open.float().mean(dim=1)
        near[rows] = (t > reach).float().mean(dim=1)
        bent[rows] = (toward * is_open[..., None]).sum(dim=1)
    return as_images(covered, sky, near, bent, samples.normal)


def _numbers(samples: GBuffer | RaySurface, place: Tensor, turned: bool) -> Tensor:
    """Numbers (N,) int64 of the spirals of covered samples at places (N,3)."""
    if not turned:
        return torch.zeros(len(place), dtype=torch.int64)
    covered = samples.covered
    if isinstance(samples, GBuffer):
        return torch.arange(covered.numel()).reshape(covered.shape)[covered]
    bits = place.contiguous().view(torch.int64) >> 20  # what rounding leaves alone
    return ((bits * torch.tensor([73856093, 19349663, 83492791])).sum(-1) >> 7) & 0xFFFF


def _cosine_directions(normal: Tensor, rays: int, number: Tensor) -> Tensor:
    """Directions (N,rays,3) about normals (N,3), as dense as the cosine; the spiral of each pixel is another one."""
    steps = torch.arange(rays, dtype=torch.float32)
    shift = torch.frac(0.5 + number.double() * 0.754877666246693).float()[:, None]
    turn = torch.frac(number.double() * 0.569840290998053).float()[:, None] * (2 * math.pi)
    share = (steps + shift) / rays
    angle = steps * (math.pi * (3.0 - math.sqrt(5.0))) + turn
    across = share.sqrt()
    first, second = frame(normal)
    up = (1.0 - share).clamp_min(0.0).sqrt()[..., None] * normal[:, None]
    return up + (across * angle.cos())[..., None] * first[:, None] + (across * angle.sin())[..., None] * second[:, None]
