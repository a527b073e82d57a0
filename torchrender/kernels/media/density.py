"""Densities and their integrals along straight ways, in float32. Source: specification 09, section 3."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.functions import exponential
from torchrender.kernels.media.records import BIG, DENSITY, FALLOFF, FLAT, GROUND, HEIGHT

F: Any = np.float32
SHADOWING = 24
"""Steps through a grid that lies before a light, where its mean towards the light is not known."""


@kernel(inline=True)
def mean_of_exponential(first, last, fall):
    """Mean of a density between two places, where it is ``first`` and ``last = first exp(-fall)``."""
    if abs(fall) < F(1e-2):
        return first * (F(1.0) - fall * (F(0.5) - fall * F(1.0 / 6.0)))
    return (first - last) / fall


@kernel(inline=True)
def box_span(low, high, px, py, pz, dx, dy, dz):
    """Lengths at which a straight line is inside a box; the first is greater where it misses."""
    begin, end = -BIG, BIG
    for c in range(3):
        p = px if c == 0 else py if c == 1 else pz
        d = dx if c == 0 else dy if c == 1 else dz
        if d == F(0.0):
            if p < low[c] or p > high[c]:
                return F(1.0), F(0.0)
            continue
        inverse = F(1.0) / d
        a, b = (low[c] - p) * inverse, (high[c] - p) * inverse
        begin, end = max(begin, min(a, b)), min(end, max(a, b))
    return begin, end


@kernel(inline=True)
def trilinear(cells, dims, low, high, x, y, z):
    """Density of a grid at a place: between the eight nearest cells, at the border that of the nearest ones."""
    first = dims[3]
    u = (x - low[0]) / (high[0] - low[0]) * F(dims[2]) - F(0.5)
    v = (y - low[1]) / (high[1] - low[1]) * F(dims[1]) - F(0.5)
    w = (z - low[2]) / (high[2] - low[2]) * F(dims[0]) - F(0.5)
    u = min(max(u, F(0.0)), F(dims[2] - 1))
    v = min(max(v, F(0.0)), F(dims[1] - 1))
    w = min(max(w, F(0.0)), F(dims[0] - 1))
    i, j, k = min(np.int32(u), np.int32(dims[2] - 2)), min(np.int32(v), np.int32(dims[1] - 2)), np.int32(w)
    k = min(k, np.int32(dims[0] - 2))
    i, j, k = max(i, np.int32(0)), max(j, np.int32(0)), max(k, np.int32(0))
    u, v, w = u - F(i), v - F(j), w - F(k)
    di = 1 if dims[2] > 1 else 0
    dj = dims[2] if dims[1] > 1 else 0
    dk = dims[2] * dims[1] if dims[0] > 1 else 0
    at = first + (np.int64(k) * dims[1] + np.int64(j)) * dims[2] + np.int64(i)
    a = cells[at] + (cells[at + di] - cells[at]) * u
    b = cells[at + dj] + (cells[at + dj + di] - cells[at + dj]) * u
    at += dk
    c = cells[at] + (cells[at + di] - cells[at]) * u
    d = cells[at + dj] + (cells[at + dj + di] - cells[at + dj]) * u
    a, c = a + (b - a) * v, c + (d - c) * v
    return a + (c - a) * w


@kernel(inline=True)
def density_at(media, m, x, y, z):
    """Density of medium ``m`` at a place inside its box."""
    kind = media.kind[m]
    if kind == FLAT:
        return media.numbers[m, DENSITY]
    if kind == HEIGHT:
        return media.numbers[m, DENSITY] * exponential(media.numbers[m, FALLOFF] * (media.numbers[m, GROUND] - y))
    return trilinear(media.cells, media.dims[m], media.low[m], media.high[m], x, y, z)


@kernel(inline=True)
def height_integral(media, m, y, dy, length):
    """Integral of a density that falls off with height over a way that begins at height ``y`` and climbs by ``dy``."""
    a, b, ground = media.numbers[m, DENSITY], media.numbers[m, FALLOFF], media.numbers[m, GROUND]
    first, last = a * exponential(b * (ground - y)), a * exponential(b * (ground - y - dy))
    return length * mean_of_exponential(first, last, b * dy)


@kernel(inline=True)
def way_through(media, m, p, d, length, steps):
    """Integral of the density of medium ``m`` over a way of ``length`` along a unit direction, of any part in its box.

    Through grids it takes ``steps`` steps.
    """
    px, py, pz = p[0], p[1], p[2]
    dx, dy, dz = d[0], d[1], d[2]
    begin, end = box_span(media.low[m], media.high[m], px, py, pz, dx, dy, dz)
    begin, end = max(begin, F(0.0)), min(end, length)
    if not end > begin:
        return F(0.0)
    way = end - begin
    kind = media.kind[m]
    if kind == FLAT:
        return media.numbers[m, DENSITY] * way
    if kind == HEIGHT:
        return height_integral(media, m, py + dy * begin, dy * way, way)
    total, step = F(0.0), way / F(steps)
    low, high, dims = media.low[m], media.high[m], media.dims[m]
    for k in range(steps):
        t = begin + (F(k) + F(0.5)) * step
        total += trilinear(media.cells, dims, low, high, px + dx * t, py + dy * t, pz + dz * t)
    return total * step
