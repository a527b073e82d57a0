"""Edges of shadows that a map cannot tell: the triangles themselves decide, and filters only soften what they decide.

A map knows depths at texel centres. Where those around a point agree by a clear margin, so do the triangles; elsewhere,
along edges, at contacts and on rough surfaces, every point is tested against the triangles on its way to the light
(:mod:`torchrender.kernels.shadows.exact_edges`). The filtered value then keeps its softness but not its side: a point
that the light reaches gets the larger of s and 1 - s, any other the smaller one. What stands so far before a point that
its penumbra is wider than texels has no edge there: only the filter tells how much of a light with a size it hides.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.kernels.compile import thread_count
from torchrender.kernels.shadows.exact_edges import Casters, Cells, hide
from torchrender.kernels.shadows.shadow_lookup import SHARP
from torchrender.rays import holes_of
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

_PER_CELL = 1.0  # points, about
_FEWEST_CELLS, _MOST_CELLS = 64, 1024  # along each side; where points are few, most clusters meet none of their cells


def hidden_points(
    geometry: Geometry, cameras: Cameras, chosen: Tensor, points: Tensor, light_size: float = 0.0
) -> Tensor:
    """(2,N) bool: some triangle between the light and a point is so close to it that its shadow has an edge there; only
    others hide it.

    Args:
        cameras: V views of one light.
        chosen: (N,) int64 the view in which each point lies; -1: it is not asked about.
        points: (N,3) float64, moved off their own surface towards the light.
        light_size: width of the light, scene units; of parallel light twice the tangent of its half angle. 0: all
            shadows have edges.
    """
    hidden = torch.zeros(2, len(points), dtype=torch.bool)
    casters, holes = _casters(geometry), holes_of(geometry)
    rows = view_rows(cameras)
    for index in range(len(cameras)):
        asked = (chosen == index).nonzero().reshape(-1)
        if len(asked):
            cells, order = _cells(cameras, index, points[asked], light_size)
            found = np.zeros((2, len(asked)), np.uint8)
            hide(casters, rows[index], cameras.orthographic, holes, cells, 16 * thread_count(), found)
            hidden[:, asked[order]] = torch.from_numpy(found).bool()
    hidden[1] &= ~hidden[0]
    return hidden


def folded(visibility: Tensor, hidden: Tensor) -> Tensor:
    """Visibility (N,) on the side that ``hidden`` (2,N) bool says: the softness of an edge stays, its place is exact.

    What hides a point from afar has no edge: there the visibility stays.
    """
    edge, afar = hidden
    other = 1.0 - visibility
    sided = torch.where(edge, torch.minimum(visibility, other), torch.maximum(visibility, other))
    return torch.where(afar, visibility, sided)


def view_rows(cameras: Cameras) -> np.ndarray:
    """(V,18) float64: 3x4 world-to-view matrix, fx, fy, cx, cy, near, far."""
    k, size = cameras.intrinsics, len(cameras)
    columns = [k[:, 0, 0], k[:, 1, 1], k[:, 0, 2], k[:, 1, 2], cameras.near, cameras.far]
    table = torch.cat([cameras.camera_from_world[:, :3].reshape(size, 12), torch.stack(columns, dim=1)], dim=1)
    return numpy_view(table, np.float64)


def _cells(cameras: Cameras, index: int, points: Tensor, light_size: float) -> tuple[Cells, Tensor]:
    """The points sorted into cells of a view's image, and their order."""
    camera = cameras[index]
    place = camera.transform(points)[0]
    if not cameras.orthographic:
        place[:, :2] = place[:, :2] / place[:, 2:].clamp_min(1e-300)
    k = camera.intrinsics[0]
    side = max(_FEWEST_CELLS, min(_MOST_CELLS, round((len(points) / _PER_CELL) ** 0.5)))
    size = torch.tensor([camera.width, camera.height], dtype=torch.float64) / side
    uv = place[:, :2] * k[(0, 1), (0, 1)] + k[:2, 2]
    cell = (uv / size).floor().clamp(0, side - 1).long()
    key = cell[:, 1] * side + cell[:, 0]
    ordered, order = key.sort(stable=True)
    starts = torch.searchsorted(ordered, torch.arange(side * side + 1))
    deepest = torch.full((side * side,), -torch.inf, dtype=torch.float64)
    deepest.scatter_reduce_(0, key, place[:, 2], "amax")
    least = torch.full((len(points),), -torch.inf, dtype=torch.float64)
    if light_size > 0:
        longer = float(k[(0, 1), (0, 1)].max())
        reach = 2.0 * SHARP / (light_size * longer)
        deepest_wide = place[:, 2] - reach if camera.orthographic else place[:, 2] / (1.0 + reach * place[:, 2])
        least = torch.where(place[:, 2] > camera.near[0], deepest_wide, least)  # nearer, nothing else was asked
    made = Cells(
        place=numpy_view(place[order], np.float64),
        least=numpy_view(least[order], np.float64),
        starts=numpy_view(starts, np.int64),
        deepest=numpy_view(deepest, np.float64),
        size=numpy_view(size, np.float64),
        shape=np.array([side, side], np.int64),
    )
    return made, order


def _casters(geometry: Geometry) -> Casters:
    return Casters(
        vertices=numpy_view(geometry.vertices, np.float64),
        faces=numpy_view(geometry.faces, np.int32),
        order=numpy_view(geometry.order, np.int32),
        clusters=numpy_view(geometry.clusters, np.int64),
        bounds=numpy_view(geometry.cluster_bounds, np.float64),
    )
