"""Polygons into triangles: fans where those cover them, ear clipping (mapbox_earcut) elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]


def triangulate(points: Array, corners: Array, counts: Array) -> tuple[Array, Array]:
    """Triangles of P polygons.

    Args:
        points: (V,3) float64.
        corners: (C,) int64 point of each corner, polygon after polygon.
        counts: (P,) int64 corners of each polygon; those with less than three give nothing.

    Returns:
        ``places`` (T,3) int64 into ``corners``, and ``owner`` (T,) int64 the polygon of each triangle, both in the
        order of the polygons.
    """
    if len(counts) and (counts == 3).all():
        return np.arange(len(corners)).reshape(-1, 3), np.arange(len(counts))
    starts = np.cumsum(counts) - counts
    places, owners = [], []
    for count in np.unique(counts[counts >= 3]).tolist():
        rows = np.flatnonzero(counts == count)
        first = starts[rows]
        fan = np.stack([[0, k, k + 1] for k in range(1, count - 1)])
        if count == 3:
            places.append(first[:, None] + fan[0])
            owners.append(rows)
            continue
        whole = points[corners[first[:, None] + np.arange(count)]]
        good, turned = _covers(whole, fan), np.zeros(len(rows), bool)
        if count == 4:  # the other diagonal
            turned = ~good & _covers(whole, (fan + 1) % 4)
        for chosen, triangles in ((good, fan), (turned, (fan + 1) % count)):
            places.append((first[chosen, None, None] + triangles).reshape(-1, 3))
            owners.append(rows[chosen].repeat(count - 2))
        for row in np.flatnonzero(~good & ~turned).tolist():
            triangles = clip_ears(whole[row])
            if not len(triangles):  # without area: any cover will do
                triangles = fan
            places.append(first[row] + triangles)
            owners.append(np.full(len(triangles), rows[row]))
    if not places:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    place, owner = np.concatenate(places), np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return place[order].astype(np.int64), owner[order]


def _covers(polygons: Array, fan: Array) -> Array:
    """(M,) bool: the triangles ``fan`` (n-2,3) of polygons (M,n,3) all face the polygon's side, so that none folds."""
    with np.errstate(over="ignore", invalid="ignore"):
        normal = newell(polygons)
        a, b, c = (polygons[:, fan[:, k]] for k in range(3))
        facing = (np.cross(b - a, c - a) * normal[:, None]).sum(axis=-1)
        size = np.abs(normal).max(axis=1, keepdims=True) ** 2
        folded = facing < -1e-12 * size
    covered: Array = ~folded.any(axis=1)
    return covered


def newell(polygons: Array) -> Array:
    """(M,3) twice the area vectors of polygons (M,n,3), whether flat or not. Source: Newell's method."""
    relative = polygons - polygons[:, :1]
    total: Array = np.cross(relative, np.roll(relative, -1, axis=1)).sum(axis=1)
    return total


def clip_ears(polygon: Array) -> Array:
    """(T,3) corners of the triangles of a polygon (n,3), facing its side; empty where it has no area."""
    import mapbox_earcut

    normal = newell(polygon[None])[0]
    axis = int(np.abs(normal).argmax())
    if not np.isfinite(normal).all() or normal[axis] == 0:
        return np.zeros((0, 3), np.int64)
    others = [(axis + 1) % 3, (axis + 2) % 3]
    flat = np.ascontiguousarray(polygon[:, others] - polygon[0, others])
    flat /= np.abs(flat).max()
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32)).astype(np.int64).reshape(-1, 3)
    a, b, c = (flat[found[:, k]] for k in range(3))
    side = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    turned = side * np.sign(normal[axis]) < 0
    found[turned] = found[turned][:, ::-1]
    return found
