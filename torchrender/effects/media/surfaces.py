"""How much of a light's way to surfaces media let through: they shadow what stands in or behind them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_tensor
from torchrender.effects.media.eye_rays import rays_along
from torchrender.effects.media.tables import MediaTable
from torchrender.kernels.media.records import Beams
from torchrender.kernels.media.ways import clip_rays, ways_through
from torchrender.numerics.lobe import frame
from torchrender.scene.light import DirectionalLight, Light, vectors_to
from torchrender.scene.medium import Medium

STEPS = 32
"""Through grids."""

HEIGHTS = (0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263)
WEIGHTS = (0.17392742256872692, 0.32607257743127307, 0.32607257743127307, 0.17392742256872692)
"""Gauss-Legendre nodes and weights over [0,1], of the squared cosine: light from everywhere arrives evenly over it."""

AROUND = 5
"""Directions around the normal for each of them."""

CHUNK = 1 << 16
"""Rays at a time."""


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


def surroundings_left(
    media: Sequence[Medium], position: Tensor, normal: Tensor, covered: Tensor, *, scattered: bool = True
) -> Tensor | None:
    """Share (B,H,W,C) of even light from everywhere that arrives at surfaces through media; None: all, everywhere.

    The cosine-weighted mean over the hemisphere, by 20 directions, of ``T + (1 - T) s / e``, for a transmittance T
    along a way through mean scattering s and extinction e: what an eye at the surface would see of surroundings of
    radiance one, which reach every place of the media as if nothing stood in their way. Media that absorb nothing
    take nothing from it. C is 1 where media have no colour, else 3. Solids are left out: see ambient visibility.

    Args:
        position: (B,H,W,3) float64. normal: (B,H,W,3) unit. covered: (B,H,W) bool: there is a surface.
        scattered: media scatter surroundings; False: ``T`` alone.
    """
    check_tensor("position", position, ("B", "H", "W", 3))
    points, normals = position[covered].double(), normal[covered].double()
    if not len(points):
        return None
    table = MediaTable.of(media, (points.amin(0) + points.amax(0)) / 2)
    lost = bool((torch.stack([m.absorption for m in table.media]) > 0).any()) if len(table) else False
    if not len(table) or (scattered and not lost):
        return None
    both = torch.stack([table.extinction, torch.stack([m.scattering for m in table.media])])
    both = both[..., :1] if bool((both == both[..., :1]).all()) else both
    shares = [
        _share(table, points[rows], normals[rows], both[0], both[1] if scattered else None)
        for rows in torch.arange(len(points)).split(CHUNK // (len(HEIGHTS) * AROUND))
    ]
    found = torch.cat(shares)
    if not bool((found < 1.0).any()):
        return None
    out = torch.ones(*covered.shape, both.shape[-1])
    out[covered] = found
    return out


def _share(table: MediaTable, points: Tensor, normals: Tensor, extinction: Tensor, scattering: Tensor | None) -> Tensor:
    """(N,C) of :func:`surroundings_left` at places (N,3); extinction and scattering of media (M,C)."""
    squared = torch.tensor(HEIGHTS).repeat_interleave(AROUND)
    weight = torch.tensor(WEIGHTS).repeat_interleave(AROUND) / AROUND
    count = len(squared)
    angle = torch.arange(count) * (2.0 * math.pi / AROUND * (1.0 + 1.0 / count))  # rings are turned
    across = (1.0 - squared).sqrt()
    local = torch.stack([across * angle.cos(), across * angle.sin(), squared.sqrt()], dim=-1)
    normals = normals.float()
    directions = (local @ torch.stack([*frame(normals), normals], dim=1)).reshape(-1, 3)
    near = (points - table.origin).float().repeat_interleave(count, dim=0)
    beams = Beams(view(near, np.float32), view(directions, np.float32), np.empty((len(near), 2), np.float32))
    clip_rays(table.arrays, beams, np.full(len(near), 1e30, np.float32))
    ways = torch.zeros(len(near), len(table))
    ways_through(table.arrays, beams, STEPS, ways.numpy())
    depth = ways @ extinction
    lost = -torch.expm1(-depth)
    if scattering is not None:
        lost = lost * (1.0 - (ways @ scattering) / depth.clamp_min(1e-30)).clamp_min(0.0)
    return 1.0 - torch.einsum("nkc,k->nc", lost.reshape(len(points), count, -1), weight)
