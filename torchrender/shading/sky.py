"""Light from all around, ambient or of the environment: diffuse irradiance, and what glossy surfaces mirror."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.kernels.shading.records import IRRADIANCE_SIDE
from torchrender.numerics.lobe_albedo import look_up
from torchrender.numerics.texture import padded
from torchrender.scene.environment import Environment
from torchrender.scene.model import Scene

MIRRORED_SIDES = (256, 128, 128, 64, 64, 64, 32, 32, 32)
"""Pixels per side of the octahedral maps of what is mirrored; roughness grows evenly from 0 to 1."""

SKY_LOBES = Path(__file__).parents[1] / "data" / "sky_lobes.npy"
_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()


@cache
def sky_lobes() -> Tensor:
    """(S,S,12) float32, not to be written to: what :func:`sky_lobe` blends. Row = roughness times S - 1, column = root
    of the cosine times S - 1.

    Part and width of two lobes for facets that mirror all, the same for those of a dielectric of index 1.5, the share
    of the first lobe of each pair, and one over the share of what that dielectric mirrors which Fresnel's term adds.
    """
    with torch.inference_mode(False):
        return torch.from_numpy(np.load(SKY_LOBES))


class SkyLobe(NamedTuple):
    """A round lobe that stands for a part of what a glossy surface mirrors."""

    share: Tensor  # (N,) of all
    part: Tensor  # (N,) of the way from the normal to the mirrored direction, along the chord, where its middle lies
    roughness: Tensor  # (N,) of a mirror seen along its normal that has it


def sky_lobe(eye: Tensor, roughness: Tensor, grazing: Tensor) -> tuple[SkyLobe, SkyLobe]:
    """Where prefiltered maps show what glossy surfaces mirror, fitted by :mod:`torchrender.tuning.sky_lobes`.

    Args:
        eye: (N,) cosines to the eye.
        roughness: (N,).
        grazing: (N,) share of what is mirrored that Fresnel's term adds to that along the normal.
    """
    found = look_up(sky_lobes(), eye, roughness).T
    dielectric = (grazing * found[10]).clamp_max(1.0)
    first, first_width, second, second_width = torch.lerp(found[:4], found[4:8], dielectric)
    share = torch.lerp(found[8], found[9], dielectric)
    return SkyLobe(share, first, first_width * roughness), SkyLobe(1.0 - share, second, second_width * roughness)


@dataclass(frozen=True, eq=False)
class SkyMaps:
    """An environment in octahedral maps (Engelhardt and Dachsbacher 2008), each with an edge of one texel around it."""

    irradiance: Tensor  # (S+2,S+2,3) over pi
    mirrored: Tensor  # (T,3) maps of growing roughness, each row by row; no texels where nothing mirrors
    levels: Tensor  # (K,2) int64 first texel and side, without the edge, of each

    @classmethod
    def of(cls, environment: Environment, mirrors: bool, sides: Sequence[int] | None = None) -> SkyMaps:
        """The maps, made once for each environment; those of mirrored light only where something ``mirrors``.

        Args:
            sides: pixels per side of the maps of mirrored light, which are made and kept in place of the usual ones.
        """
        known = _KEPT.setdefault(environment, {})
        if mirrors not in known or sides is not None:
            with torch.inference_mode(False), torch.no_grad():
                known[mirrors] = _made(environment, (sides or MIRRORED_SIDES) if mirrors else ())
        made: SkyMaps = known[mirrors]
        return made

    @staticmethod
    def are_made(environment: Environment, mirrors: bool) -> bool:
        """Whether :meth:`of` has them ready."""
        return mirrors in _KEPT.get(environment, ())


def _made(environment: Environment, sides: Sequence[int]) -> SkyMaps:
    irradiance = environment.irradiance(octahedral_directions(IRRADIANCE_SIDE)).float() / math.pi
    parts, levels, first = [torch.zeros(0, 3)], [], 0
    for number, side in enumerate(sides):
        roughness = number / (len(sides) - 1)
        parts.append(_mirrored(environment, octahedral_directions(side), roughness).reshape(-1, 3).float())
        levels.append((first, side))
        first += len(parts[-1])
    return SkyMaps(padded(irradiance), padded(torch.cat(parts)), torch.tensor(levels, dtype=torch.int64).reshape(-1, 2))


def _mirrored(environment: Environment, direction: Tensor, roughness: float) -> Tensor:
    """Radiance (...,3) mirrored about directions (...,3), mean over the lobe of the roughness."""
    flat = direction.reshape(-1, 3)
    return environment.prefiltered(flat, torch.full((len(flat),), roughness)).reshape(direction.shape)


def octahedral_directions(side: int) -> Tensor:
    """Unit directions (S+2,S+2,3) of the texel centres of a map with an edge of one texel around it."""
    c = (torch.arange(-1, side + 1, dtype=torch.float64) + 0.5) / side * 2.0 - 1.0
    z, x = torch.meshgrid(c, c, indexing="ij")
    # Beyond an edge the map goes on as itself, turned by half a circle about the middle of that edge.
    over = x.abs() > 1
    x, z = torch.where(over, x.sign() * 2.0 - x, x), torch.where(over, -z, z)
    over = z.abs() > 1
    z, x = torch.where(over, z.sign() * 2.0 - z, z), torch.where(over, -x, x)
    y = 1.0 - x.abs() - z.abs()
    one = torch.ones_like(x)
    folded_x = torch.where(y < 0, (1.0 - z.abs()) * torch.copysign(one, x), x)
    folded_z = torch.where(y < 0, (1.0 - x.abs()) * torch.copysign(one, z), z)
    return normalize(torch.stack([folded_x, y, folded_z], dim=-1), dim=-1).float()


def octahedral_place(direction: Tensor) -> tuple[Tensor, Tensor]:
    """Place (N,), (N,) in [0,1] of unit directions (3,N) in an octahedral map: across (x) and down (z)."""
    x, y, z = direction
    scale = 1.0 / (x.abs() + y.abs() + z.abs()).clamp_min(1e-18)
    p, q = x * scale, z * scale
    one = torch.ones_like(p)
    folded = (1.0 - q.abs()) * torch.copysign(one, p), (1.0 - p.abs()) * torch.copysign(one, q)
    below = y < 0
    return torch.where(below, folded[0], p) * 0.5 + 0.5, torch.where(below, folded[1], q) * 0.5 + 0.5


def sample_map(texels: Tensor, first: Tensor, side: Tensor, place: tuple[Tensor, Tensor]) -> Tensor:
    """Bilinear values (3,N) of maps in a list of texels (T,3), each from its own map."""
    x, y = place[0] * side + 0.5, place[1] * side + 0.5
    i, j = (
        torch.minimum(x.detach().floor(), side.float()).long(),
        torch.minimum(y.detach().floor(), side.float()).long(),
    )
    u, v = (x - i)[:, None], (y - j)[:, None]
    corner = first + j * (side + 2) + i
    below = corner + side + 2
    upper = torch.lerp(texels[corner], texels[corner + 1], u)
    return torch.lerp(upper, torch.lerp(texels[below], texels[below + 1], u), v).T


class Sky:
    """What arrives at points of a scene from all around, shadows apart."""

    def __init__(self, scene: Scene) -> None:
        self.ambient = scene.ambient.float()
        self.maps: SkyMaps | None = None
        self.variable: Environment | None = None
        environment = scene.environment
        if environment is None:
            return
        if torch.is_grad_enabled() and environment.radiance.requires_grad:
            self.variable = environment
        else:
            self.maps = SkyMaps.of(environment, scene.material_table.has_physical)

    def diffuse(self, normal: Tensor) -> Tensor:
        """Irradiance over pi (3,N) at normals (3,N)."""
        ambient = self.ambient[:, None].expand(3, normal.shape[1])
        if self.variable is not None:
            return ambient + self.variable.irradiance(normal.T).T / math.pi
        if self.maps is None:
            return ambient
        side = torch.full((normal.shape[1],), IRRADIANCE_SIDE)
        place = octahedral_place(normal)
        return ambient + sample_map(self.maps.irradiance.reshape(-1, 3), torch.zeros_like(side), side, place)

    def mirrored(self, direction: Tensor, roughness: Tensor) -> Tensor:
        """Radiance (3,N) about mirrored directions (3,N), mean over the lobes of roughness (N,)."""
        ambient = self.ambient[:, None].expand(3, direction.shape[1])
        if self.variable is not None:
            return ambient + self.variable.prefiltered(direction.T, roughness).T
        if self.maps is None or not len(self.maps.levels):
            return ambient
        levels = self.maps.levels
        level = roughness.clamp(0.0, 1.0) * (len(levels) - 1)
        low = level.detach().floor().clamp_max(len(levels) - 2).long()
        place = octahedral_place(direction)
        first, second = (sample_map(self.maps.mirrored, levels[k, 0], levels[k, 1], place) for k in (low, low + 1))
        return ambient + torch.lerp(first, second, level - low)
