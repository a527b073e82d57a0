"""Which cells of a grid a triangle meets: by exact tests of closed boxes, or by the centres of cell columns.

Corners are in cell units, (3,3) float64 with a row per corner. Cell (i, j, k) has the number
``(k ny + j) row + i``, where ``row`` is nx rounded up to whole words of 64 bits. ``dims`` = (nx, ny, nz, row). Source:
specification 05, section 4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.compile import kernel

SLACK = 1e-9
"""Cells by which boxes are grown, so that rounding never loses a cell that is touched."""

_ROUNDING = 1e-14  # of float64 products, with room for a few of them


class Soup(NamedTuple):
    """Triangles and the grid that they lie in."""

    vertices: np.ndarray  # (V,3) float64
    faces: np.ndarray  # (F,3) int32
    origin: np.ndarray  # (3,) float64
    scale: float  # cells per unit
    dims: np.ndarray  # (4,) int64 nx, ny, nz and bits per row
    thin: bool  # cells are met by the centres of columns instead of whole boxes


@kernel(inline=True)
def cell_number(axis, a, b, c, dims):
    """Number of the cell at (a, b, c) in the cyclic coordinates of ``axis``."""
    if axis == 0:
        return (np.int64(b) * dims[1] + a) * dims[3] + c
    if axis == 1:
        return (np.int64(a) * dims[1] + c) * dims[3] + b
    return (np.int64(c) * dims[1] + b) * dims[3] + a


@kernel(inline=True)
def least(a, b, c):
    small = a if a < b else b
    return small if small < c else c


@kernel(inline=True)
def greatest(a, b, c):
    large = a if a > b else b
    return large if large > c else c


@kernel(inline=True)
def load_corners(vertices, faces, t, origin, scale, p):
    """Corners of triangle ``t`` in cell units."""
    for k in range(3):
        v = faces[t, k]
        p[k, 0] = (vertices[v, 0] - origin[0]) * scale
        p[k, 1] = (vertices[v, 1] - origin[1]) * scale
        p[k, 2] = (vertices[v, 2] - origin[2]) * scale


@kernel(inline=True)
def dominant_axis(p, normal):
    """Unnormalised normal, and the axis of its largest component (the lowest index wins ties); -1 without area."""
    ux, uy, uz = p[1, 0] - p[0, 0], p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]
    wx, wy, wz = p[2, 0] - p[0, 0], p[2, 1] - p[0, 1], p[2, 2] - p[0, 2]
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    normal[0], normal[1], normal[2] = nx, ny, nz
    axis, most = 0, abs(nx)
    if abs(ny) > most:
        axis, most = 1, abs(ny)
    if abs(nz) > most:
        axis, most = 2, abs(nz)
    return axis if most > 0.0 else -1


@kernel(inline=True)
def edge_axes(p, a, b, low, axes, first):
    """The three separating axes (edge x unit axis) of the projection to (a, b), as rows of ``axes`` from ``first``.

    A row holds two coefficients and the limits within which the coordinate of a cell's lowest corner must lie.
    """
    for e in range(3):
        f, g = (e + 1) % 3, (e + 2) % 3
        x = p[e, b] - p[f, b]
        y = p[f, a] - p[e, a]
        here = x * (p[e, a] - low[a]) + y * (p[e, b] - low[b])
        other = x * (p[g, a] - low[a]) + y * (p[g, b] - low[b])
        radius = 0.5 * (abs(x) + abs(y))
        slack = SLACK * (abs(x) + abs(y))
        middle = 0.5 * (x + y)
        axes[first + e, 0], axes[first + e, 1] = x, y
        axes[first + e, 2] = min(here, other) - radius - middle - slack
        axes[first + e, 3] = max(here, other) + radius - middle + slack


@kernel(inline=True)
def on_axes(axes, first, s, t):
    """Do the three rows from ``first`` accept the cell (s, t) steps from the lowest one?"""
    for e in range(first, first + 3):
        d = axes[e, 0] * s + axes[e, 1] * t
        if d < axes[e, 2] or d > axes[e, 3]:
            return False
    return True


@kernel(inline=True)
def cell_box(p, dims, low, high, first, last):
    """Lowest and highest cell of the corners' bounding box, and the same within the grid; False outside of it."""
    for c in range(3):
        small = np.floor(least(p[0, c], p[1, c], p[2, c]) - SLACK)
        large = np.floor(greatest(p[0, c], p[1, c], p[2, c]) + SLACK)
        if large < 0.0 or small >= dims[c]:
            return False
        low[c], high[c] = small, large
        first[c] = np.int64(max(small, 0.0))
        last[c] = np.int64(min(large, dims[c] - 1.0))
    return True


