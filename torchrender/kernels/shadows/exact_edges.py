"""Points that a shadow map leaves in doubt, settled by the triangles themselves: which of them does one hide?

The points wait in the cells of a coarse image of the light; every triangle is tested against those in the cells that it
covers. No depth is stored and no ray is traced: the answer is that of rays from the points to the light.

Sources: Johnson, Lee, Burns and Mark, The irregular z-buffer, 2005; Wyman, Hoetzlein and Lefohn, Frustum-traced raster
shadows, 2015.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.fragments import is_hole
from torchrender.kernels.shadows.shadow_receiver import CX, CY, FX, FY

_CLIP = 1e-9  # of a triangle's depth: nearer to the light's plane its image is cut off


class Casters(NamedTuple):
    """The triangles of a scene."""

    vertices: np.ndarray  # (V,3) float64
    faces: np.ndarray  # (F,3) int32
    order: np.ndarray  # (F,) int32 triangle ids, cluster by cluster
    clusters: np.ndarray  # (C,2) int64
    bounds: np.ndarray  # (C,2,3) float64


class Cells(NamedTuple):
    """M points of one view, sorted by the cell of its image that they lie in."""

    place: np.ndarray  # (M,3) float64 x, y (perspective: x/z, y/z) and depth in the view's frame
    starts: np.ndarray  # (rows*columns+1,) int64
    least: np.ndarray  # (M,) float64 depth before which a triangle's penumbra is no edge
    deepest: np.ndarray  # (rows*columns,) float64 largest depth of the points of a cell; -inf
    size: np.ndarray  # (2,) float64 of a cell, texels along u and v
    shape: np.ndarray  # (2,) int64 rows, columns


@kernel(inline=True)
def _misses(casters, c, view, orthographic, cells, deepest):
    """No triangle of a cluster can hide any point: beside the cells, or behind all points."""
    low, high = casters.bounds[c, 0], casters.bounds[c, 1]
    x, y, z = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2])
    hx, hy, hz = high[0] - x, high[1] - y, high[2] - z
    middle, reach = np.zeros(3), np.zeros(3)
    for k in range(3):
        p, q, r = view[4 * k], view[4 * k + 1], view[4 * k + 2]
        middle[k] = p * x + q * y + r * z + view[4 * k + 3]
        reach[k] = (abs(p) * hx + abs(q) * hy + abs(r) * hz) * (1.0 + 1e-9)
    if middle[2] - reach[2] > deepest:
        return True
    if not orthographic and middle[2] + reach[2] <= 0.0:
        return True
    for k in range(2):
        focal, centre = view[FX + k], view[CX + k]
        end = cells.size[k] * cells.shape[1 - k]
        if orthographic:
            at, half = focal * middle[k] + centre, focal * reach[k]
            if at + half < 0.0 or at - half > end:
                return True
            continue
        # u >= 0 and u <= end are planes through the light.
        for sign, border in ((1.0, 0.0), (-1.0, end)):
            a, b = sign * focal, sign * (centre - border)
            p = a * view[4 * k] + b * view[8]
            q = a * view[4 * k + 1] + b * view[9]
            r = a * view[4 * k + 2] + b * view[10]
            value = a * middle[k] + b * middle[2]
            if value + (abs(p) * hx + abs(q) * hy + abs(r) * hz) * (1.0 + 1e-9) < 0.0:
                return True
    return _before_none(middle, reach, view, orthographic, cells)


@kernel(inline=True)
def _before_none(middle, reach, view, orthographic, cells):
    """Of all cells that a box of a view may cover none has a point behind its front: cells are looked at one by one."""
    near, far = middle[2] - reach[2], middle[2] + reach[2]
    if not orthographic and near <= _CLIP * far:
        return False
    begin, end = np.zeros(2, np.int64), np.zeros(2, np.int64)
    for k in range(2):
        low, high = middle[k] - reach[k], middle[k] + reach[k]
        if not orthographic:
            low, high = min(low / near, low / far), max(high / near, high / far)
        begin[k], end[k] = _cell_range(low, high, view[FX + k], view[CX + k], cells.size[k], cells.shape[1 - k])
    columns = cells.shape[1]
    for row in range(begin[1], end[1]):
        for column in range(begin[0], end[0]):
            if cells.deepest[row * columns + column] > near:
                return False
    return True


@kernel(inline=True)
def _corners(casters, t, view, corners):
    """The corners of a triangle in the view's frame, in ``corners`` (3,3); smallest and largest depth."""
    near, far = np.inf, -np.inf
    for k in range(3):
        v = casters.faces[t, k]
        x, y, z = casters.vertices[v, 0], casters.vertices[v, 1], casters.vertices[v, 2]
        for m in range(3):
            corners[k, m] = view[4 * m] * x + view[4 * m + 1] * y + view[4 * m + 2] * z + view[4 * m + 3]
        near, far = min(near, corners[k, 2]), max(far, corners[k, 2])
    return near, far


