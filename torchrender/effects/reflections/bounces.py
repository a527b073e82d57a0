"""Mirrors seen in mirrors: what rays meet that leave the mirrors which other rays have met."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.effects.reflections.reflectors import (
    MirroredPoints,
    Onward,
    RayShader,
    ReflectedRays,
    noise_angle,
    spread_rays,
)
from torchrender.rays import RayCaster

SECOND_LOBE = 4
"""Rays of a glossy lobe that is seen in a mirror; lobes seen in lobes take one."""

_RAYS = 1 << 19  # cast together


def traced_onward(caster: RayCaster, shader: RayShader, bounces: int, lobe: str = "ggx") -> Onward | None:
    """What mirrors in mirrors show, by rays.

    Args:
        bounces: mirrors that light is followed over, the one that the eye sees included; beyond, mirrors show the
            guess of :meth:`RayShader.surroundings`. With 1 there is nothing to follow: None.
        lobe: of glossy mirrors: "ggx" or "cone".
    """
    return _follow(caster, shader, bounces - 1, SECOND_LOBE, lobe) if bounces > 1 else None


def _follow(caster: RayCaster, shader: RayShader, left: int, rays: int, lobe: str) -> Onward:
    further = _follow(caster, shader, left - 1, 1, lobe) if left > 1 else None

    def brought(sent: ReflectedRays) -> Tensor:
        return shader(sent, sent.first_hits(caster), further)

    def onward(points: MirroredPoints) -> Tensor:
        color = torch.zeros(len(points.gloss), 3)
        mirror = points.gloss <= 0
        each = 1 if points.rays.many else rays
        for chosen, count in ((mirror, 1), (~mirror, each)):
            for rows in chosen.nonzero().reshape(-1).split(_RAYS // count):
                if not len(rows):  # nothing splits into one empty part
                    continue
                sent, weight = (
                    (points.rays.select(rows), None) if chosen is mirror else _lobe(points, rows, count, lobe)
                )
                found = brought(sent)
                if weight is not None:
                    found = (found * weight.float()[:, None]).reshape(-1, count, 3).mean(dim=1)
                color[rows] = found
        return color

    return onward


def _lobe(points: MirroredPoints, rows: Tensor, count: int, lobe: str) -> tuple[ReflectedRays, Tensor]:
    """Rays of glossy mirrors; their places in space set the noise that parts neighbours, whatever else is asked for."""
    mirrored = points.rays.select(rows)
    seen = (points.arriving[rows], points.normal[rows], points.geometric_normal[rows])
    place = mirrored.origin / mirrored.width.clamp_min(1e-300)[:, None]
    turn = noise_angle(place[:, 0] + 0.7 * place[:, 2], place[:, 1])
    return spread_rays(mirrored, seen, points.gloss[rows], turn, count, lobe)
