"""Which part of which triangle lies in which surface voxel. Source: specification 05, section 6.

Cells are named by their rank among the set bits of the surface. ``before[w]`` counts the set bits below word ``w``.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.voxels.bits import ones_in, span
from torchrender.kernels.voxels.cells import cells_of, dominant_axis, load_corners
from torchrender.kernels.voxels.columns import sort_run
from torchrender.kernels.voxels.surface import BLOCK, thread_arrays, thread_views

CORNERS = 10  # of a triangle clipped by six planes, and one more


@kernel(parallel=True)
def visit(soup, room, threads, marked, ends, triangles, tally):
    """For every pair of triangle and cell: store the triangle at the cell's place in ``ends``, and advance that.

    ``soup``: :class:`~torchrender.kernels.voxels.cells.Soup`; ``marked`` = (words, before). With ``triangles`` of
    length 0, only the pairs of each cell are counted. ``tally`` (1,) hands out blocks.
    """
    words, before = marked
    total = len(soup.faces)
    blocks = (total + BLOCK - 1) // BLOCK
    shared = borrowed(ends)
    scratch = thread_arrays(threads, room)
    for thread in prange(threads):
        p, cells, work = thread_views(scratch, thread)
        own = borrowed(soup)
        while True:
            block = fetch_add(tally, 0, 1)
            if block >= blocks:
                break
            for t in range(block * BLOCK, min((block + 1) * BLOCK, total)):
                count = cells_of(own, t, p, cells, work)
                for n in range(count):
                    word, bit = cells[n] >> 6, np.uint64(1) << np.uint64(cells[n] & 63)
                    at = fetch_add(shared, before[word] + ones_in(words[word] & (bit - np.uint64(1))), 1)
                    if len(triangles):
                        triangles[at] = t


@kernel()
def clipped(p, cell, polygon, other):
    """Part of a triangle inside a cell: barycentric centroid (weights of corners 1 and 2), and twice the share of area.

    ``polygon``, ``other``: (CORNERS, 2) scratch.
    """
    polygon[0, 0], polygon[0, 1], polygon[1, 0], polygon[1, 1], polygon[2, 0], polygon[2, 1] = (
        0.0,
        0.0,
        1.0,
        0.0,
        0.0,
        1.0,
    )
    count = 3
    for c in range(3):
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            base = sign * (p[0, c] - cell[c] - side)
            du, dv = sign * (p[1, c] - p[0, c]), sign * (p[2, c] - p[0, c])
            kept = 0
            for n in range(count):
                m = n + 1 if n + 1 < count else 0
                here = base + du * polygon[n, 0] + dv * polygon[n, 1]
                there = base + du * polygon[m, 0] + dv * polygon[m, 1]
                if here >= 0.0:
                    other[kept, 0], other[kept, 1] = polygon[n, 0], polygon[n, 1]
                    kept += 1
                if (here >= 0.0) != (there >= 0.0):
                    s = here / (here - there)
                    other[kept, 0] = polygon[n, 0] + s * (polygon[m, 0] - polygon[n, 0])
                    other[kept, 1] = polygon[n, 1] + s * (polygon[m, 1] - polygon[n, 1])
                    kept += 1
            count = kept
            for n in range(count):
                polygon[n, 0], polygon[n, 1] = other[n, 0], other[n, 1]
    if count == 0:
        return 1.0 / 3.0, 1.0 / 3.0, 0.0
    area, u, v = 0.0, 0.0, 0.0
    for n in range(1, count - 1):
        ax, ay = polygon[n, 0] - polygon[0, 0], polygon[n, 1] - polygon[0, 1]
        bx, by = polygon[n + 1, 0] - polygon[0, 0], polygon[n + 1, 1] - polygon[0, 1]
        part = ax * by - ay * bx
        area += part
        u += part * (ax + bx) / 3.0
        v += part * (ay + by) / 3.0
    if area > 1e-12:
        return polygon[0, 0] + u / area, polygon[0, 1] + v / area, area
    u, v = 0.0, 0.0
    for n in range(count):
        u += polygon[n, 0] / count
        v += polygon[n, 1] / count
    return u, v, max(area, 0.0)


@kernel()
def at_column(p, cell, normal, axis):
    """Barycentric weights of corners 1 and 2 where a triangle meets the centre line of a cell's column."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    x, y = cell[a] + 0.5 - p[0, a], cell[b] + 0.5 - p[0, b]
    u = (x * (p[2, b] - p[0, b]) - y * (p[2, a] - p[0, a])) / normal[axis]
    v = (y * (p[1, a] - p[0, a]) - x * (p[1, b] - p[0, b])) / normal[axis]
    return u, v


@kernel(parallel=True)
def weigh(soup, cells, starts, triangles, barycentric, weight):
    """Order the triangles of each cell, and find where in them and with how much area they stand for the cell.

    Args:
        soup: as for :func:`visit`; thin: the point on the column's centre line and the area seen from there, instead of
            the clipped triangle.
        cells: (N,3) int64.
        starts: (N+1,) int64 places in ``triangles``.
        triangles: (M,) int32, sorted within each cell.
        barycentric: (M,2) float64 weights of corners 1 and 2.
        weight: (M,) float64, in squared cells.
    """
    vertices, faces, origin, scale, _, thin = soup
    for chunk in prange((len(cells) + BLOCK - 1) // BLOCK):
        p, normal, cell = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
        polygon, other = np.zeros((CORNERS, 2)), np.zeros((CORNERS, 2))
        first, last = span(chunk, BLOCK, len(cells))
        for n in range(first, last):
            cell[0], cell[1], cell[2] = cells[n, 0], cells[n, 1], cells[n, 2]
            sort_run(triangles, starts[n], starts[n + 1])
            for m in range(starts[n], starts[n + 1]):
                load_corners(vertices, faces, triangles[m], origin, scale, p)
                axis = dominant_axis(p, normal)
                size = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
                if thin:
                    barycentric[m, 0], barycentric[m, 1] = at_column(p, cell, normal, axis)
                    weight[m] = size / abs(normal[axis])
                else:
                    u, v, share = clipped(p, cell, polygon, other)
                    barycentric[m, 0], barycentric[m, 1] = u, v
                    weight[m] = 0.5 * size * share
