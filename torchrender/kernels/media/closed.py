"""Light of one source along eye rays in one homogeneous medium, where slices tell what is lit: closed forms.

What all rays need is computed for many of them at once, in loops without branches. Then where each begins and ceases
to be lit is found in its slice, and one integral along the ray is evaluated there. A lamp's is a table. Of the sun, the
way to it is the least of three linear functions of the place on the ray, in the order of their rates, so that the
integral is one of exponentials in three pieces. Sources: see airlight and slices.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.airlight import airlight_row, airlight_to
from torchrender.kernels.media.functions import arctan2, exponential
from torchrender.kernels.media.nodes import phase
from torchrender.kernels.media.records import AXIS, BIG, DENSITY, NEAREST, G
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
from torchrender.kernels.voxels.bits import span as block_of

F: Any = np.float32
CHUNK, GROUP = 8192, 128  # rays of a thread's piece of work, and of its loops
SLOPE, BESIDE, FIRST, SCALE, BEGIN, END, STRENGTH, WEIGHT, ENTER = 0, 1, 2, 3, 4, 5, 6, 7, 8
"""What is known of a ray: its slope, where it lies between its slice's borders, where its row begins and how long an
entry is, where the ray begins and ends (lengths, or angles at the lamp); factor of its light; a lamp's: weight of the
table's next row, length at which the medium begins."""
BREAK, VALUE, RATE, FACTOR, BEFORE = 9, 11, 14, 17, 20  # of the sun's pieces: ends of two; exponents, rates, ...
SUM = 23  # light, before its factor
ROOM = 24
SLICE, ROW = 0, 1


@kernel(inline=True)
def place_rays(kind_is_sun, n, beams, rows, known, numbers):
    """What slices tell of rays through directions alone."""
    direction, span = beams
    for j in range(len(rows)):
        i = rows[j]
        x, y, z = direction[i, 0], direction[i, 1], direction[i, 2]
        u = n[0] * x + n[1] * y + n[2] * z
        v = n[3] * x + n[4] * y + n[5] * z
        w = n[6] * x + n[7] * y + n[8] * z
        across = max(math.sqrt(u * u + v * v), F(1e-9))
        angle = arctan2(v, u) - n[ANGLE]
        angle = angle + TURN if angle < F(0.0) else angle
        angle = angle - TURN if angle >= TURN else angle
        at = angle / n[ANGLE_STEP]
        number = np.int32(at)
        numbers[SLICE, j] = number
        known[BESIDE, j] = min(at - F(number), F(1.0))
        begin, end = span[i, 0], span[i, 1]
        inverse = F(1.0) / across
        if kind_is_sun:
            known[SLOPE, j], known[FIRST, j], known[SCALE, j] = w * inverse, inverse, n[STEP] * inverse
        else:
            known[SLOPE, j] = -w * inverse
            t0, away = n[DISTANCE] * w, n[DISTANCE] * across
            known[FIRST, j], known[SCALE, j] = arctan2(-t0, away) + n[START], n[STEP]
            known[ENTER, j], known[WEIGHT, j] = begin - t0, away
            # No angles where there is no way.
            begin, end = arctan2(begin - t0, away), arctan2(end - t0, away)
        known[BEGIN, j], known[END, j] = begin, end


@kernel(inline=True)
def changes_along(slices, j, sun, known, numbers, scratch, first):
    """Where a ray begins to be lit and ceases to be, in turns and in order, from ``first`` on in ``scratch[0]``."""
    rows, tree, edges, starts, _ = slices
    places, found, levels = scratch
    begin, end, total = known[BEGIN, j], known[END, j], rows.shape[1]
    s = min(np.int64(numbers[SLICE, j]), rows.shape[0] - 1)
    origin, scale = known[FIRST, j], known[SCALE, j]
    if sun:
        origin *= starts[s]
    reach = (end - origin) / scale
    last = min(np.int64(min(max(reach, F(0.0)), F(total)) + F(1.0)), np.int64(total))
    changes, looks = slice_changes(rows[s], tree[s], levels, known[SLOPE, j], last, sun, found)
    at, lit, since = first, sun, begin
    if lit:
        places[at] = begin
        at += 1
    for e in range(changes):
        k = found[e]
        t = F(k)
        if sun:
            low, high = F(edges[s, k, 0]), F(edges[s, k, 1])
            t += (low + (high - low) * known[BESIDE, j]) * (F(1.0) / PARTS)
        t = begin if k == 0 and not sun else origin + t * scale
        since = min(max(t, since), end)
        places[at] = since
        at += 1
        lit = not lit
    if sun and last == total and not lit and origin + F(total) * scale < end:
        places[at] = max(origin + F(total) * scale, since)
        at += 1
        lit = True
    if lit:
        places[at] = end
        at += 1
    return at, looks