@kernel(inline=True)
def _image_box(corners, near, far, orthographic):
    """Bounds of a triangle in the image plane: what lies before the light alone."""
    low_a = low_b = np.inf
    high_a = high_b = -np.inf
    cut = _CLIP * far
    for k in range(3):
        x, y, z = corners[k, 0], corners[k, 1], corners[k, 2]
        if orthographic or z > cut:
            w = 1.0 if orthographic else 1.0 / z
            low_a, high_a = min(low_a, x * w), max(high_a, x * w)
            low_b, high_b = min(low_b, y * w), max(high_b, y * w)
        if not orthographic and near <= cut:
            n = (k + 1) % 3
            other = corners[n, 2]
            if (z > cut) != (other > cut):
                share = (cut - z) / (other - z)
                a, b = (x + share * (corners[n, 0] - x)) / cut, (y + share * (corners[n, 1] - y)) / cut
                low_a, high_a, low_b, high_b = min(low_a, a), max(high_a, a), min(low_b, b), max(high_b, b)
    return low_a, high_a, low_b, high_b


@kernel(inline=True)
def _cell_range(low, high, focal, centre, size, count):
    """First and one past the last cell along one axis."""
    first = (focal * low + centre) / size
    last = (focal * high + centre) / size
    if not (last >= 0.0 and first < count):
        return 0, 0
    return np.int64(max(math.floor(first), 0.0)), np.int64(min(math.floor(last), count - 1.0)) + 1


@kernel(inline=True)
def _weights(c, a, b, orthographic):
    """Three numbers of one sign where the light's ray through (a, b) meets the triangle, and its depth there.

    Those of two triangles at a shared edge are exact negatives of each other: no light slips through.
    """
    if orthographic:
        x0, y0, x1, y1, x2, y2 = c[0, 0] - a, c[0, 1] - b, c[1, 0] - a, c[1, 1] - b, c[2, 0] - a, c[2, 1] - b
        u, v, w = x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
        total = u + v + w
        return u, v, w, (u * c[0, 2] + v * c[1, 2] + w * c[2, 2]) / total if total != 0.0 else np.inf
    x0, y0, x1, y1, x2, y2 = (
        c[0, 0] - a * c[0, 2],
        c[0, 1] - b * c[0, 2],
        c[1, 0] - a * c[1, 2],
        c[1, 1] - b * c[1, 2],
        c[2, 0] - a * c[2, 2],
        c[2, 1] - b * c[2, 2],
    )
    u, v, w = x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
    total = u + v + w
    return u, v, w, (u * c[0, 2] + v * c[1, 2] + w * c[2, 2]) / total if total != 0.0 else np.inf


@kernel(inline=True)
def _hide_points(casters, t, corners, cell, how, cells, holes, hidden):
    """Mark the points of a cell that a triangle hides, beyond their least depth or before it."""
    orthographic, near = how
    for i in range(cells.starts[cell], cells.starts[cell + 1]):
        if hidden[0, i] != 0 or not cells.place[i, 2] > near:
            continue
        u, v, w, depth = _weights(corners, cells.place[i, 0], cells.place[i, 1], orthographic)
        if not ((u >= 0.0 and v >= 0.0 and w >= 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0)):
            continue
        if not depth < cells.place[i, 2] or (not orthographic and not depth > 0.0):
            continue
        side = 0 if depth >= cells.least[i] else 1
        if hidden[side, i] != 0:
            continue
        if holes.mask.shape[0] > 0:
            total = u + v + w
            if is_hole(t, np.float32(v / total), np.float32(w / total), casters.faces, holes):
                continue
        hidden[side, i] = 1


@kernel(parallel=True)
def hide(casters, view, orthographic, holes, cells, parts, hidden):
    """Which points some triangle hides from the light.

    Args:
        casters: :class:`Casters`.
        view: (18,) float64 as in :func:`~torchrender.kernels.shadows.shadow_lookup.shadow_lookup`.
        orthographic: parallel light.
        holes: what is missing of triangles.
        cells: :class:`Cells`; points are moved off their own surface.
        parts: pieces of work.
        hidden: (2,M) uint8, zero; 1 is written: by triangles beyond the least depth of a point, and by those before it,
            where no other hides it. Pieces write the same value: their order does not matter.
    """
    deepest = -np.inf
    for i in range(cells.deepest.shape[0]):
        deepest = max(deepest, cells.deepest[i])
    rows, columns = cells.shape[0], cells.shape[1]
    deep, size = cells.deepest, cells.size
    clusters, order = casters.clusters, casters.order
    for part in prange(parts):
        corners = np.zeros((3, 3))
        for c in range(np.int64(part), clusters.shape[0], parts):
            if _misses(casters, c, view, orthographic, cells, deepest):
                continue
            for k in range(clusters[c, 0], clusters[c, 1]):
                t = np.int64(order[k])
                near, far = _corners(casters, t, view, corners)
                if near > deepest or (not orthographic and far <= 0.0):
                    continue
                low_a, high_a, low_b, high_b = _image_box(corners, near, far, orthographic)
                left, right = _cell_range(low_a, high_a, view[FX], view[CX], size[0], columns)
                top, bottom = _cell_range(low_b, high_b, view[FY], view[CY], size[1], rows)
                for row in range(top, bottom):
                    for column in range(left, right):
                        cell = row * columns + column
                        if deep[cell] > near:
                            _hide_points(casters, t, corners, cell, (orthographic, near), cells, holes, hidden)
