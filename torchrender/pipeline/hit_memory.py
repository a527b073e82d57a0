"""Light of what rays hit, over the pictures of a sequence in which something moves.

The same ray that meets the same place brings the same light, unless that place belongs to what moved or looks otherwise
now, or something that moved was or is on the way from there to a light, or near enough to hide light from everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.effects.reflections.reflectors import ReflectedRays
from torchrender.pipeline.standing import Swept, is_still
from torchrender.scene.model import Scene

MOST = 1 << 18
"""Hits that are remembered."""
_FACTORS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)


@dataclass(frozen=True, eq=False)
class Remembered:
    """Light of N hits."""

    key: Tensor  # (N,) int64
    position: Tensor  # (N,3) float64
    triangle: Tensor  # (N,) int64
    radiance: Tensor  # (N,3)


@dataclass(eq=False)
class HitMemory:
    """What a picture's hits sent; ``known`` is of the picture before, as far as it still holds, sorted by key.

    Threads may use it at once: what one of them adds is one entry of a list.
    """

    known: Remembered | None = None
    added: list[Remembered] = field(default_factory=list)
    count: int = 0

    def following(self, before: Scene, scene: Scene, moved: Swept, reach: float, *, hard: bool) -> HitMemory:
        """For a picture of a scene in which something has moved.

        Args:
            reach: scene units within which what moved may hide light from everywhere; negative: there is none.
            hard: lights with an area cast shadows as if they had none.
        """
        parts = list(self.added)
        if not parts:
            return HitMemory()
        names = ("key", "position", "triangle", "radiance")
        key, position, triangle, radiance = (torch.cat([getattr(p, n) for p in parts]) for n in names)
        holds = moved.misses(position, scene.lights, scene.diagonal, hard=hard).all(1)
        holds &= is_still(scene, triangle, moved.meshes)
        if reach >= 0 and before.diagonal == scene.diagonal:
            holds &= moved.beyond(position, reach)
        elif reach >= 0:
            holds[:] = False
        rows = holds.nonzero().reshape(-1)[:MOST]
        order = rows[key[rows].argsort()]
        return HitMemory(Remembered(key[order], position[order], triangle[order], radiance[order]))

    def find(self, key: Tensor) -> tuple[Tensor, Tensor]:
        """Rows of keys (N,) that are known, and their radiance."""
        if self.known is None or not len(self.known.key):
            return torch.zeros(0, dtype=torch.int64), torch.zeros(0, 3)
        place = torch.searchsorted(self.known.key, key).clamp_max(len(self.known.key) - 1)
        rows = (self.known.key[place] == key).nonzero().reshape(-1)
        return rows, self.known.radiance[place[rows]]

    def add(self, key: Tensor, position: Tensor, triangle: Tensor, radiance: Tensor) -> None:
        """Remember these; nothing once there are too many."""
        if self.count < MOST and not radiance.requires_grad:
            self.count += len(key)
            self.added.append(Remembered(key, position, triangle, radiance))


def keys_of(rays: ReflectedRays, hits: RayHits, rows: Tensor) -> Tensor:
    """(N,) int64: numbers that differ where rays or what they hit do, but for one pair in 2^64."""
    values = [*rays.origin[rows].unbind(1), *rays.direction[rows].unbind(1), rays.width[rows], rays.spread[rows]]
    bits = [v.double().contiguous().view(torch.int64) for v in (*values, hits.t[rows])]
    key = hits.triangle[rows] * 2 + int(rays.many)
    for number, part in enumerate(bits):
        key = _mixed(key ^ part, number)
    return key


def _mixed(key: Tensor, number: int) -> Tensor:
    """64 bits well stirred, by multiplication that wraps and shifts."""
    factor = _FACTORS[number % len(_FACTORS)]
    key = (key ^ ((key >> 32) & 0xFFFFFFFF)) * (factor - (1 << 64) if factor >= 1 << 63 else factor)
    return key ^ ((key >> 29) & 0x7FFFFFFFF)
