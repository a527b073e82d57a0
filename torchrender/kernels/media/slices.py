"""Where a ray is lit, by epipolar slices: planes through the eye along the light.

In such a plane all rays of the eye pass the same texels of the light's depth image, and each is lit in a texel where
one number of its own, its slope, is at most one number of the texel. A tree of least and greatest numbers passes whole
runs of texels at once; the runs of its lowest level are read one by one.

A row of parallel light has two entries for each column of texels (or row, if the slice runs along these rather): the
slice passes at most two texels there. So a row holds every texel that it passes, and where a ray leaves one is found
from the texel's own side and the ray's own direction. A row of a lamp has entries of equal angle.
Sources: Engelhardt, Dachsbacher, Epipolar sampling for shadows and crepuscular rays in participating media with single
scattering, 2010; Baran, Chen, Ragan-Kelley, Durand, Lehtinen, A hierarchical volumetric shadow algorithm for single
scattering, 2010; Chen, Baran, Durand, Jarosz, Real-time volumetric shadows using 1D min-max mipmaps, 2011.

Numbers of the slices: a frame of two axes across the light's direction (lamp: from the eye to it), the axis, the angle
of the first slice and between slices, the first angle at the lamp and the step along a row, and the lamp's distance or
the eye's place in the image. Lines of parallel slices: whether they run along rows, the side of the first column, in
which direction columns follow, and by how much the other coordinate changes with each.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.functions import arctan2, tangent
from torchrender.kernels.media.records import BIG
from torchrender.kernels.media.walk import add_span

F: Any = np.float32
ACROSS, UPWARD, AXIS, ANGLE, ANGLE_STEP, START, STEP, DISTANCE, U, V, FOCAL = 0, 3, 6, 9, 10, 11, 12, 13, 13, 14, 15
NUMBERS = 18
TURN = F(2.0 * math.pi)
RUN = 16  # entries that the lowest level of the tree sums up
ALONG, FIRST, SIGN, SLANT = 0, 1, 2, 3  # numbers of a line


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
def parallel_row(depth, numbers, angle, line, row):
    """Thresholds of one slice of parallel light, and its line."""
    ca, sa = F(math.cos(angle)), F(math.sin(angle))
    along = abs(ca) >= abs(sa)
    eye, other = (numbers[U], numbers[V]) if along else (numbers[V], numbers[U])
    rate, slant = (ca, sa / ca) if along else (sa, ca / sa)
    sign = F(1.0) if rate > F(0.0) else F(-1.0)
    columns = depth.shape[2] if along else depth.shape[1]
    others = depth.shape[1] if along else depth.shape[2]
    # From the column on that the eye is in, or from the image's border.
    first = F(math.floor(eye)) if rate > F(0.0) else F(math.ceil(eye))
    first = min(max(first, F(0.0)), F(columns))
    line[ALONG], line[FIRST], line[SIGN], line[SLANT] = F(1.0) if along else F(0.0), first, sign, sign * slant
    away = F(1.0) / abs(rate)
    start = (first - eye) * sign  # columns from the eye
    for j in range(len(row) >> 1):
        row[2 * j], row[2 * j + 1] = BIG, BIG
        column = np.int64(first) + j if rate > F(0.0) else np.int64(first) - 1 - j
        if column < 0 or column >= columns:
            continue
        here = other + (start + F(j)) * line[SLANT]
        there = here + line[SLANT]
        a, b = np.int64(math.floor(here)), np.int64(math.floor(there))
        share = F(1.0)
        if a != b:
            share = min(max((F(max(a, b)) - here) / (there - here), F(0.0)), F(1.0))
        middle = F(0.5) if a == b else F(0.5) * share
        for half in range(2):
            texel = b if half == 1 else a
            if texel >= 0 and texel < others:
                reach = depth[0, texel, column] if along else depth[0, column, texel]
                at = max((start + F(j) + middle) * away, F(1e-3))
                row[2 * j + half] = min((reach - numbers[FOCAL]) / at, BIG)
            middle = F(0.5) if a == b else F(0.5) * (F(1.0) + share)


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
def build_slices(depth, views, parallel, numbers, rows, tree, lines):
    """Fill ``rows`` (S,K), ``tree`` (S,2 K/RUN,2) and ``lines`` (S,4); K is a power of two, at least RUN.

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
            parallel_row(borrowed(depth), borrowed(numbers), angle, borrowed(lines)[s], row)
        else:
            ca, sa = F(math.cos(angle)), F(math.sin(angle))
            basis = (
                ca * numbers[0] + sa * numbers[3], ca * numbers[1] + sa * numbers[4], ca * numbers[2] + sa * numbers[5]
            )  # fmt: skip
            lamp_row(borrowed(depth), borrowed(views), borrowed(numbers), basis, borrowed(turns), row)
        fill_tree(row, borrowed(tree)[s])


