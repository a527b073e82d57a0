"""Where a light shines on a ray at all, and where a ray meets other media than before."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import box_span
from torchrender.kernels.media.records import AXIS, FADE, OUTER, RECT, SPOT, SUN

F: Any = np.float32


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
    # (a.(x - p))^2 >= cos^2 |x - p|^2 on the side of the axis: a convex cone meets a line in one piece.
    pa, da, pp, pd = F(0.0), F(0.0), F(0.0), F(0.0)
    for c in range(3):
        p = o[c] - light[c]
        pa += light[AXIS + c] * p
        da += light[AXIS + c] * d[c]
        pp += p * p
        pd += p * d[c]
    k = light[OUTER] * light[OUTER]
    a, b, c2 = da * da - k, pa * da - k * pd, pa * pa - k * pp
    root = b * b - a * c2
    if abs(a) < F(1e-9):
        if abs(b) < F(1e-12):
            return (begin, end) if c2 >= F(0.0) and pa >= F(0.0) else (F(1.0), F(0.0))
        at = -c2 / (F(2.0) * b)
        first, last = (at, end) if b > F(0.0) else (begin, at)
    elif root <= F(0.0):
        return (F(1.0), F(0.0)) if a < F(0.0) else ((begin, end) if pa > F(0.0) else (F(1.0), F(0.0)))
    else:
        root = math.sqrt(root)
        low, high = (-b - root) / a, (-b + root) / a
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
    middle = F(0.5) * (first + last)
    return (first, last) if pa + da * middle > F(0.0) else (F(1.0), F(0.0))


@kernel(inline=True)
def break_points(media, kind, light, o, d, begin, end, points):
    """Lengths, in order, between which the same media are met and, before the sun, the same sides of boxes."""
    points[0], points[1] = begin, end
    count = 2
    for m in range(media.low.shape[0]):
        a, b = box_span(media.low[m], media.high[m], o[0], o[1], o[2], d[0], d[1], d[2])
        if b > a:
            for t in (a, b):
                if t > begin and t < end and count < len(points):
                    points[count] = t
                    count += 1
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
