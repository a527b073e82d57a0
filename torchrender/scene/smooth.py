"""Shading normals for meshes that bring none: smooth over gentle edges, split where an edge is sharp."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.kernels.meshes.crease import corner_groups, split_vertices, sum_normals, unit_normals, weld_points

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
    faces = np.ascontiguousarray(faces, np.int64)
    points, place = weld(vertices)
    corners = faces if len(points) == len(vertices) else place[faces]
    del place
    normals = np.empty((len(faces), 3))
    unit_normals(points, corners, normals)
    group = np.empty(faces.size, np.int32)
    corner_groups(corners, normals, float(np.cos(np.radians(crease_deg))), group)
    # Groups by number in place of their first corner.
    numbers = np.cumsum(group == np.arange(faces.size, dtype=np.int32), dtype=np.int32)
    sums = np.zeros((int(numbers[-1]), 3))
    numbers -= 1
    np.take(numbers, group, out=group)
    sum_normals(points, corners, normals, group, sums)
    del points, corners, normals, numbers
    new, source, label = np.empty_like(faces), np.empty(faces.size, np.int32), np.empty(faces.size, np.int32)
    count = split_vertices(faces, group, len(vertices), new, source, label)
    return source[:count].astype(np.int64), new, _unit(sums[label[:count]]).astype(np.float32)


def weld(vertices: Array) -> tuple[Array, Array]:
    """Distinct positions (P,3) float64 in the order that they come in, and the position (V,) of each vertex."""
    # Adding zero turns -0.0 into 0.0; bits are compared, so that NaN is itself.
    points = np.ascontiguousarray(vertices, dtype=np.float64) + 0.0
    place, first = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    count = weld_points(points.view(np.int64), place, first)
    return points[first[:count]], place


def _unit(vectors: Array) -> Array:
    # Scaling first keeps the length of very small and very large vectors from under- or overflowing.
    largest = np.abs(vectors).max(axis=-1, keepdims=True)
    scaled = np.divide(vectors, largest, out=np.zeros_like(vectors), where=largest > 0)
    length = np.linalg.norm(scaled, axis=-1, keepdims=True)
    return np.divide(scaled, length, out=np.zeros_like(scaled), where=length > 0)