@kernel(inline=True)
def crossing(value, rate, other, faster):
    """Length at which a linear function falls below one that rises faster; never or always where both rise alike."""
    gap = faster - rate
    t = (value - other) / max(gap, F(1e-30))
    same = BIG if value >= other else -BIG
    return t if gap > F(0.0) else same


@kernel(inline=True)
def sun_pieces(media, c, light, direction, rows, known):
    """Pieces of the integral of sunlight along rays, for one channel."""
    density = media.numbers[0, DENSITY]
    thick = media.extinction[0, c] * density
    low, high, g = media.low[0], media.high[0], media.numbers[0, G]
    sx, sy, sz = light[AXIS], light[AXIS + 1], light[AXIS + 2]
    ix = F(1.0) / sx if sx != F(0.0) else F(0.0)
    iy = F(1.0) / sy if sy != F(0.0) else F(0.0)
    iz = F(1.0) / sz if sz != F(0.0) else F(0.0)
    # The way to the sun until the box ends along each axis, from the eye.
    vx = -(low[0] if sx > F(0.0) else high[0]) * ix if sx != F(0.0) else BIG
    vy = -(low[1] if sy > F(0.0) else high[1]) * iy if sy != F(0.0) else BIG
    vz = -(low[2] if sz > F(0.0) else high[2]) * iz if sz != F(0.0) else BIG
    for j in range(len(rows)):
        i = rows[j]
        x, y, z = direction[i, 0], direction[i, 1], direction[i, 2]
        known[STRENGTH, j] = media.scattering[0, c] * density * phase(g, -(sx * x + sy * y + sz * z))
        begin, end = known[BEGIN, j], max(known[BEGIN, j], known[END, j])
        # In the order in which they are the least: that which rises fastest is it first.
        v0, v1, v2, r0, r1, r2 = vx, vy, vz, x * ix, y * iy, z * iz
        swap = r0 < r1
        v0, v1, r0, r1 = v1 if swap else v0, v0 if swap else v1, r1 if swap else r0, r0 if swap else r1
        swap = r1 < r2
        v1, v2, r1, r2 = v2 if swap else v1, v1 if swap else v2, r2 if swap else r1, r1 if swap else r2
        swap = r0 < r1
        v0, v1, r0, r1 = v1 if swap else v0, v0 if swap else v1, r1 if swap else r0, r0 if swap else r1
        t01, t02, t12 = crossing(v1, r1, v0, r0), crossing(v2, r2, v0, r0), crossing(v2, r2, v1, r1)
        first = min(t01, t02)
        second = t12 if t01 < t02 else first
        first = min(max(first, begin), end)
        second = min(max(second, first), end)
        e0 = thick * max(v0 + r0 * begin, F(0.0))
        e1 = thick * (first - begin + max(v1 + r1 * first, F(0.0)))
        e2 = thick * (second - begin + max(v2 + r2 * second, F(0.0)))
        known[BREAK, j], known[BREAK + 1, j] = first, second
        known[VALUE, j], known[VALUE + 1, j], known[VALUE + 2, j] = e0, e1, e2
        k0, k1, k2 = thick * (F(1.0) + r0), thick * (F(1.0) + r1), thick * (F(1.0) + r2)
        known[RATE, j], known[RATE + 1, j], known[RATE + 2, j] = k0, k1, k2
        f0, f1, f2 = exponential(-e0), exponential(-e1), exponential(-e2)
        known[FACTOR, j], known[FACTOR + 1, j], known[FACTOR + 2, j] = f0, f1, f2
        known[BEFORE, j] = F(0.0)
        known[BEFORE + 1, j] = piece_to(e0, k0, f0, first - begin)
        known[BEFORE + 2, j] = known[BEFORE + 1, j] + piece_to(e1, k1, f1, second - first)


@kernel(inline=True)
def piece_to(value, rate, factor, length):
    """Integral of ``exp(-value - rate t)`` from 0 to ``length``; ``factor``: of its beginning."""
    rise = rate * length
    short = factor * length * (F(1.0) - rise * (F(0.5) - rise * (F(1.0 / 6.0) - rise * F(1.0 / 24.0))))
    small = abs(rise) < F(0.03)
    long = (factor - exponential(-value - rise)) / (F(1.0) if small else rate)
    return short if small else long


@kernel(inline=True)
def sum_sunlight(known, places, ends, count, parts):
    """Sunlight of the lit parts of some rays, into ``known[SUM]``.

    Args:
        places: where rays begin and cease to be lit; those of ray j are from ``ends[j]`` on.
        parts: (6,K) scratch: what pieces say of the places, gathered, so that the rest is one loop without branches.
    """
    for j in range(count):
        begin, first, second = known[BEGIN, j], known[BREAK, j], known[BREAK + 1, j]
        for k in range(ends[j], ends[j + 1]):
            t, p, start = places[k], 0, begin
            if t > first:
                p, start = 1, first
            if t > second:
                p, start = 2, second
            at = np.uintp(k)
            parts[0, at], parts[1, at] = known[VALUE + p, j], known[RATE + p, j]
            parts[2, at], parts[3, at], parts[4, at] = known[FACTOR + p, j], t - start, known[BEFORE + p, j]
    for k in range(ends[count]):
        parts[5, k] = parts[4, k] + piece_to(parts[0, k], parts[1, k], parts[2, k], parts[3, k])
    for j in range(count):
        total = F(0.0)
        for k in range(ends[j], ends[j + 1], 2):
            total += parts[5, k + 1] - parts[5, k]
        known[SUM, j] = total


