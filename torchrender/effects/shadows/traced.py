"""Shadows by rays: how much of a light each visible point sees. The reference of every quicker way, and slow."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, position_error
from torchrender.checks import check_range
from torchrender.effects.shadows.receivers import shadow_receivers
from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, Light, RectLight, vectors_to

_AT_ONCE = 1 << 17  # pairs of a light and a pixel
_END = 1e-6  # rays end this share of their length before the light


def traced_visibility(
    caster: RayCaster, light: Light, gbuffer: GBuffer, *, samples: int = 1, offset: float = 1.0
) -> Tensor:
    """Share (B,H,W) in [0,1] of ``samples`` x ``samples`` points of a light that each pixel's surface sees.

    Only points of the light above the surface's plane count, above and below the line: what lies below it sends no
    light there, shadows or not. Surfaces that face away from the whole light see none of it; pixels without a surface
    see all. Lights without area take one ray whatever ``samples`` is.

    Rays start off the surface by what its position may be off, times ``offset``: a share of the distance to the eye,
    from which float32 depth was made. The size of the scene does not matter. They end as little before the light, which
    may lie on a surface itself.

    Raises:
        OptionError: ``samples`` outside [1, 256] or ``offset`` outside [0, 1e6].
    """
    check_range("samples", samples, 1, 256)
    check_range("offset", offset, 0.0, 1e6)
    covered = gbuffer.covered
    points, normals, origins = _starts(gbuffer, offset)
    seen = torch.zeros(len(points), dtype=torch.float64)
    above = torch.zeros(len(points), dtype=torch.float64)
    targets = light.samples(samples, staggered=True) if isinstance(light, RectLight) else torch.zeros(1, 3)
    for target in targets:
        faces = ((vectors_to(light, points, target) * normals).sum(-1) > 0).nonzero().reshape(-1)
        start = origins[faces]
        toward = vectors_to(light, start, target)
        here = toward.norm(dim=-1) > 0  # on the light itself nothing lies between
        hidden = torch.zeros(len(faces), dtype=torch.bool)
        limit = math.inf if isinstance(light, DirectionalLight) else ray_end(_place(light), toward)[here]
        hidden[here] = caster.occluded(start[here], toward[here], t_max=limit)
        seen[faces] += (~hidden).double()
        above[faces] += 1.0
    image = torch.ones(gbuffer.triangle.shape)
    image[covered] = (seen / above.clamp_min(1.0)).float()
    return image


def traced_visibilities(caster: RayCaster, lights: Mapping[int, Light], gbuffer: GBuffer) -> dict[int, Tensor]:
    """Visibility (B,H,W) of each of these lights without area, as :func:`traced_visibility`.

    However many they are: rays of several are cast at once.
    """
    covered = gbuffer.covered
    points, normals, origins = _starts(gbuffer)
    numbers, found = sorted(lights), dict[int, Tensor]()
    count = max(1, _AT_ONCE // max(1, len(points)))
    for part in (numbers[at : at + count] for at in range(0, len(numbers), count)):
        some = [lights[n] for n in part]
        facing = (torch.stack([vectors_to(light, points) for light in some]) * normals).sum(-1) > 0
        toward = torch.stack([vectors_to(light, origins) for light in some])
        which, row = (facing & (toward != 0).any(-1)).nonzero().unbind(-1)  # on the light itself nothing lies between
        rays = toward[which, row]
        limit = torch.full((len(rays),), math.inf, dtype=torch.float64)
        ends = torch.tensor([not isinstance(light, DirectionalLight) for light in some])[which]
        coarse = [0.0 if isinstance(light, DirectionalLight) else _coarse(_place(light)) for light in some]
        limit[ends] = _end(torch.tensor(coarse, dtype=torch.float64)[which[ends]], rays[ends])
        facing[which, row] = ~caster.occluded(origins[row], rays, t_max=limit)
        images = torch.ones(len(part), *gbuffer.triangle.shape)
        images[:, covered] = facing.float()
        found |= dict(zip(part, images.unbind(0), strict=True))
    return found


def _starts(gbuffer: GBuffer, offset: float = 1.0) -> tuple[Tensor, Tensor, Tensor]:
    """Points, normals, and where rays start off them (N,3) float64, of the covered pixels."""
    covered = gbuffer.covered
    points, normals = (image[covered].double() for image in shadow_receivers(gbuffer))
    gap = offset * position_error(gbuffer, covered.reshape(-1).nonzero().reshape(-1))
    return points, normals, points + normals * gap[:, None]


def ray_end(place: Tensor, toward: Tensor) -> Tensor:
    """Where rays (N,3) to lights at ``place`` (...,3) stop, in their own lengths: 1 is the light itself."""
    return _end(_coarse(place), toward)


def _coarse(place: Tensor) -> float:
    """Units by which a light's place may be rounded."""
    return 4.0 * torch.finfo(place.dtype).eps * float(place.abs().max())


def _end(coarse: Tensor | float, toward: Tensor) -> Tensor:
    return (1.0 - _END - coarse / toward.norm(dim=-1).clamp_min(1e-300)).clamp_min(0.0)


def _place(light: Light) -> Tensor:
    assert not isinstance(light, DirectionalLight)
    return light.corner if isinstance(light, RectLight) else light.position
