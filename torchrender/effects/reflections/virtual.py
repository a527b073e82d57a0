"""What mirrors show as pictures of their own: seen from another place, mirrored points move as they should.

What a plane mirrors looks as if it stood behind the plane, as far away as the light has come; there it may be warped
like any surface. A curved mirror shows it nearer, by the mirror equation of its mean curvature. Source: the thesis
behind specification 04, section 5.5.4: the client warps mirrored points, not painted mirrors.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer, ReflectionState
from torchrender.effects.reflections.reflectors import mirrored_light
from torchrender.scene.model import Scene

CROSSING = 0.05
"""Least ratio of mirrored to virtual distance: a hollow mirror near its focus shows nothing that stands still."""


@dataclass(frozen=True, eq=False)
class VirtualImages:
    """What the mirrors of B pictures show, where it seems to be."""

    depth: Tensor  # (B,H,W) float32 camera z of the virtual points; +inf what is infinitely far, or not known
    light: Tensor  # (B,H,W,3) part of the pixel's radiance that was mirrored
    known: Tensor  # (B,H,W) bool: the pixel mirrors, and its virtual point is known


def virtual_images(scene: Scene, gbuffer: GBuffer, layer: ReflectionLayer) -> VirtualImages:
    """Virtual points and mirrored light of a picture's reflections."""
    known = layer.state != ReflectionState.NONE
    light = mirrored_light(scene, gbuffer, layer)
    offset = gbuffer.position - gbuffer.cameras.eye[:, None, None]
    length = torch.where(known, offset.norm(dim=-1), 1.0).clamp_min(1e-300)
    distance = torch.where(known, layer.distance, 0.0).double()
    cosine = (gbuffer.normal * layer.direction).sum(-1).abs().clamp_min(0.1).double()
    # The light's bundle bends by 1 / cosine across the plane of incidence's axis, by cosine along it, and seems to come
    # from two places; the point between that moves as far as both do on the mean, when the eye moves, stands for them.
    bend = 2.0 * _curvature(gbuffer)
    (steep, clear), (flat, open_) = (_virtual(distance, bend * share) for share in (1.0 / cosine, cosine))
    nearness = 0.5 / (length + steep) + 0.5 / (length + flat)
    known = known & clear & open_
    depth = torch.where(known, gbuffer.depth.double() / (length * nearness).clamp_min(1e-300), torch.inf)
    depth = torch.where(nearness > 0, depth, torch.inf)
    return VirtualImages(depth.float(), torch.where(known[..., None], light, 0.0), known)


def _virtual(distance: Tensor, bend: Tensor) -> tuple[Tensor, Tensor]:
    """By the mirror equation, how far behind a mirror of that bend (...) what is ``distance`` (...) away is seen; and
    whether it is seen there at all."""
    near = torch.isfinite(distance)
    ratio = 1.0 + bend * torch.where(near, distance, 0.0)
    place = torch.where(near, distance / ratio.clamp_min(CROSSING), torch.where(bend > 0, 1.0 / bend, torch.inf))
    return place, (ratio > CROSSING) & (near | (bend >= 0))


def _curvature(gbuffer: GBuffer) -> Tensor:
    """(B,H,W) float64 mean curvature in 1 / scene units, > 0 where a surface bulges towards the eye; 0 at edges."""
    total = torch.zeros(gbuffer.depth.shape, dtype=torch.float64)
    count = torch.zeros_like(total)
    for axis in (1, 2):
        size = gbuffer.depth.shape[axis] - 1
        if size < 1:
            continue
        same = gbuffer.object_id.narrow(axis, 0, size) == gbuffer.object_id.narrow(axis, 1, size)
        same = same & (gbuffer.object_id.narrow(axis, 0, size) >= 0)
        step = gbuffer.position.diff(dim=axis)
        turn = gbuffer.normal.double().diff(dim=axis)
        bend = (turn * step).sum(-1) / step.square().sum(-1).clamp_min(1e-300)
        good = same & (turn.norm(dim=-1) < 0.5)
        value, weight = torch.where(good, bend, 0.0), good.double()
        for begin in (0, 1):
            total.narrow(axis, begin, size).add_(value)
            count.narrow(axis, begin, size).add_(weight)
    mean = total / count.clamp_min(1.0)
    # Normals are float32: what they cannot tell from a plane is one.
    extent = torch.where(torch.isfinite(gbuffer.depth), gbuffer.depth, 1.0).double()
    return torch.where(mean.abs() * extent > 1e-3, mean, 0.0)
