"""Where a light shines on a ray at all, where slices say so, and where a ray meets other media than before."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import box_span
from torchrender.kernels.media.functions import arctan2, tangent
from torchrender.kernels.media.records import AMBIENT, AXIS, FADE, FALLOFF, HEIGHT, OUTER, RECT, SPOT, SQUARE, SUN
from torchrender.kernels.media.slices import (
    ANGLE,
    ANGLE_STEP,
    DISTANCE,
    PARTS,
    START,
    STEP,
    TURN,
    levels_above,
    slice_changes,
)
from torchrender.kernels.media.walk import add_span

F: Any = np.float32
LAYERS = 6
"""Lengths at which a ray through a density that falls off with height changes its steps: 1, 2, 4 ... times the way in
which that becomes a part of 1/e, from where the ray is lowest; what lies beyond the last is nothing beside what is
there."""
DEEP, DEEP_AT_LAMPS = F(8.0), F(1.0)
"""Times that way which equal steps are fine enough for; those of equal angle at a lamp are wide far from it."""
PLACES = 5 + LAYERS
"""Lengths of each medium that :func:`break_points` finds, at most."""


@kernel(inline=True)
def cone_span(light, o, d, begin, end):
    """The part of a ray inside a spot's cone: begin, end; (1, 0) where there is none.

    sin^2 (a.x)^2 >= cos^2 |x - a (a.x)|^2, x from the lamp, on the side of the axis a: a convex cone meets a line in
    one piece. Narrow cones ask for what is across the axis apart from what is along it, counted from where the ray
    comes closest.
    """
    pa, da = F(0.0), F(0.0)
    for c in range(3):
        pa += light[AXIS + c] * (o[c] - light[c])
        da += light[AXIS + c] * d[c]
    pd, dd = F(0.0), F(0.0)
    for c in range(3):
        q = d[c] - light[AXIS + c] * da
        pd += (o[c] - light[c]) * q
        dd += q * q
    near = min(max(-pd / dd, begin), end) if dd > F(0.0) else begin
    pa += near * da
    pp, pd = F(0.0), F(0.0)
    for c in range(3):
        p, q = o[c] - light[c] + near * d[c] - light[AXIS + c] * pa, d[c] - light[AXIS + c] * da
        pp += p * p
        pd += p * q
    cosine, sine2 = F(1.0) - light[OUTER], light[OUTER] * (F(2.0) - light[OUTER])
    k = cosine * cosine
    a, b, c2 = sine2 * da * da - k * dd, sine2 * pa * da - k * pd, sine2 * pa * pa - k * pp
    root = b * b - a * c2
    if abs(a) < F(1e-9) * sine2:
        if abs(b) < F(1e-12) * sine2:
            return (begin, end) if c2 >= F(0.0) and pa >= F(0.0) else (F(1.0), F(0.0))
        at = near - c2 / (F(2.0) * b)
        first, last = (at, end) if b > F(0.0) else (begin, at)
    elif root <= F(0.0):
        return (F(1.0), F(0.0)) if a < F(0.0) else ((begin, end) if pa > F(0.0) else (F(1.0), F(0.0)))
    else:
        root = math.sqrt(root)
        low, high = near + (-b - root) / a, near + (-b + root) / a
        low, high = min(low, high), max(low, high)
        if a < F(0.0):
            first, last = low, high
        elif da > F(0.0):
            first, last = high, end
        else:
            first, last = begin, low
    first, last = max(first, begin), min(last, end)
    if not last > first:
        return F(1.0), F(0.0)
    middle = F(0.5) * (first + last) - near
    return (first, last) if pa + da * middle > F(0.0) else (F(1.0), F(0.0))


@kernel(inline=True)
def light_span(kind, light, o, d, begin, end):
    """The part of a ray that a light shines on: in its range, inside a spot's cone, before a rectangle."""
    if light[FADE] > F(0.0):
        pp, pd = F(0.0), F(0.0)
        for c in range(3):
            p = o[c] - light[c]
            pp += p * p
            pd += p * d[c]
        root = pd * pd - pp + F(1.0) / light[FADE]
        if root <= F(0.0):
            return F(1.0), F(0.0)
        root = math.sqrt(root)
        begin, end = max(begin, -pd - root), min(end, -pd + root)
        if not end > begin:
            return F(1.0), F(0.0)
    if kind == RECT:
        value, rate = F(0.0), F(0.0)
        for c in range(3):
            value += light[AXIS + c] * (o[c] - light[c])
            rate += light[AXIS + c] * d[c]
        if rate == F(0.0):
            return (begin, end) if value > F(0.0) else (F(1.0), F(0.0))
        at = -value / rate
        return (max(begin, at), end) if rate > F(0.0) else (begin, min(end, at))
    if kind != SPOT:
        return begin, end
    return cone_span(light, o, d, begin, end)


