"""Where a ray is lit, by epipolar slices: planes through the eye along the light.

In such a plane all rays of the eye pass the same texels of the light's depth image, and each is lit in a texel where
one number of its own, its slope, is at most one number of the texel. A tree of least and greatest numbers passes whole
runs of texels at once.
Sources: Engelhardt, Dachsbacher, Epipolar sampling for shadows and crepuscular rays in participating media with single
scattering, 2010; Baran, Chen, Ragan-Kelley, Durand, Lehtinen, A hierarchical volumetric shadow algorithm for single
scattering, 2010; Chen, Baran, Durand, Jarosz, Real-time volumetric shadows using 1D min-max mipmaps, 2011.

Numbers of the slices: a frame of two axes across the light's direction (lamp: from the eye to it), the axis, the angle
of the first slice and between slices, the first texel and the step along a row (parallel: texels of the image; lamp:
angle at the lamp, from the eye), and the lamp's distance or the eye's place in the image.
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


@kernel(parallel=True)
def build_slices(depth, views, parallel, numbers, rows, tree):
    """Fill ``rows`` (S,K) and ``tree`` (S,K,2): thresholds, and least and greatest of 2, 4, ... neighbours.

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
        ca, sa = F(math.cos(angle)), F(math.sin(angle))
        row = borrowed(rows)[s]
        if parallel:
            for k in range(count):
                at = numbers[START] + (F(k) + F(0.5)) * numbers[STEP]
                u, v = numbers[U] + at * ca, numbers[V] + at * sa
                row[k] = BIG
                if u >= F(0.0) and v >= F(0.0) and u < F(depth.shape[2]) and v < F(depth.shape[1]):
                    row[k] = min((depth[0, np.int64(v), np.int64(u)] - numbers[FOCAL]) / at, BIG)
        else:
            basis = (
                ca * numbers[0] + sa * numbers[3], ca * numbers[1] + sa * numbers[4], ca * numbers[2] + sa * numbers[5]
            )  # fmt: skip
            lamp_row(borrowed(depth), borrowed(views), borrowed(numbers), basis, borrowed(turns), row)
        for k in range(count >> 1):
            tree[s, k, 0] = min(row[2 * k], row[2 * k + 1])
            tree[s, k, 1] = max(row[2 * k], row[2 * k + 1])
        first, n = 0, count >> 1
        while n > 1:
            for k in range(n >> 1):
                a, b = first + 2 * k, first + 2 * k + 1
                tree[s, first + n + k, 0] = min(tree[s, a, 0], tree[s, b, 0])
                tree[s, first + n + k, 1] = max(tree[s, a, 1], tree[s, b, 1])
            first, n = first + n, n >> 1


@kernel(inline=True)
def along_slice(parallel, n, d, end):
    """Angle of a ray's slice, its slope, what a step along the row is worth, and how many there are.

    Steps of parallel light are ray lengths, of a lamp angles at it.
    """
    u = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
    v = n[3] * d[0] + n[4] * d[1] + n[5] * d[2]
    w = n[6] * d[0] + n[7] * d[1] + n[8] * d[2]
    angle = arctan2(v, u)
    if parallel:
        rate = max(math.sqrt(u * u + v * v), F(1e-9))
        return angle, w / rate, F(1.0) / rate, rate * end
    across = math.sqrt(u * u + v * v)
    slope = -w / max(across, F(1e-9))
    first = arctan2(slope, F(1.0))
    t0, away = n[DISTANCE] * w, n[DISTANCE] * max(across, F(1e-9))
    return angle, slope, F(1.0), arctan2(end - t0, away) - first


@kernel(inline=True)
def slice_ray(slices, parallel, d, begin, end, spans):
    """Lit parts of an eye ray between two lengths, in ``spans`` (K,2).

    Returns:
        Their number, and of runs that were looked at.
    """
    rows, tree, n = slices
    angle, slope, worth, reach = along_slice(parallel, n, d, end)
    angle -= n[ANGLE]
    if angle < F(0.0):
        angle += TURN
    elif angle >= TURN:
        angle -= TURN
    s = min(np.int64(angle / n[ANGLE_STEP]), rows.shape[0] - 1)
    total = rows.shape[1]
    last = min(np.int64(max((reach - n[START]) / n[STEP], F(0.0))) + 1, total)
    levels = 0
    while (1 << (levels + 1)) <= total:
        levels += 1
    t0 = n[DISTANCE] * (n[6] * d[0] + n[7] * d[1] + n[8] * d[2])
    away = math.sqrt(max(n[DISTANCE] * n[DISTANCE] - t0 * t0, F(1e-12)))
    first = arctan2(-t0, away)
    level = min(4, levels)
    offset = total - (2 * total >> level)
    lit, since, count, looks, k = parallel, begin, np.int64(0), np.int64(0), np.int64(0)
    while k < last:
        m = k >> level
        looks += 1
        if level:
            low, high = tree[s, offset + m, 0], tree[s, offset + m, 1]
        else:
            low = high = rows[s, k]
        if slope <= low:
            new = True
        elif slope > high:
            new = False
        else:
            offset -= total >> (level - 1)
            level -= 1
            continue
        if new != lit:
            at = n[START] + F(k) * n[STEP]
            t = at * worth if parallel else t0 + away * tangent(first + at)
            t = begin if k == 0 and not parallel else t
            if new:
                since = min(max(t, begin), end)
            else:
                count = add_span(spans, count, since, min(max(t, begin), end))
            lit = new
        k = (m + 1) << level
        if (m & 1) and level < levels:
            offset += total >> level
            level += 1
    if parallel and last == total and not lit:
        t = (n[START] + F(total) * n[STEP]) * worth
        if t < end:
            lit, since = True, max(t, begin)
    if lit:
        count = add_span(spans, count, since, end)
    return count, looks
