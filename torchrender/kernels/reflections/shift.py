"""A grid of triangles whose vertices have moved over the image: where each pixel's value comes from, and how surely.

Every pixel centre is a vertex, moved to a new place; neighbours span two triangles per 2 x 2 block. The nearest
triangle over a pixel wins (64-bit keys and an atomic maximum: the result does not depend on the order of threads), and
the pixel gets the position between the old pixel centres that the triangle carries there. Specification 04, sections 6
and 7.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, store_max
from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.corners import DIAGONAL, FIRST, SECOND

UNCOVERED, UNSURE, SURE = 0, 1, 2
RIGHT, DOWN, FAINT = 1, 2, 4
"""Bits of ``breaks``: what a pixel mirrors visibly does not go on in the pixel to its right, in the one below. FAINT
times these: the distance jumps there, but the colours are about the same."""
GAP = 1.5  # growth of a triangle across a faint jump that may have opened a gap

EDGE = -1e-6  # least edge value, in pixels squared, of a pixel on a triangle: vertices on pixel centres count
_GUARD = 1e6  # pixels


@kernel(inline=True)
def corners(i, second, bits):
    """Columns and rows (relative to the block's row) of a block's first or second triangle, front-facing order."""
    if bits & DIAGONAL:
        if second:
            return i + 1, 0, i, 0, i, 1
        return i, 1, i + 1, 1, i + 1, 0
    if second:
        return i + 1, 1, i + 1, 0, i, 0
    return i, 0, i, 1, i + 1, 1


@kernel(inline=True)
def signed_area(a, b, c):
    """Twice the area; positive for triangles of the unmoved grid."""
    return (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1])


@kernel(inline=True)
def vertex(place, y, x):
    return np.float64(place[y, x, 0]), np.float64(place[y, x, 1])


@kernel(parallel=True)
def draw_moved(place, depth, shape, ids, targets, keys):
    """Keys (H*W,) of the nearest triangle of each pixel of the target.

    place (h,w,2) float32 new x and y of each vertex, NaN where unusable; depth (h,w) float32 > 0 of each vertex; shape
    (h-1,w-1) uint8 triangles of each block; ids (h,w) int32 of the vertices; targets (H,W) int32: only pixels of the
    same id are drawn to. Upper half of a key: float32 bits of 1/depth; lower half: complement of 2 block + triangle.
    """
    rows, columns = shape.shape
    height, width = targets.shape
    for row in prange(rows):
        j = np.int64(row)
        at_new, bits_of, near, own_ids, goal = (
            borrowed(place),
            borrowed(shape),
            borrowed(depth),
            borrowed(ids),
            borrowed(targets),
        )
        best = borrowed(keys)
        for i in range(columns):
            kind = bits_of[j, i]
            for t in range(2):
                if not kind & (FIRST if t == 0 else SECOND):
                    continue
                xa, ya, xb, yb, xc, yc = corners(i, t == 1, kind)
                a, b, c = vertex(at_new, j + ya, xa), vertex(at_new, j + yb, xb), vertex(at_new, j + yc, xc)
                low_x, high_x = min(a[0], min(b[0], c[0])), max(a[0], max(b[0], c[0]))
                low_y, high_y = min(a[1], min(b[1], c[1])), max(a[1], max(b[1], c[1]))
                if not (low_x > -_GUARD and high_x < _GUARD and low_y > -_GUARD and high_y < _GUARD):
                    continue
                area = signed_area(a, b, c)
                if not abs(area) > 0.0:  # without extent, or with a vertex that is not usable
                    continue
                sign = 1.0 if area > 0.0 else -1.0
                own = own_ids[j + ya, xa]
                qa = 1.0 / np.float64(near[j + ya, xa])
                qb = 1.0 / np.float64(near[j + yb, xb])
                qc = 1.0 / np.float64(near[j + yc, xc])
                number = np.uint64(0xFFFFFFFF) - np.uint64(2 * (j * columns + i) + t)
                slack = 1e-4
                x0, x1 = max(math.ceil(low_x - 0.5 - slack), 0), min(math.floor(high_x - 0.5 + slack), width - 1)
                y0, y1 = max(math.ceil(low_y - 0.5 - slack), 0), min(math.floor(high_y - 0.5 + slack), height - 1)
                for y in range(y0, y1 + 1):
                    for x in range(x0, x1 + 1):
                        if goal[y, x] != own:
                            continue
                        p = (x + 0.5, y + 0.5)
                        wa, wb, wc = (
                            sign * signed_area(p, b, c),
                            sign * signed_area(a, p, c),
                            sign * signed_area(a, b, p),
                        )
                        if wa < EDGE or wb < EDGE or wc < EDGE:
                            continue
                        nearness = (wa * qa + wb * qb + wc * qc) / (wa + wb + wc)
                        bits = np.uint64(np.float32(max(nearness, 0.0)).view(np.uint32))
                        key = (bits << np.uint64(32)) | number
                        at = y * width + x
                        if key > best[np.uintp(at)]:
                            store_max(best, at, key)


@kernel(inline=True)
def link(breaks, ya, xa, yb, xb):
    """0 for a whole link between two neighbouring pixels of a row or column, 1 for a visible break, FAINT for one."""
    if ya == yb:
        bits = breaks[ya, min(xa, xb)]
        return 1 if bits & RIGHT != 0 else (FAINT if bits & (FAINT * RIGHT) != 0 else 0)
    bits = breaks[min(ya, yb), xa]
    return 1 if bits & DOWN != 0 else (FAINT if bits & (FAINT * DOWN) != 0 else 0)


@kernel()
def sure(area, links, largest):
    """Whether a moved triangle still tells the truth; ``area`` is twice its signed area, once that of an unmoved one.

    Not if it is flipped or has grown by more than ``largest``; and not across a break in what is mirrored, unless the
    two sides look alike and nothing has appeared between them.
    """
    if area <= 0.0 or area > largest:
        return False
    return links == 0 or (links & 1 == 0 and area <= GAP)


@kernel(parallel=True)
def resolve_moved(keys, place, shape, breaks, largest, targets, source, certainty):
    """Old position (H,W,2) float32 in pixels (x, y) of each target pixel, and UNCOVERED, UNSURE or SURE (H,W) uint8.

    breaks (h,w) uint8 as above; largest: growth of a triangle that still counts.
    """
    columns = shape.shape[1]
    height, width = targets.shape
    for row in prange(height):
        y = np.int64(row)
        at_new, bits_of, torn = borrowed(place), borrowed(shape), borrowed(breaks)
        for x in range(width):
            key = keys[np.uintp(y * width + x)]
            source[y, x, 0], source[y, x, 1] = np.nan, np.nan
            certainty[y, x] = UNCOVERED
            if key == np.uint64(0):
                continue
            number = np.int64(np.uint64(0xFFFFFFFF) - (key & np.uint64(0xFFFFFFFF)))
            j = number // (2 * columns)
            i = (number - 2 * columns * j) // 2
            xa, ya, xb, yb, xc, yc = corners(i, number % 2 == 1, bits_of[j, i])
            a, b, c = vertex(at_new, j + ya, xa), vertex(at_new, j + yb, xb), vertex(at_new, j + yc, xc)
            area = signed_area(a, b, c)
            p = (np.float64(x) + 0.5, np.float64(y) + 0.5)
            wa, wb = signed_area(p, b, c) / area, signed_area(a, p, c) / area
            wa, wb = min(max(wa, 0.0), 1.0), min(max(wb, 0.0), 1.0)
            wc = max(1.0 - wa - wb, 0.0)
            source[y, x, 0] = np.float32(wa * xa + wb * xb + wc * xc + 0.5)
            source[y, x, 1] = np.float32(wa * (j + ya) + wb * (j + yb) + wc * (j + yc) + 0.5)
            # The second corner has the right angle: the other two are its neighbours in row and column.
            links = link(torn, j + ya, xa, j + yb, xb) | link(torn, j + yb, xb, j + yc, xc)
            certainty[y, x] = SURE if sure(area, links, largest) else UNSURE
