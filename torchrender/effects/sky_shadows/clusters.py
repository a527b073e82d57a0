"""What spheres are fitted to: a solid of cells, points in it and on its surface; and the sphere of a cluster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.sky_shadows.options import SphereOptions
from torchrender.kernels.sky_shadows.fit import Solid, outside_volume, refit, solid_of

Array = np.ndarray[Any, Any]

NEIGHBOURS = 12
MOST_POINTS = 24_000
"""Points that are clustered in each round; the others join the clusters that they fit best in the end."""

REFITS = 4
"""Rounds of line searches after each clustering: the next one goes on."""


@dataclass(frozen=True, eq=False)
class Model:
    """A mesh, ready for spheres."""

    solid: Solid
    points: Array  # (N,3) that are clustered
    neighbours: Array  # (N,12) int64
    width: float  # of the steps of volume tables
    steps: int
    volume: float


@dataclass(frozen=True, eq=False)
class State:
    """Spheres, and the points that each has to cover."""

    centres: Array  # (S,3)
    radii: Array  # (S,) 0: not needed
    labels: Array  # (N,) int64
    outside: Array  # (S,) volume of each sphere outside

    @property
    def error(self) -> float:
        """E: all that stands out."""
        return float(self.outside.sum())


def model_of(vertices: Tensor, faces: Tensor, surface: Array, options: SphereOptions) -> tuple[Model, Array]:
    """The mesh (V,3), (F,3) with points (N,3) on its surface; and all points inside it (M,3)."""
    from scipy.spatial import cKDTree

    from torchrender.voxels.grid import make_grid  # pictures need none of it
    from torchrender.voxels.solid import SolidOptions, voxelize_solid

    grid = make_grid(vertices[None], options.resolution)
    voxels, _ = voxelize_solid(vertices[None], faces, grid, SolidOptions(method="winding", warn=False))
    filled = voxels.dense()[0].to(torch.uint8).numpy()
    cell, origin = float(grid.cell[0]), grid.origin[0].numpy()
    solid = solid_of(filled, origin, cell)
    k, j, i = np.nonzero(filled)
    inner = origin + (np.stack([i, j, k], axis=1) + 0.5) * cell
    rng = np.random.default_rng(options.seed)
    within = _thinned(inner, MOST_POINTS // 5, rng)
    points = np.concatenate([within, _thinned(surface, MOST_POINTS - len(within), rng)])
    count = min(NEIGHBOURS + 1, len(points))
    neighbours = cKDTree(points).query(points, count)[1].reshape(len(points), count)
    width = 0.25 * cell
    reach = float(np.linalg.norm(np.ptp(surface, axis=0))) + 2 * cell
    volume = len(inner) * cell**3
    model = Model(
        solid, points, np.ascontiguousarray(neighbours.astype(np.int64)), width, int(reach / width) + 3, volume
    )
    return model, inner


def _thinned(points: Array, most: int, rng: np.random.Generator) -> Array:
    return points if len(points) <= most else points[np.sort(rng.choice(len(points), most, replace=False))]


def sphere_of(model: Model, centre: Array, points: Array) -> tuple[Array, float, float]:
    """The sphere about points that stands out least, from the best of three places."""
    outer = np.ascontiguousarray(outermost(points))
    places = (centre, points.mean(axis=0), 0.5 * (points.min(axis=0) + points.max(axis=0)))

    def cost(place: Array) -> float:
        reach = float(np.sqrt(((outer - place) ** 2).sum(axis=1).max()))
        return float(outside_volume(model.solid, place[0], place[1], place[2], reach))

    place = np.array(min(places, key=cost), dtype=np.float64)
    least = float(refit(model.solid, outer, place, REFITS))
    return place, float(np.sqrt(((points - place) ** 2).sum(axis=1).max())), max(least, 0.0)


def outermost(points: Array) -> Array:
    """Corners of the convex hull: one of them is farthest from any place."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 32:
        return points
    try:
        hull: Array = points[ConvexHull(points).vertices]
    except QhullError:  # flat
        return points
    return hull