@kernel(inline=True)
def enters_column(n, line, u, v, k):
    """Length at which a ray enters entry ``k`` of a row of parallel light; ``u``, ``v``: texels per length."""
    along = line[ALONG] > F(0.0)
    eye, other = (n[U], n[V]) if along else (n[V], n[U])
    major, minor = (u, v) if along else (v, u)
    inverse = F(1.0) / max(major * line[SIGN], F(1e-9))
    start = (line[FIRST] - eye) * line[SIGN] + F(k >> 1)
    t = start * inverse
    if k & 1:
        here = other + start * line[SLANT]
        a, b = math.floor(here), math.floor(here + line[SLANT])
        if a != b and minor != F(0.0):
            t = min(max((F(max(a, b)) - other) / minor, t), t + inverse)
    return t


@kernel(inline=True)
def slice_ray(slices, parallel, angles, d, ends, spans):
    """Lit parts of an eye ray between two lengths, ``ends``, in ``spans`` (K,2).

    Args:
        angles: of a lamp: the parts are told as angles at it, from the place that is nearest to it; else as lengths.

    Returns:
        Their number, and of runs and entries that were looked at.
    """
    rows, tree, lines, n = slices
    begin, end = ends
    u = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
    v = n[3] * d[0] + n[4] * d[1] + n[5] * d[2]
    w = n[6] * d[0] + n[7] * d[1] + n[8] * d[2]
    across = max(math.sqrt(u * u + v * v), F(1e-9))
    slope = w / across if parallel else -w / across
    angle = arctan2(v, u) - n[ANGLE]
    if angle < F(0.0):
        angle += TURN
    elif angle >= TURN:
        angle -= TURN
    s = min(np.int64(angle / n[ANGLE_STEP]), rows.shape[0] - 1)
    row, line, boxes = rows[s], lines[s], tree[s]
    total = rows.shape[1]
    t0, away, first = n[DISTANCE] * w, n[DISTANCE] * across, F(0.0)
    if parallel:
        along = line[ALONG] > F(0.0)
        reach = (u if along else v) * line[SIGN] * end - (line[FIRST] - (n[U] if along else n[V])) * line[SIGN]
        last = 2 * np.int64(min(max(reach + F(1.0), F(0.0)), F(total)))
    else:
        first, stop_at = arctan2(-t0, away), arctan2(end - t0, away)
        last = np.int64(max((stop_at - first - n[START]) / n[STEP], F(0.0))) + 1
        if angles:
            begin, end = arctan2(begin - t0, away), stop_at
    last = min(last, total)
    runs = total // RUN
    levels = 0
    while (2 << levels) <= runs:
        levels += 1
    level = min(1, levels)
    offset = 2 * runs - (2 * runs >> level)
    lit, since, count, looks, k = parallel, begin, np.int64(0), np.int64(0), np.int64(0)
    while k < last:
        size = RUN << level
        m = k // size
        looks += 1
        low, high = boxes[offset + m, 0], boxes[offset + m, 1]
        stop, whole = k + 1, True
        if slope > low and slope <= high:
            if level > 0:
                offset -= runs >> (level - 1)
                level -= 1
                continue
            stop, whole = min(k + RUN, last), False
            looks += RUN
        part = row[k:stop]
        for e in range(len(part)):
            new = slope <= (low if whole else part[e])
            if new != lit:
                if parallel:
                    t = enters_column(n, line, u, v, k + e)
                elif k + e == 0:
                    t = begin
                else:
                    t = first + n[START] + F(k + e) * n[STEP]
                    if not angles:
                        t = t0 + away * tangent(t)
                t = min(max(t, begin), end)
                if new:
                    since = t
                else:
                    count = add_span(spans, count, since, t)
                lit = new
        k = (m + 1) * size
        if (m & 1) and level < levels:
            offset += runs >> level
            level += 1
    if parallel and last == total and not lit:
        t = enters_column(n, line, u, v, total)
        if t < end:
            lit, since = True, max(t, begin)
    if lit:
        count = add_span(spans, count, since, end)
    return count, looks