@kernel(inline=True)
def slice_ray(slices, parallel, angles, d, ends, spans, found):
    """Lit parts of an eye ray between two lengths, ``ends``, in ``spans`` (P,2).

    Args:
        angles: of a lamp: the parts are told as angles at it, from the place that is nearest to it; else as lengths.
        found: (K,) int64 scratch, no shorter than a row.

    Returns:
        Their number, and of runs that were looked at.
    """
    rows, tree, edges, starts, n = slices
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
    at = angle / n[ANGLE_STEP]
    s = min(np.int64(at), rows.shape[0] - 1)
    beside = min(max(at - F(s), F(0.0)), F(1.0))
    total = rows.shape[1]
    t0, away, first, scale = n[DISTANCE] * w, n[DISTANCE] * across, F(0.0), F(1.0)
    if parallel:
        scale = n[STEP] / across
        first = starts[s] / across
        reach = (end - first) / scale
    else:
        stop_at = arctan2(end - t0, away)
        scale, first = n[STEP], arctan2(-t0, away) + n[START]
        reach = (stop_at - first) / scale
        if angles:
            begin, end = arctan2(begin - t0, away), stop_at
    last = min(np.int64(min(max(reach, F(0.0)), F(total)) + F(1.0)), np.int64(total))
    lit = parallel
    changes, looks = slice_changes(rows[s], tree[s], levels_above(total), slope, last, lit, found)
    since, before, count = begin, begin, np.int64(0)
    for e in range(changes):
        k = found[e]
        if parallel:
            edge = F(edges[s, k, 0]) + (F(edges[s, k, 1]) - F(edges[s, k, 0])) * beside
            t = first + (F(k) + edge * (F(1.0) / PARTS)) * scale
        elif k == 0:
            t = begin
        else:
            t = first + F(k) * scale
            if not angles:
                t = t0 + away * tangent(t)
        before = min(max(t, before), end)  # places of edges may cross within a slice
        if lit:
            count = add_span(spans, count, since, before)
        else:
            since = before
        lit = not lit
    if parallel and last == total and not lit:
        t = first + F(total) * scale
        if t < end:
            lit, since = True, max(t, before)
    if lit:
        count = add_span(spans, count, since, end)
    return count, looks


@kernel(inline=True)
def add_layers(media, m, rise, deep, ends, points, count):
    """Add lengths between ``ends`` where a ray that climbs by ``rise`` through more than ``deep`` layers changes its
    steps, see :data:`LAYERS`; -> how many there are.
    """
    begin, end = ends
    fall = media.numbers[m, FALLOFF] * rise
    if media.kind[m] != HEIGHT or not abs(fall) * (end - begin) > deep:
        return count
    above = F(1.0) / fall
    for _ in range(LAYERS):
        t = begin + above if fall > F(0.0) else end + above
        if t > begin and t < end and count < len(points):
            points[count] = t
            count += 1
        above *= F(2.0)
    return count


@kernel(inline=True)
def break_points(media, kind, light, o, d, begin, end, points):
    """Lengths, in order, between which the same media are met and, before the sun, the same sides of boxes, and between
    which densities that fall off with height change no more than steps can follow.
    """
    points[0], points[1] = begin, end
    count = 2
    for m in range(media.low.shape[0]):
        a, b = box_span(media.low[m], media.high[m], o[0], o[1], o[2], d[0], d[1], d[2])
        if b > a:
            for t in (a, b):
                if t > begin and t < end and count < len(points):
                    points[count] = t
                    count += 1
            deep = DEEP_AT_LAMPS if light[SQUARE] > F(0.0) and kind != SUN and kind != AMBIENT else DEEP
            count = add_layers(media, m, d[1], deep, (max(a, begin), min(b, end)), points, count)
            if kind == SUN:
                # The way to the sun leaves the box where the least of three linear functions says.
                for i in range(3):
                    for j in range(i):
                        si, sj = light[AXIS + i], light[AXIS + j]
                        if si == F(0.0) or sj == F(0.0):
                            continue
                        hi = media.low[m, i] if si > F(0.0) else media.high[m, i]
                        hj = media.low[m, j] if sj > F(0.0) else media.high[m, j]
                        rate = d[i] / si - d[j] / sj
                        value = (o[i] - hi) / si - (o[j] - hj) / sj
                        if rate != F(0.0):
                            t = -value / rate
                            if t > max(begin, a) and t < min(end, b) and count < len(points):
                                points[count] = t
                                count += 1
    for i in range(1, count):
        value = points[i]
        j = i
        while j > 0 and points[j - 1] > value:
            points[j] = points[j - 1]
            j -= 1
        points[j] = value
    return count
