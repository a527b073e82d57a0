"""Shadows by rays: how much of a light each visible point sees. The reference of every quicker way, and slow."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.checks import check_range
from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, Light, RectLight, vectors_to


def traced_visibility(
    caster: RayCaster, light: Light, gbuffer: GBuffer, *, samples: int = 1, offset: float = 1e-4
) -> Tensor:
    """Share (B,H,W) in [0,1] of ``samples`` x ``samples`` points of a light that each pixel's surface sees.

    Lights without area take one ray whatever ``samples`` is. Rays start ``offset`` bounding-box diagonals above the
    surface and end as far before the light, which may lie on a surface itself; surfaces that face away from a sample
    do not see it; pixels without a surface see all.

    Raises:
        OptionError: ``samples`` outside [1, 256] or ``offset`` outside [0, 1].
    """
    check_range("samples", samples, 1, 256)
    check_range("offset", offset, 0.0, 1.0)
    covered = gbuffer.covered
    points = gbuffer.position[covered].double()
    normals = gbuffer.geometric_normal[covered].double()
    low, high = caster.geometry.bounds
    gap = offset * float((high - low).norm())
    origins = points + normals * gap
    total = torch.zeros(len(points), dtype=torch.float64)
    targets = light.samples(samples) if isinstance(light, RectLight) else torch.zeros(1, 3)
    for target in targets:
        faces = ((vectors_to(light, points, target) * normals).sum(-1) > 0).nonzero().reshape(-1)
        start = origins[faces]
        toward = vectors_to(light, start, target)
        # The ray parameter is in units of the direction: 1 is the light itself.
        end = 1.0 - gap / toward.norm(dim=-1).clamp_min(max(gap, 1e-300))
        limit = math.inf if isinstance(light, DirectionalLight) else end
        total[faces] += (~caster.occluded(start, toward, t_max=limit)).double()
    image = torch.ones(gbuffer.triangle.shape)
    image[covered] = (total / len(targets)).float()
    return image