@kernel(inline=True)
def lowest_cell(p, c):
    return np.floor(least(p[0, c], p[1, c], p[2, c]) - SLACK)


@kernel(inline=True)
def highest_cell(p, c):
    return np.floor(greatest(p[0, c], p[1, c], p[2, c]) + SLACK)


@kernel(inline=True)
def cells_met(p, dims, cells, work):
    """Cells whose closed box meets the triangle, into ``cells``; returns their number, -1 for one without area.

    Exact by thirteen separating axes, but for ``SLACK``. A triangle inside a single layer of cells needs the axes of
    one projection only, one inside a row of cells none. ``cells`` needs room for one more.
    """
    normal, low, high, _, first, last = work
    d = dominant_axis(p, normal)
    if d < 0:
        return -1
    x0, x1 = lowest_cell(p, 0), highest_cell(p, 0)
    y0, y1 = lowest_cell(p, 1), highest_cell(p, 1)
    z0, z1 = lowest_cell(p, 2), highest_cell(p, 2)
    if x1 < 0.0 or y1 < 0.0 or z1 < 0.0 or x0 >= dims[0] or y0 >= dims[1] or z0 >= dims[2]:
        return 0
    if x0 == x1 and y0 == y1 and z0 == z1:
        cells[0] = (np.int64(z0) * dims[1] + np.int64(y0)) * dims[3] + np.int64(x0)
        return 1
    low[0], low[1], low[2] = x0, y0, z0
    high[0], high[1], high[2] = x1, y1, z1
    for c in range(3):
        first[c] = np.int64(max(low[c], 0.0))
        last[c] = np.int64(min(high[c], dims[c] - 1.0))
    if (x0 == x1 and (y0 == y1 or z0 == z1)) or (y0 == y1 and z0 == z1):
        return all_cells(first, last, dims, cells)
    if x0 == x1:
        return cells_met_flat(p, dims, cells, work, 0)
    if y0 == y1:
        return cells_met_flat(p, dims, cells, work, 1)
    if z0 == z1:
        return cells_met_flat(p, dims, cells, work, 2)
    return cells_met_deep(p, dims, cells, work, d)


@kernel(inline=True)
def all_cells(first, last, dims, cells):
    count = 0
    for k in range(first[2], last[2] + 1):
        for j in range(first[1], last[1] + 1):
            for i in range(first[0], last[0] + 1):
                cells[count] = (k * dims[1] + j) * dims[3] + i
                count += 1
    return count


@kernel(inline=True)
def cells_met_flat(p, dims, cells, work, flat):
    """A triangle in a single layer of cells across axis ``flat``."""
    _, low, _, axes, first, last = work
    a, b = (1 if flat == 0 else 0), (1 if flat == 2 else 2)
    edge_axes(p, a, b, low, axes, 0)
    strides = (np.int64(1), dims[3], dims[3] * dims[1])
    base = first[flat] * strides[flat]
    count = 0
    for ib in range(first[b], last[b] + 1):
        t = ib - low[b]
        e0, e1, e2 = axes[0, 1] * t, axes[1, 1] * t, axes[2, 1] * t
        for ia in range(first[a], last[a] + 1):
            s = ia - low[a]
            f0, f1, f2 = e0 + axes[0, 0] * s, e1 + axes[1, 0] * s, e2 + axes[2, 0] * s
            inside = (f0 >= axes[0, 2]) & (f0 <= axes[0, 3]) & (f1 >= axes[1, 2]) & (f1 <= axes[1, 3])
            inside &= (f2 >= axes[2, 2]) & (f2 <= axes[2, 3])
            cells[count] = base + ib * strides[b] + ia * strides[a]
            count += inside
    return count


