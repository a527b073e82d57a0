"""Closed forms for one homogeneous medium.

A lamp: one table gives the light from any stretch of any ray. With the angle at the lamp as variable, extinction on
both ways is ``exp(-u (tan x + 1 / cos x))``, where ``u`` is the optical depth of the ray's distance from the lamp.
Sources: Sun, Ramamoorthi, Narasimhan, Nayar, A practical analytic single scattering model for real time rendering,
2005; the angle: Lecocq, Michelin, Arques, Kemeny, 2000.

The sun: the way to it through the box is the least of three linear functions of the place on the ray, so that light
is one exponential function between any two places where another of these becomes the least.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import mean_of_exponential
from torchrender.kernels.media.functions import exponential
from torchrender.kernels.media.nodes import phase
from torchrender.kernels.media.records import AXIS, BIG, DENSITY, G

F: Any = np.float32
HALF_TURN = F(math.pi)


@kernel(parallel=True)
def fill_airlight(optical_depths, g, table):
    """``table[c, i, j]``: integral to angle j, in (-pi/2, pi/2), of phase function times extinction.

    Args:
        optical_depths: (C,) of the greatest distance from the lamp; row i belongs to ``(i / (rows - 1))^2`` of it.
        table: (C,R,K) float32, written.
    """
    channels, rows, columns = table.shape
    width = math.pi / (columns - 1)
    # What no optical depth changes: Gauss, two points to a column.
    ways, turned = np.empty(2 * columns, F), np.empty(2 * columns, F)
    for j in range(1, columns):
        for k in range(2):
            x = -0.5 * math.pi + (j - 0.5 + (k - 0.5) * 0.5773502691896257) * width
            # tan x + 1 / cos x = tan(x / 2 + pi / 4), without the difference of two large numbers.
            ways[2 * j + k] = math.tan(0.5 * x + 0.25 * math.pi)
            turned[2 * j + k] = 0.5 * width * np.float64(phase(F(g), F(-math.sin(x))))
    for row in prange(channels * rows):
        c, i = row // rows, row % rows
        share = i / (rows - 1.0)
        u = F(np.float64(optical_depths[c]) * share * share)
        total = 0.0
        table[c, i, 0] = F(0.0)
        for j in range(1, columns):
            total += exponential(-u * ways[2 * j]) * turned[2 * j]
            total += exponential(-u * ways[2 * j + 1]) * turned[2 * j + 1]
            table[c, i, j] = F(total)


@kernel(inline=True)
def airlight_to(table, c, row, weight, x):
    """Integral to angle ``x``; ``row`` and ``weight`` from :func:`airlight_row`."""
    columns = table.shape[2]
    v = (x + F(0.5) * HALF_TURN) * (F(columns - 1) / HALF_TURN)
    j = min(max(np.int32(v), np.int32(0)), np.int32(columns - 2))
    v = min(max(v - F(j), F(0.0)), F(1.0))
    a = table[c, row, j] + (table[c, row, j + 1] - table[c, row, j]) * v
    b = table[c, row + 1, j] + (table[c, row + 1, j + 1] - table[c, row + 1, j]) * v
    return a + (b - a) * weight


@kernel(inline=True)
def airlight_row(table, share):
    """Row of the table and weight of the next one for a distance that is this share of the greatest."""
    rows = table.shape[1]
    at = math.sqrt(min(max(share, F(0.0)), F(1.0))) * F(rows - 1)
    row = min(np.int32(at), np.int32(rows - 2))
    lower, upper = F(row) / F(rows - 1), F(row + 1) / F(rows - 1)
    lower, upper = lower * lower, upper * upper
    return row, (share - lower) / (upper - lower)


@kernel(inline=True)
def add_sunlight(media, light, o, d, begin, a, b, radiance):
    """Add to ``radiance`` (C,) what the only medium, a homogeneous one, scatters of the sun between two lengths.

    Args:
        begin: length at which the ray enters the medium; ``a`` and ``b`` lie behind it, inside.
    """
    sx, sy, sz = light[AXIS], light[AXIS + 1], light[AXIS + 2]
    low, high = media.low[0], media.high[0]
    # Way to the sun, value + rate t, until the box ends along each axis.
    vx = vy = vz = F(BIG)
    rx = ry = rz = F(0.0)
    if sx != F(0.0):
        inverse = F(1.0) / sx
        vx, rx = (o[0] - (low[0] if sx > F(0.0) else high[0])) * inverse, d[0] * inverse
    if sy != F(0.0):
        inverse = F(1.0) / sy
        vy, ry = (o[1] - (low[1] if sy > F(0.0) else high[1])) * inverse, d[1] * inverse
    if sz != F(0.0):
        inverse = F(1.0) / sz
        vz, rz = (o[2] - (low[2] if sz > F(0.0) else high[2])) * inverse, d[2] * inverse
    density = media.numbers[0, DENSITY]
    turned = density * phase(media.numbers[0, G], -(sx * d[0] + sy * d[1] + sz * d[2]))
    t = a
    while t < b:
        x, y, z = vx + rx * t, vy + ry * t, vz + rz * t
        value, rate = x, rx
        if y < value or (y == value and ry < rate):
            value, rate = y, ry
        if z < value or (z == value and rz < rate):
            value, rate = z, rz
        stop = b
        if rx < rate:
            stop = min(stop, t + max((x - value) / (rate - rx), F(0.0)))
        if ry < rate:
            stop = min(stop, t + max((y - value) / (rate - ry), F(0.0)))
        if rz < rate:
            stop = min(stop, t + max((z - value) / (rate - rz), F(0.0)))
        if not stop > t:  # the next function is less already, by rounding
            stop = min(t + F(1e-5) * (b - a) + F(1e-6) * abs(t), b)
            if not stop > t:
                break
        for c in range(media.extinction.shape[1]):
            thick = media.extinction[0, c] * density
            first = thick * (t - begin + max(value, F(0.0)))
            rise = thick * (F(1.0) + rate) * (stop - t)
            part = mean_of_exponential(exponential(-first), exponential(-first - rise), rise)
            radiance[c] += media.scattering[0, c] * turned * (stop - t) * part
        t = stop
