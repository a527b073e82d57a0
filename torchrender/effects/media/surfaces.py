"""How much of a light's way to surfaces media let through: they shadow what stands in or behind them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchrender.checks import check_tensor
from torchrender.effects.media.eye_rays import rays_along
from torchrender.effects.media.tables import MediaTable
from torchrender.kernels.media.ways import ways_through
from torchrender.scene.light import DirectionalLight, Light, vectors_to
from torchrender.scene.medium import Medium

STEPS = 32
"""Through grids."""


def light_transmittance(
    media: Sequence[Medium], lights: Sequence[Light], position: Tensor, covered: Tensor
) -> Tensor | None:
    """Transmittance (B,L,H,W,C) from lights to surfaces; 1 where there is none. None: media lie on no way.

    Rectangles stand for their centres. C is 1 where extinction has no colour, else 3.

    Args:
        position: (B,H,W,3) float64. covered: (B,H,W) bool: there is a surface.
    """
    check_tensor("position", position, ("B", "H", "W", 3))
    check_tensor("covered", covered, tuple(position.shape[:-1]))
    points = position[covered].double()
    if not len(points):
        return None
    table = MediaTable.of(media, (points.amin(0) + points.amax(0)) / 2)
    if not len(table):
        return None
    grey = bool((table.extinction == table.extinction[:, :1]).all())
    extinction = table.extinction[:, :1] if grey else table.extinction
    out = torch.ones(len(covered), len(lights), *covered.shape[1:], extinction.shape[1])
    changed = False
    for number, light in enumerate(lights):
        toward = vectors_to(light, points)
        length = toward.norm(dim=-1)
        direction = toward / length.clamp_min(1e-300)[:, None]
        ends = torch.full_like(length, math.inf) if isinstance(light, DirectionalLight) else length
        rays = rays_along(points, direction, ends, table)
        ways = torch.zeros(len(points), len(table))
        ways_through(table.arrays, rays.beams, STEPS, ways.numpy())
        if bool((ways > 0).any()):
            changed = True
            image = torch.ones(*covered.shape, extinction.shape[1])
            image[covered] = torch.exp(-(ways @ extinction))
            out[:, number] = image
    return out if changed else None