@kernel(inline=True)
def cells_met_deep(p, dims, cells, work, d):
    """Columns along dominant axis ``d``: those the projection meets, and in them the cells near the plane."""
    normal, low, high, axes, first, last = work
    u, v = (d + 1) % 3, (d + 2) % 3
    edge_axes(p, u, v, low, axes, 0)
    edge_axes(p, v, d, low, axes, 3)
    edge_axes(p, d, u, low, axes, 6)
    slope_u, slope_v = -normal[u] / normal[d], -normal[v] / normal[d]
    extent = max(high[0] - low[0], high[1] - low[1], high[2] - low[2]) + 1.0
    # A sliver's normal is not known to many digits: where it is not, only the other axes decide.
    slack = SLACK + _ROUNDING * extent * extent * extent / abs(normal[d])
    reach = 0.5 * (abs(slope_u) + abs(slope_v)) + slack
    u0, v0, d0 = p[0, u] - low[u] - 0.5, p[0, v] - low[v] - 0.5, p[0, d] - low[d]
    bottom, top = first[d] - low[d], last[d] - low[d]
    count = 0
    for iv in range(first[v], last[v] + 1):
        t = iv - low[v]
        for iu in range(first[u], last[u] + 1):
            s = iu - low[u]
            if not on_axes(axes, 0, s, t):
                continue
            z = d0 + slope_u * (s - u0) + slope_v * (t - v0)
            begin = np.int64(max(np.ceil(z - reach - 1.0), bottom))
            end = np.int64(min(np.floor(z + reach), top))
            for k in range(begin, end + 1):
                if on_axes(axes, 3, t, k) and on_axes(axes, 6, k, s):
                    cells[count] = cell_number(d, iu, iv, k + np.int64(low[d]), dims)
                    count += 1
    return count


@kernel(inline=True)
def columns_met(p, dims, cells, work):
    """Cells at the triangle's depth in the columns of its dominant axis whose centre line it crosses; else as above."""
    normal, low, high, _, first, last = work
    d = dominant_axis(p, normal)
    if d < 0:
        return -1
    if not cell_box(p, dims, low, high, first, last):
        return 0
    u, v = (d + 1) % 3, (d + 2) % 3
    slope_u, slope_v = -normal[u] / normal[d], -normal[v] / normal[d]
    bottom, top = min(p[0, d], p[1, d], p[2, d]), max(p[0, d], p[1, d], p[2, d])
    count = 0
    for iv in range(first[v], last[v] + 1):
        y = iv + 0.5
        for iu in range(first[u], last[u] + 1):
            x = iu + 0.5
            inside = True
            for e in range(3):
                f = (e + 1) % 3
                area = (p[f, u] - p[e, u]) * (y - p[e, v]) - (p[f, v] - p[e, v]) * (x - p[e, u])
                if (area if normal[d] > 0.0 else -area) < 0.0:
                    inside = False
            if not inside:
                continue
            z = p[0, d] + slope_u * (x - p[0, u]) + slope_v * (y - p[0, v])
            k = np.int64(np.floor(min(max(z, bottom), top)))
            if 0 <= k < dims[d]:
                cells[count] = cell_number(d, iu, iv, k, dims)
                count += 1
    return count


@kernel(inline=True)
def cells_of(soup, t, p, cells, work):
    """Cells that triangle ``t`` meets, into ``cells``, and its corners into ``p``; the number of cells as above."""
    load_corners(soup.vertices, soup.faces, t, soup.origin, soup.scale, p)
    return columns_met(p, soup.dims, cells, work) if soup.thin else cells_met(p, soup.dims, cells, work)
