"""Reflections by rays: mirror and glossy, for all reflective pixels or a few; and the environment map as baseline.

What a ray meets is shaded as in the main picture, and if that mirrors in turn, it is followed on, as often as the
options say; then mirrors show the environment.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.buffers import ReflectionLayer, ReflectionState
from torchrender.checks import check_choice, check_range, checked_fields, options_of
from torchrender.effects.reflections.bounces import traced_onward
from torchrender.effects.reflections.glossy import mean_distance, share_rays
from torchrender.effects.reflections.reflectors import (
    LOBES,
    Onward,
    RayShader,
    ReflectedRays,
    ReflectivePixels,
    lobe_rays,
    reflected_rays,
    reflection_layer,
)
from torchrender.rays import RayCaster

_RAYS = 1 << 19  # cast together: bounds the memory of their hits


@dataclass(frozen=True, kw_only=True)
@checked_fields
class TraceOptions:
    """How reflections are traced.

    Raises:
        OptionError: a value outside its range; names it.
    """

    glossy_rays: int = 4  # per glossy pixel; mirrors take one
    lobe: str = "ggx"  # of glossy pixels: of facets, or an even "cone"
    share_rays: bool = True  # neighbouring glossy pixels see what each other's rays see
    bounces: int = 2  # mirrors that light is followed over; 1: mirrors in mirrors show the environment

    def __post_init__(self) -> None:
        check_choice("lobe", self.lobe, LOBES)
        check_range("bounces", self.bounces, 1, 64)
        check_range("glossy_rays", self.glossy_rays, 1, 1024)


def trace_reflections(
    caster: RayCaster,
    pixels: ReflectivePixels,
    shader: RayShader,
    options: TraceOptions | None = None,
    *,
    onward: Onward | None = None,
) -> ReflectionLayer:
    """What the pixels mirror, by the ray caster.

    The distance of a glossy pixel is the mean over the rays of its lobe that hit something.

    Args:
        caster: of the scene's geometry.
        pixels: from :func:`torchrender.effects.reflections.reflectors.reflective_pixels`; a mask there re-traces few.
        shader: gives hits their colour.
        onward: what mirrors show that are seen in mirrors; None: what rays meet, as often as the options say.
    """
    options = options_of(options, TraceOptions)
    color, distance = torch.zeros(len(pixels), 3), torch.full((len(pixels),), torch.inf)
    if onward is None:
        onward = traced_onward(caster, shader, options.bounces, options.lobe)
    for rows, _, rays, weight in _bundles(pixels, options):
        # What neighbours find counts together with a pixel's own, as several rays of one pixel do.
        rays = replace(rays, many=rays.many or (options.share_rays and weight is not None))
        found, length = trace_rays(caster, rays, shader, onward)
        color[rows] = _mean(found, weight, len(rows))
        distance[rows] = mean_distance(length.reshape(len(rows), -1))
    if options.share_rays:
        color = share_rays(pixels, color)
    state = torch.where(torch.isfinite(distance), int(ReflectionState.TRACED), int(ReflectionState.ENVIRONMENT))
    return reflection_layer(pixels, color, distance, state)


def _bundles(
    pixels: ReflectivePixels, options: TraceOptions
) -> Iterator[tuple[Tensor, ReflectivePixels, ReflectedRays, Tensor | None]]:
    """Some pixels at a time: their numbers (M,), themselves, their rays (M k), and weights (M k) of glossy ones."""
    mirror = pixels.gloss <= 0
    for chosen, count in ((mirror, 1), (~mirror, options.glossy_rays)):
        for rows in chosen.nonzero().reshape(-1).split(max(1, _RAYS // count)):
            if not len(rows):  # nothing splits into one empty part
                continue
            part = pixels.select(rows)
            rays, weight = (reflected_rays(part), None) if chosen is mirror else lobe_rays(part, count, options.lobe)
            yield rows, part, rays, weight


def _mean(found: Tensor, weight: Tensor | None, count: int) -> Tensor:
    """Means (count,3) over the rays of each pixel."""
    if weight is not None:
        found = found * weight.float()[:, None]
    return found.reshape(count, -1, 3).mean(dim=1)


def trace_rays(
    caster: RayCaster, rays: ReflectedRays, shader: RayShader, onward: Onward | None = None
) -> tuple[Tensor, Tensor]:
    """Radiance (N,3) along the rays and the lengths (N,) float64 at which they hit, +inf where they do not."""
    hits = rays.first_hits(caster)
    return shader(rays, hits, onward), hits.t


def environment_reflections(
    pixels: ReflectivePixels, shader: RayShader, options: TraceOptions | None = None
) -> ReflectionLayer:
    """What the pixels mirror by pictures all around: of the scene from the reflectors that are seen most, each left out
    of its own, and from its centre.

    Mirrors look once, glossy pixels as often as they would cast rays.
    """
    options = options_of(options, TraceOptions)
    color = torch.zeros(len(pixels), 3)
    for rows, part, rays, weight in _bundles(pixels, options):
        spread = None if weight is None else rays.spread
        leaving = (rays.origin, part.object_id.repeat_interleave(len(rays.origin) // len(rows)))
        color[rows] = _mean(shader.environment(rays.direction, part.cameras.eye, spread, leaving), weight, len(rows))
    if options.share_rays:
        color = share_rays(pixels, color)
    state = torch.full((len(pixels),), int(ReflectionState.ENVIRONMENT))
    return reflection_layer(pixels, color, torch.full((len(pixels),), torch.inf), state)
