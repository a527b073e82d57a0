"""Where a ray is lit, by epipolar slices: planes through the eye along the light.

In such a plane all rays of the eye pass the same texels of the light's depth image, and each is lit in a texel where
one number of its own, its slope, is at most one number of the texel. A tree of least and greatest numbers passes whole
runs of texels at once; the runs of its lowest level are compared as a whole, and the bits that change are looked up.

A row of parallel light has samples in equal steps along the slice. Where depth jumps between two of them, the place of
the edge is sought in the image itself, which may have many texels for each sample, on both borders of the slice: rays
pass it between these places, by where they lie between the borders, so that there are no stairs from slice to slice.
A row of a lamp has entries of equal angle.
Sources: Engelhardt, Dachsbacher, Epipolar sampling for shadows and crepuscular rays in participating media with single
scattering, 2010; Baran, Chen, Ragan-Kelley, Durand, Lehtinen, A hierarchical volumetric shadow algorithm for single
scattering, 2010; Chen, Baran, Durand, Jarosz, Real-time volumetric shadows using 1D min-max mipmaps, 2011.

Numbers of the slices: a frame of two axes across the light's direction (lamp: from the eye to it), the axis, the angle
of the first slice and between slices, the first angle at the lamp, the step along a row (an angle; parallel light:
texels), the lamp's distance or the eye's place in the image, and the change of depth that is an edge.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange
from numba.cpython.unsafe.numbers import trailing_zeros

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.records import BIG

F: Any = np.float32
ACROSS, UPWARD, AXIS, ANGLE, ANGLE_STEP, START, STEP, DISTANCE, U, V, FOCAL, JUMP = (
    0,
    3,
    6,
    9,
    10,
    11,
    12,
    13,
    13,
    14,
    15,
    16,
)
NUMBERS = 18
TURN = F(2.0 * math.pi)
RUN_BITS = 5
RUN = 1 << RUN_BITS  # entries that the lowest level of the tree sums up
HALVINGS = 4  # of the step between two samples, to find an edge
WIDEST = 8.0  # entries from its own one, beyond which an edge is not sought
PARTS = F(15.0)  # of a step, in which places of edges are told


@kernel(inline=True)
def view_towards(views, x, y, z):
    """The view that lies in front of a direction most; -1 for none."""
    best, size = -1, F(0.0)
    for n in range(views.shape[0]):
        along = views[n, 8] * x + views[n, 9] * y + views[n, 10] * z
        if along > size:
            best, size = n, along
    return best


@kernel(inline=True)
def lamp_row(depth, views, numbers, basis, turns, row):
    """Thresholds of one slice of a lamp; ``turns`` (2,K): cosines and sines of the angles at it."""
    best = -1
    distance = numbers[DISTANCE]
    ax, ay, az = numbers[6], numbers[7], numbers[8]
    bx, by, bz = basis
    # A view turns the row's plane into a plane of its own: three numbers on either axis are all that it takes.
    ux = uy = uz = vx = vy = vz = F(0.0)
    for k in range(len(row)):
        c, p = turns[0, k], turns[1, k]
        u, v, w = p * ux - c * vx, p * uy - c * vy, p * uz - c * vz
        if best < 0 or not (w > abs(u) and w > abs(v)):
            best = view_towards(views, p * bx - c * ax, p * by - c * ay, p * bz - c * az)
            if best < 0:
                row[k] = -BIG
                continue
            m = views[best]
            ux, vx = m[0] * bx + m[1] * by + m[2] * bz, m[0] * ax + m[1] * ay + m[2] * az
            uy, vy = m[4] * bx + m[5] * by + m[6] * bz, m[4] * ax + m[5] * ay + m[6] * az
            uz, vz = m[8] * bx + m[9] * by + m[10] * bz, m[8] * ax + m[9] * ay + m[10] * az
            u, v, w = p * ux - c * vx, p * uy - c * vy, p * uz - c * vz
        inverse = F(1.0) / w
        u, v = views[best, 12] * u * inverse + views[best, 14], views[best, 13] * v * inverse + views[best, 15]
        row[k] = -BIG
        if u >= F(0.0) and v >= F(0.0) and u < F(depth.shape[2]) and v < F(depth.shape[1]):
            reach = depth[best, np.int64(v), np.int64(u)]
            row[k] = (c - distance * w / reach) / p


@kernel(inline=True)
def image_span(depth, u, v, ca, sa):
    """Distances, in texels, at which a line from (u, v) is inside an image; both zero where it never is."""
    begin, end = F(0.0), BIG
    for c in range(2):
        place, rate, size = (u, ca, depth.shape[2]) if c == 0 else (v, sa, depth.shape[1])
        if abs(rate) < F(1e-7):
            if place < F(0.0) or place > F(size):
                return F(0.0), F(0.0)
            continue
        inverse = F(1.0) / rate
        a, b = -place * inverse, (F(size) - place) * inverse
        begin, end = max(begin, min(a, b)), min(end, max(a, b))
    return (begin, end) if end > begin else (F(0.0), F(0.0))


@kernel(inline=True)
def texel_at(depth, u, v):
    """Depth of the texel at a place in or beside the only view."""
    i = min(max(np.int64(u), 0), depth.shape[2] - 1)
    j = min(max(np.int64(v), 0), depth.shape[1] - 1)
    return depth[0, j, i]


@kernel(inline=True)
def nearer(there, before, after):
    """A depth is nearer to the first of two others; nothing is infinitely far from all else."""
    return there == before or abs(there - before) < abs(there - after)


@kernel(inline=True)
def edge_at(depth, line, span, k, jump):
    """Where on a line depth changes from one of two values to the other, in entries from ``k``; ``WIDEST`` if nowhere.

    Args:
        line: (u, v) of the eye and (cosine, sine) of the line. span: (where the first entry begins, its length).
        jump: (depth before, depth after).
    """
    u, v, ca, sa = line
    start, step = span
    before, after = jump
    reach = F(0.5)
    while reach < F(WIDEST):
        t = start + (F(k) - reach) * step
        first = nearer(texel_at(depth, u + t * ca, v + t * sa), before, after)
        t = start + (F(k) + reach) * step
        if first and not nearer(texel_at(depth, u + t * ca, v + t * sa), before, after):
            break
        reach *= F(2.0)
    if reach >= F(WIDEST):
        return F(WIDEST)
    low, high = -reach, reach
    while high - low > F(0.5) ** HALVINGS:
        middle = F(0.5) * (low + high)
        t = start + (F(k) + middle) * step
        if nearer(texel_at(depth, u + t * ca, v + t * sa), before, after):
            low = middle
        else:
            high = middle
    return F(0.5) * (low + high)


@kernel(inline=True)
def parallel_row(depth, numbers, angle, row, edges):
    """Thresholds of one slice of parallel light, and places of edges; returns where its first entry begins, in texels.

    What lies beside the image is lit.
    """
    ca, sa = F(math.cos(angle)), F(math.sin(angle))
    u, v, step = numbers[U], numbers[V], numbers[STEP]
    start, stop = image_span(depth, u, v, ca, sa)
    count = min(np.int64(max((stop - start) / step, F(0.0)) + F(0.5)), np.int64(len(row)))
    for k in range(count):
        at = max(start + (F(k) + F(0.5)) * step, F(1e-3))
        row[k] = (texel_at(depth, u + at * ca, v + at * sa) - numbers[FOCAL]) / at
    for k in range(count, len(row)):
        row[k] = BIG
    for k in range(len(row)):
        edges[k, 0], edges[k, 1] = 0, 0
    before = F(0.0)
    for k in range(count):
        at = max(start + (F(k) + F(0.5)) * step, F(1e-3))
        reach = row[k] * at
        row[k] = min(row[k], BIG)
        if k > 0 and abs(reach - before) > numbers[JUMP]:
            jump = before + numbers[FOCAL], reach + numbers[FOCAL]
            own = edge_at(depth, (u, v, ca, sa), (start, step), k, jump)
            for side in range(2):
                turn = angle + (F(side) - F(0.5)) * numbers[ANGLE_STEP]
                line = u, v, F(math.cos(turn)), F(math.sin(turn))
                place = edge_at(depth, line, (start, step), k, jump)
                if place >= F(WIDEST):
                    place = own if own < F(WIDEST) else F(0.0)
                edges[k, side] = np.int8(math.floor(place * PARTS + F(0.5)))
        before = reach
    return start


@kernel(inline=True)
def fill_tree(row, tree):
    """Least and greatest of runs of RUN entries, then of 2, 4, ... of these."""
    count = len(row) // RUN
    for k in range(count):
        low, high = row[k * RUN], row[k * RUN]
        for e in range(k * RUN + 1, k * RUN + RUN):
            low, high = min(low, row[e]), max(high, row[e])
        tree[k, 0], tree[k, 1] = low, high
    first, n = 0, count
    while n > 1:
        for k in range(n >> 1):
            a = first + 2 * k
            tree[first + n + k, 0] = min(tree[a, 0], tree[a + 1, 0])
            tree[first + n + k, 1] = max(tree[a, 1], tree[a + 1, 1])
        first, n = first + n, n >> 1


@kernel(parallel=True)
def build_slices(depth, views, parallel, numbers, rows, tree, edges, starts):
    """Fill the arrays of :class:`~torchrender.kernels.media.records.Slices`; K is a power of two, at least RUN.

    Args:
        depth: (V,H,W) of the light's views, +inf where they see nothing.
        views: (V,16) as :class:`~torchrender.kernels.media.records.Images`.
        numbers: (18,) see the module.
    """
    count = rows.shape[1]
    turns = np.empty((2, count), F)
    for k in range(count):
        at = numbers[START] + (F(k) + F(0.5)) * numbers[STEP]
        turns[0, k], turns[1, k] = math.cos(at), max(math.sin(at), 1e-7)
    for s in prange(rows.shape[0]):
        angle = numbers[ANGLE] + (F(s) + F(0.5)) * numbers[ANGLE_STEP]
        row = borrowed(rows)[s]
        if parallel:
            starts[s] = parallel_row(borrowed(depth), borrowed(numbers), angle, row, borrowed(edges)[s])
        else:
            ca, sa = F(math.cos(angle)), F(math.sin(angle))
            basis = (
                ca * numbers[0] + sa * numbers[3], ca * numbers[1] + sa * numbers[4], ca * numbers[2] + sa * numbers[5]
            )  # fmt: skip
            lamp_row(borrowed(depth), borrowed(views), borrowed(numbers), basis, borrowed(turns), row)
        fill_tree(row, borrowed(tree)[s])


@kernel(inline=True)
def levels_above(entries):
    """Levels of a tree above its lowest one."""
    levels = 0
    while (2 << levels) <= entries // RUN:
        levels += 1
    return levels


@kernel(inline=True)
def slice_changes(row, boxes, levels, slope, last, lit, found):
    """Entries before ``last`` at which a ray that is ``lit`` before the first begins or ceases to be, in ``found``.

    Args:
        found: (K,) int64, no shorter than the row.

    Returns:
        Their number, and of runs that were looked at.
    """
    # Shifts in place of divisions, and numbers without a sign, so that nothing is asked about ends of arrays.
    runs = np.int64(len(row)) >> RUN_BITS
    level = min(np.int64(1), levels)
    offset = 2 * runs - (2 * runs >> level)
    count, looks, k = np.int64(0), np.int64(0), np.int64(0)
    while k < last:
        m = k >> (level + RUN_BITS)
        looks += 1
        low, high = boxes[np.uintp(offset + m), 0], boxes[np.uintp(offset + m), 1]
        if slope > low and slope <= high:
            if level > 0:
                offset -= runs >> (level - 1)
                level -= 1
                continue
            mask = np.uint32(0)
            for e in range(RUN):
                mask |= np.uint32(slope <= row[np.uintp(k) + np.uintp(e)]) << np.uint32(e)
            flips = (mask ^ ((mask << np.uint32(1)) | np.uint32(lit))) & np.uint32((1 << RUN) - 1)
            while flips != np.uint32(0):
                at = k + np.int64(trailing_zeros(flips))
                if at >= last:
                    break
                found[np.uintp(count)] = at
                count += 1
                lit = not lit
                flips &= flips - np.uint32(1)
        elif (slope <= low) != lit:
            found[np.uintp(count)] = k
            count += 1
            lit = not lit
        k = (m + 1) << (level + RUN_BITS)
        if (m & 1) and level < levels:
            offset += runs >> level
            level += 1
    return count, looks
