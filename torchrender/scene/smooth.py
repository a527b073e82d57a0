"""Shading normals for meshes that bring none: smooth over gentle edges, split where an edge is sharp."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

CREASE_DEG = 40.0
"""Faces that meet at a larger angle keep a hard edge: scans stay smooth, boxes and machine parts sharp."""

Array = np.ndarray[Any, Any]


def crease_normals(vertices: Array, faces: Array, crease_deg: float = CREASE_DEG) -> tuple[Array, Array, Array]:
    """Angle-weighted vertex normals, with vertices doubled along edges sharper than ``crease_deg``.

    Corners that share a position are grouped over the edges whose two faces meet at less than ``crease_deg``; each
    group's normal is the sum of its faces' unit normals, weighted with the face's angle at the corner (Thuermer and
    Wuethrich 1998). Positions are compared exactly, so seams of texture coordinates do not show. A face of zero area
    has no weight; a group of such faces keeps normal zero (:class:`~torchrender.scene.mesh.Geometry`).

    Args:
        vertices: (V,3) float.
        faces: (F,3) integer.

    Returns:
        ``source`` (N,) the vertex that each new vertex copies, ``faces`` (F,3) int64 in new vertices, and
        ``normals`` (N,3) float32.
    """
    if not len(faces):
        return np.arange(len(vertices)), faces.astype(np.int64), np.zeros((len(vertices), 3), np.float32)
    points, place = weld(vertices)
    corners = place[faces]
    triangles = points[corners]
    normals = _unit(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))
    group = _corner_groups(corners, normals, np.cos(np.radians(crease_deg)))
    weighted = (normals[:, None] * _corner_angles(triangles)[..., None]).reshape(-1, 3)
    count = int(group.max()) + 1
    sums = np.stack([np.bincount(group, weights=weighted[:, k], minlength=count) for k in range(3)], axis=1)
    # One new vertex per pair of old vertex and group.
    pair, inverse = np.unique(faces.reshape(-1).astype(np.int64) * count + group, return_inverse=True)
    return pair // count, inverse.reshape(-1, 3), _unit(sums)[pair % count].astype(np.float32)


def weld(vertices: Array) -> tuple[Array, Array]:
    """Distinct positions (P,3) float64 and the position (V,) of each vertex."""
    # Adding zero turns -0.0 into 0.0; bytes are compared because that is far quicker than rows of floats.
    points = np.ascontiguousarray(vertices, dtype=np.float64) + 0.0
    rows = points.view(np.dtype((np.void, 24))).reshape(-1)
    _, first, place = np.unique(rows, return_index=True, return_inverse=True)
    return points[first], place.reshape(-1)


def _unit(vectors: Array) -> Array:
    # Scaling first keeps the length of very small and very large vectors from under- or overflowing.
    largest = np.abs(vectors).max(axis=-1, keepdims=True)
    scaled = np.divide(vectors, largest, out=np.zeros_like(vectors), where=largest > 0)
    length = np.linalg.norm(scaled, axis=-1, keepdims=True)
    return np.divide(scaled, length, out=np.zeros_like(scaled), where=length > 0)


def _corner_angles(triangles: Array) -> Array:
    """(F,3) interior angles, radians."""
    to_next = _unit(np.roll(triangles, -1, axis=1) - triangles)
    to_previous = _unit(np.roll(triangles, 1, axis=1) - triangles)
    return np.arccos(np.clip((to_next * to_previous).sum(axis=-1), -1.0, 1.0))


def _corner_groups(corners: Array, normals: Array, cosine: float) -> Array:
    """(3F,) label of each corner: corners of one position that gentle edges connect share it."""
    count = len(corners)
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    key = ends.min(axis=1) * (int(corners.max()) + 1) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    first, second = order[:-1], order[1:]
    same = key[first] == key[second]
    first, second = first[same], second[same]
    gentle = (normals[first // 3] * normals[second // 3]).sum(axis=1) >= cosine
    first, second = first[gentle], second[gentle]

    def next_corner(half_edge: Array) -> Array:
        return half_edge - half_edge % 3 + (half_edge % 3 + 1) % 3

    # Half edge k starts at corner k; the partner may run along the edge in either direction.
    flat = corners.reshape(-1)
    opposite = flat[first] != flat[second]
    a = np.concatenate([first, next_corner(first)])
    b = np.concatenate(
        [np.where(opposite, next_corner(second), second), np.where(opposite, second, next_corner(second))]
    )
    graph = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(3 * count, 3 * count))
    return connected_components(graph, directed=False)[1].astype(np.int64)
