"""How much of a medium lies between places."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.effects.media.eye_rays import rays_along
from torchrender.effects.media.tables import MediaTable
from torchrender.kernels.media.ways import ways_through
from torchrender.photo.fog.options import FogMedium
from torchrender.scene.medium import Medium

GRID_STEPS = 32
"""Steps of a way through a grid."""


@dataclass(frozen=True, eq=False)
class Air:
    """The density of a medium: one everywhere, or a grid over a box, with nothing outside of it."""

    density: Tensor | None  # (D,H,W)
    low: Tensor  # (3,) float64
    high: Tensor  # (3,) float64

    @classmethod
    def of(cls, medium: FogMedium, low: Tensor, high: Tensor) -> Air:
        """Of a medium that fills a box."""
        return cls(medium.density, low.double(), high.double())

    def ways(self, origins: Tensor, directions: Tensor, lengths: Tensor) -> Tensor:
        """(N,) float32 integral of the density along rays.

        Args:
            origins: (N,3) float64, or (1,3) for all. directions: (N,3) unit.
            lengths: (N,) metres, +inf allowed for grids.
        """
        if self.density is None:
            return lengths.float()
        count = len(directions)
        medium = Medium(
            low=self.low.float(), high=self.high.float(), density=self.density.float(), scattering=torch.ones(3)
        )
        table = MediaTable.of([medium], self.low)
        if not len(table) or not count:
            return torch.zeros(count)
        rays = rays_along(origins.expand(count, 3), directions, lengths, table)
        found = torch.zeros(count, 1)
        ways_through(table.arrays, rays.beams, GRID_STEPS, found.numpy())
        return found[:, 0]

    def between(self, start: Tensor, end: Tensor) -> Tensor:
        """(...) float32 integral of the density between places (...,3)."""
        offset = (end - start).double()
        length = offset.norm(dim=-1)
        if self.density is None:
            return length.float()
        unit = offset / length.clamp_min(1e-12)[..., None]
        flat = self.ways(start.double().expand_as(offset).reshape(-1, 3), unit.reshape(-1, 3), length.reshape(-1))
        return flat.reshape(length.shape)

    def at(self, places: Tensor) -> Tensor:
        """(...) float32 density at places (...,3)."""
        if self.density is None:
            return torch.ones(places.shape[:-1])
        where = ((places - self.low) / (self.high - self.low) * 2 - 1).float().reshape(1, -1, 1, 1, 3)
        found = torch.nn.functional.grid_sample(
            self.density.float()[None, None], where, mode="bilinear", padding_mode="border", align_corners=False
        ).reshape(places.shape[:-1])
        inside = ((places >= self.low) & (places <= self.high)).all(dim=-1)
        return torch.where(inside, found, 0.0)


def held_back(extinction: Tensor, length: Tensor) -> Tensor:
    """``(1 - exp(-a t)) / a`` for any sign of a; t where a is 0. Shapes broadcast."""
    lost = extinction * length
    small = lost.abs() < 1e-4
    safe = torch.where(small, 1.0, lost)
    share = torch.where(small, 1.0 - lost / 2 + lost * lost / 6, -torch.expm1(-safe) / safe)
    return share * length