@kernel(inline=True)
def sum_lamplight(table, c, known, numbers, places, ends, count):
    """Light of a lamp from the lit parts of some rays, into ``known[SUM]``."""
    for j in range(count):
        row, weight, total = np.int64(numbers[ROW, j]), known[WEIGHT, j], F(0.0)
        for k in range(ends[j], ends[j + 1], 2):
            total += airlight_to(table, c, row, weight, places[k + 1]) - airlight_to(table, c, row, weight, places[k])
        known[SUM, j] = total


@kernel(inline=True)
def lamp_strengths(media, c, table, reach, known, numbers, count):
    """Factors of the light of a lamp, for one channel; with the first one, rows of its table, too."""
    density = media.numbers[0, DENSITY]
    thick, scattering = media.extinction[0, c] * density, media.scattering[0, c] * density
    for j in range(count):
        away = known[VALUE, j]
        row, weight = airlight_row(table, away / reach)
        numbers[ROW, j] = np.int32(row)
        known[WEIGHT, j] = weight
        # The table holds extinction from the place nearest to the lamp on.
        known[STRENGTH, j] = scattering / away * exponential(min(thick * known[ENTER, j], F(80.0)))


@kernel(parallel=True)
def scatter_sliced(media, source, slices, beams, chosen, settings, out, missed):
    """Light of a sun or lamp along the chosen rays, which begin at the origin, in the only medium, a homogeneous one.

    Args:
        media: :class:`Media`. source: (numbers of the light, its table). slices: :class:`Slices`.
        beams: :class:`Beams`. chosen: (P,) int64 rows of rays.
        settings: (whether the light is parallel, greatest distance of the table).
        out: :class:`Scattered`; rows of other rays stay as they are.
        missed: (P / CHUNK,) int64, written: rays of each piece of work that come closer to the lamp than it gets
            brighter; nothing is told of them.
    """
    sun, reach = settings
    channels = media.extinction.shape[1]
    total = slices.rows.shape[1]
    for chunk in prange(len(missed)):
        fields, cuts, lamp = borrowed(media), borrowed(slices), borrowed(source)
        _, direction, span = borrowed(beams)
        radiance, told = borrowed(out)
        every, light, table = borrowed(chosen), lamp[0], lamp[1]
        own = (
            np.empty((ROOM, GROUP), F), np.empty((2, GROUP), np.int32), np.empty(GROUP + 1, np.int64),
            np.empty(GROUP * (total + 4), F), np.empty(total + 1, np.int64), np.empty((6, GROUP * (total + 4)), F),
        )  # fmt: skip
        known, numbers, ends, places, found, parts = borrowed(own)
        scratch, lost = (places, found, levels_above(total)), np.int64(0)
        begin, end = block_of(chunk, CHUNK, len(every))
        for first in range(begin, end, GROUP):
            rows = every[first : min(first + GROUP, end)]
            place_rays(sun, cuts.numbers, (direction, span), rows, known, numbers)
            ends[0] = 0
            for j in range(len(rows)):
                i, a, b = rows[j], known[BEGIN, j], known[END, j]
                told[i, 0], told[i, 1], told[i, 2] = F(0.0), F(0.0), F(0.0)
                ends[j + 1] = ends[j]
                if not sun:
                    known[VALUE, j] = known[WEIGHT, j]
                if not b > a:
                    continue
                if not sun and known[WEIGHT, j] <= light[NEAREST]:
                    lost += 1
                    told[i, 1] = F(-1.0)
                    continue
                ends[j + 1], looks = changes_along(cuts, j, sun, known, numbers, scratch, ends[j])
                share = F(0.0)
                for k in range(ends[j], ends[j + 1], 2):
                    share += places[k + 1] - places[k]
                told[i, 0] = share / (b - a)
                told[i, 1] = F((ends[j + 1] - ends[j]) >> 1)
                told[i, 2] = F(looks)
            for c in range(channels):
                if sun:
                    sun_pieces(fields, c, light, direction, rows, known)
                    sum_sunlight(known, places, ends, len(rows), parts)
                else:
                    lamp_strengths(fields, c, table, reach, known, numbers, len(rows))
                    sum_lamplight(table, c, known, numbers, places, ends, len(rows))
                for j in range(len(rows)):
                    radiance[rows[j], c] = max(known[SUM, j], F(0.0)) * known[STRENGTH, j]
        missed[chunk] = lost
        keep(own)
