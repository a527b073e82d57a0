"""Ambient visibility by rays: the reference of quicker ways, and what hits and parallel views take."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface, position_error
from torchrender.checks import check_range
from torchrender.effects.ambient.lattice import lattice_of, spread
from torchrender.effects.ambient.sharing import share_hits
from torchrender.effects.ambient.visibility import WHOLE, AmbientVisibility, as_images
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
    spacing: int = 1,
    far: bool = True,
    share: bool = False,
) -> AmbientVisibility:
    """Visibility (B,H,W) from ``rays`` cosine-weighted directions about each shading normal.

    Args:
        caster: rays against all that hides.
        samples: what cameras see, or what rays hit as an image.
        reach: scene units within which something hides near light.
        spacing: one point casts rays for so many pixels and side of what perspective cameras see, others follow along
            surfaces.
        far: rays go on beyond the reach. False: what lies there counts as open, also for the sky, and rays cost less.
        share: samples take part in what those around them found
            (:func:`~torchrender.effects.ambient.sharing.share_hits`), and directions follow a spiral that is another
            one for each. False: each goes by its own rays; those of hits all follow one spiral, so that few leave no
            noise.

    Rays start off the surface by what its position may be off. Directions below the geometric surface see nothing.
    Those of pixels follow spirals of their own.

    Raises:
        OptionError: no rays, a negative reach.
    """
    check_range("rays", rays, 1, 1 << 16)
    check_range("reach", reach, 0.0, math.inf)
    cast = Cast(caster, rays, reach, far)
    if isinstance(samples, RaySurface):
        return _from_hits(samples, cast, share)
    if share and not samples.cameras.orthographic:
        return _from_all(samples, cast)
    if spacing > 1 and not samples.cameras.orthographic:
        return _from_few(samples, cast, spacing)
    return _images(samples, *_cast(samples, samples.covered, cast, 1))


class Cast(NamedTuple):
    """How rays are cast; see :func:`traced_ambient`."""

    caster: RayCaster
    rays: int
    reach: float
    far: bool


def _from_hits(samples: RaySurface, how: Cast, share: bool) -> AmbientVisibility:
    """Rays of all hits, whose values those take that lie around them."""
    covered, width = samples.covered, samples.width
    if width is None or not share:
        return _images(samples, *_cast(samples, covered, how, 0))
    return _shared(samples, width[covered], how)


def _from_all(samples: GBuffer, how: Cast) -> AmbientVisibility:
    """As :func:`_from_hits`, of pixels of perspective cameras."""
    focal = samples.cameras.intrinsics[:, 0, 0].float()[:, None, None]
    return _shared(samples, (samples.depth / focal)[samples.covered], how)


def _shared(samples: GBuffer | RaySurface, width: Tensor, how: Cast) -> AmbientVisibility:
    """Rays of all covered samples, so wide (N,) each, and values that those around in their picture have a part in."""
    covered = samples.covered
    sky, near, aside = _cast(samples, covered, how, 1)
    values = torch.cat([sky[:, None], near[:, None], aside], dim=1)
    counts = covered.flatten(1).sum(dim=1).tolist()
    each = (v.split(counts) for v in (samples.position[covered], samples.normal[covered], width, values))
    shared = [share_hits(p, n, w, v, how.rays) for p, n, w, v in zip(*each, strict=True)]
    values = torch.cat(shared) if shared else values
    return _images(samples, values[:, 0], values[:, 1], values[:, 2:])


def _images(samples: GBuffer | RaySurface, sky: Tensor, near: Tensor, aside: Tensor) -> AmbientVisibility:
    """Images of what :func:`_cast` found of all covered samples."""
    open_ = aside + WHOLE * sky[:, None] * samples.normal[samples.covered]
    return as_images(samples.covered, sky, near, open_, samples.normal)


def _from_few(samples: GBuffer, how: Cast, spacing: int) -> AmbientVisibility:
    """Rays of few points, whose values all pixels take that lie on their surfaces."""
    covered = samples.covered
    channels = 5 if how.far else 1  # without the sky, what is near tells all
    chosen, found = torch.zeros_like(covered), torch.zeros(*covered.shape, channels)
    grids = [lattice_of(samples, k, spacing) for k in range(len(covered))]
    for k, grid in enumerate(grids):
        chosen[k, grid.rows[:, None], grid.columns] = grid.seen
    sky, near, aside = _cast(samples, chosen, how, spacing)
    found[chosen] = torch.cat([near[:, None], sky[:, None], aside], dim=1)[:, :channels]
    pixels = torch.ones(*covered.shape, channels)
    pixels[..., 2:] = 0.0
    for k, grid in enumerate(grids):
        spread(samples, k, grid, found[k][grid.rows][:, grid.columns], pixels[k])
    shares = torch.where(covered[..., None], pixels[..., :2].clamp(0.0, 1.0), 1.0)
    if not how.far:
        return AmbientVisibility(shares[..., 0], shares[..., 0], samples.normal)
    bent = pixels[..., 2:] + WHOLE * shares[..., 1:2] * samples.normal
    length = bent.norm(dim=-1, keepdim=True)
    unit = torch.where(covered[..., None] & (length > 1e-6), bent / length.clamp_min(1e-6), samples.normal)
    return AmbientVisibility(shares[..., 1], shares[..., 0], unit)


def _cast(samples: GBuffer | RaySurface, chosen: Tensor, how: Cast, step: int) -> tuple[Tensor, Tensor, Tensor]:
    """Visibility of the sky and of what is near, (N,), and the way (N,3) to where it is open, of the chosen samples.

    That way is the mean of the open directions less the visible share of the mean of all: nothing where nothing is
    hidden, so that few rays do not turn the light there, and the normal, ``WHOLE`` times that share, is added later.

    Args:
        step: pixels between samples with spirals of their own; 0: all have the same.
    """
    caster, rays, reach, far = how
    normal, surface = samples.normal[chosen], samples.geometric_normal[chosen]
    gap = position_error(samples, chosen.reshape(-1).nonzero().reshape(-1))
    start = samples.position[chosen] + surface.double() * gap[:, None]
    number = _numbers(samples, chosen, start, step)
    sky, near, aside = torch.zeros(len(start)), torch.zeros(len(start)), torch.zeros(len(start), 3)
    for rows in torch.arange(len(start)).split(max(1, CHUNK // rays)):
        toward = _cosine_directions(normal[rows], rays, number[rows])
        up = (toward * surface[rows, None]).sum(-1) > 0
        cast = up.reshape(-1).nonzero().reshape(-1)
        origins = start[rows].index_select(0, cast // rays)
        directions = toward.reshape(-1, 3).index_select(0, cast).double()
        clear, seen_far = torch.zeros(up.numel(), dtype=torch.bool), torch.zeros(up.numel(), dtype=torch.bool)
        if far:
            hidden = caster.occluded(origins, directions)
            close = hidden.nonzero().reshape(-1)
            beside = hidden.clone()
            beside[close] = caster.occluded(origins[close], directions[close], t_max=reach)
            seen_far[cast] = ~hidden
        else:
            beside = caster.occluded(origins, directions, t_max=reach)
        clear[cast] = ~beside
        near[rows] = clear.reshape(up.shape).float().mean(dim=1)
        if not far:
            seen_far = clear
        seen = seen_far.reshape(up.shape).float()
        sky[rows] = seen.mean(dim=1)
        aside[rows] = (toward * (seen - sky[rows, None])[..., None]).mean(dim=1)
    return sky, near, aside


def _numbers(samples: GBuffer | RaySurface, chosen: Tensor, place: Tensor, step: int) -> Tensor:
    """Numbers (N,) int64 of the spirals of the chosen samples at places (N,3)."""
    if not step:
        return torch.zeros(len(place), dtype=torch.int64)
    if isinstance(samples, GBuffer):
        _, row, column = chosen.nonzero().unbind(-1)  # a camera's picture is the same among others as alone
        return row // step * -(-chosen.shape[2] // step) + column // step
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
