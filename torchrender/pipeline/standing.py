"""What stands still from picture to picture while something moves, and what that leaves as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.kernels.shadows.swept import Sources, untouched
from torchrender.scene.light import DirectionalLight, Light, RectLight
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

MARGIN = 0.01
"""Of a scene's diagonal by which boxes of what moved are larger: filters of shadow maps look beside a point."""


@dataclass(frozen=True, eq=False)
class Swept:
    """What moved between two scenes of the same meshes, and the room that it took before and takes now."""

    meshes: frozenset[int]  # numbers of those that moved
    box: Tensor  # (2,3) float64

    def misses(self, points: Tensor, lights: Sequence[Light], diagonal: float, *, hard: bool = False) -> Tensor:
        """(N,L) bool: nothing that moved is on the way from points (N,3) to each light.

        ``hard``: to the middle of those with an area, where shadows are looked up as if they had none.
        """
        out = np.ones((len(points), len(lights)), np.bool_)
        if self.meshes and len(lights):
            margins = (MARGIN * diagonal, 4.0 * diagonal)
            untouched(view(points, np.float64), _sources(lights, hard), view(self.box, np.float64), margins, out)
        return torch.from_numpy(out)

    def beyond(self, points: Tensor, reach: float) -> Tensor:
        """(N,) bool: nothing that moved is within ``reach`` of points (N,3)."""
        if not self.meshes:
            return torch.ones(len(points), dtype=torch.bool)
        apart = (self.box[0] - points).clamp_min(0.0) + (points - self.box[1]).clamp_min(0.0)
        return apart.square().sum(-1) > reach**2


def same_faces(before: Sequence[Mesh], after: Sequence[Mesh]) -> bool:
    """The same meshes, at other places at most."""
    return len(before) == len(after) and all(a.faces is b.faces for a, b in zip(before, after, strict=True))


def swept(before: Sequence[Mesh], after: Sequence[Mesh]) -> Swept | None:
    """What moved; None where meshes came, went or changed otherwise."""
    if not same_faces(before, after):
        return None
    moved = [n for n, (a, b) in enumerate(zip(before, after, strict=True)) if a is not b]
    places = [m[n].vertices.detach().double() for n in moved for m in (before, after) if len(m[n].vertices)]
    if not places:
        return Swept(frozenset(moved), torch.zeros(2, 3, dtype=torch.float64))
    low, high = (torch.stack([getattr(p, side)(0) for p in places]) for side in ("amin", "amax"))
    return Swept(frozenset(moved), torch.stack([low.amin(0), high.amax(0)]))


def is_still(scene: Scene, triangles: Tensor, moved: frozenset[int]) -> Tensor:
    """(N,) bool: triangles (N,), -1 for none, that belong to no mesh that moved."""
    still = torch.ones(scene.geometry.triangle_count + 1, dtype=torch.bool)
    runs = scene.geometry.runs.tolist()
    for number in moved:
        still[runs[number] : runs[number + 1]] = False
    return still[triangles]


def _sources(lights: Sequence[Light], hard: bool) -> Sources:
    places, extents = (torch.zeros(len(lights), n, dtype=torch.float64) for n in (4, 3))
    for number, light in enumerate(lights):
        if isinstance(light, DirectionalLight):
            places[number, :3] = -light.direction
        else:
            places[number, :3] = light.centre if isinstance(light, RectLight) else light.position
            places[number, 3] = 1.0
        if isinstance(light, RectLight) and not hard:
            extents[number] = (light.edge_u.abs() + light.edge_v.abs()).double() / 2
    return Sources(places.numpy(), extents.numpy())
