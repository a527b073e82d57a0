"""What a light would bring to the nodes of a ray's panels if nothing stood in its way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import SHADOWING, box_span, mean_of_exponential, trilinear, way_through
from torchrender.kernels.media.functions import exponential, tangent
from torchrender.kernels.media.records import (
    AMBIENT,
    AREA,
    AXIS,
    BIG,
    DENSITY,
    FADE,
    FALLOFF,
    FLAT,
    GRID,
    GROUND,
    HEIGHT,
    INNER,
    NEAREST,
    OUTER,
    RECT,
    SPOT,
    SQUARE,
    SUN,
    G,
)

F: Any = np.float32
PER_SPHERE = F(0.25 / math.pi)


@kernel(inline=True)
def phase(g, cosine):
    """Henyey-Greenstein, per steradian; ``cosine`` between the ways of the light before and after."""
    if g == F(0.0):
        return PER_SPHERE
    # 1 + g^2 - 2 g c, without cancellation where light hardly turns, or turns back.
    away, turn = F(1.0) - abs(g), F(1.0) - (cosine if g > F(0.0) else -cosine)
    base = max(away * away + F(2.0) * abs(g) * turn, F(1e-8))
    return PER_SPHERE * (F(1.0) - g * g) / (base * math.sqrt(base))


@kernel(inline=True)
def falloff(kind, light, r2, along, d, offset):
    """What of a lamp's power arrives at a place of a ray, per squared length.

    Args:
        r2: squared distance. along: place on the ray, from the one nearest to the lamp.
        offset: (3,) from the lamp to the nearest place.
    """
    value = F(1.0) / max(r2, light[NEAREST] * light[NEAREST]) if light[SQUARE] > F(0.0) else F(1.0)
    faded = r2 * light[FADE]
    value *= max(F(1.0) - faded * faded, F(0.0))
    if kind == SPOT or kind == RECT:
        inverse = F(1.0) / max(math.sqrt(r2), F(1e-20))
        cosine, off = F(0.0), F(0.0)
        for c in range(3):
            toward, axis = (offset[c] + d[c] * along) * inverse, light[AXIS + c]
            cosine += axis * toward
            off += (toward - axis) * (toward - axis)
        if kind == SPOT:  # one minus a cosine of float32 has no digits left in narrow cones
            share = (light[OUTER] - F(0.5) * off) / (light[OUTER] - light[INNER])
            share = min(max(share, F(0.0)), F(1.0))
            return value * share * share
        near = F(1.0) / (r2 + light[AREA] * F(0.5 / math.pi)) if light[SQUARE] > F(0.0) else F(1.0)
        return near * light[AREA] * max(cosine, F(0.0))
    return value


@kernel(inline=True)
def light_way(media, m, kind, light, x, y, z):
    """Integral of the density of medium ``m`` on the way from a light to a place."""
    if kind == SUN:
        wx, wy, wz, length = -light[AXIS], -light[AXIS + 1], -light[AXIS + 2], F(1e30)
    else:
        wx, wy, wz = light[0] - x, light[1] - y, light[2] - z
        length = math.sqrt(wx * wx + wy * wy + wz * wz)
        inverse = F(1.0) / max(length, F(1e-20))
        wx, wy, wz = wx * inverse, wy * inverse, wz * inverse
    low, high = media.low[m], media.high[m]
    inside = x >= low[0] and x <= high[0] and y >= low[1] and y <= high[1] and z >= low[2] and z <= high[2]
    if media.kind[m] == GRID and inside:
        _, end = box_span(low, high, x, y, z, wx, wy, wz)
        way = max(min(end, length), F(0.0))
        return way * trilinear(media.means, media.coarse[m], low, high, x, y, z)
    return way_through(media, m, (x, y, z), (wx, wy, wz), length, SHADOWING)


@kernel(inline=True)
def fill_nodes(media, kind, light, ray, part, nodes):
    """Factor and exponent of the light that the nodes send to the eye, for all channels.

    Args:
        ray: (origin, direction, t0, away, offset from the lamp to the ray's nearest place).
        part: (begin, end) in lengths, (first, last) in panels' variable, nodes, active media (M,) bool, and whether
            the variable is the angle at the lamp.
        nodes: (factor (C,N), exponent (C,N), length (N,), variable (N,), scratch (3,N), optical depth before (C,)),
            written; the last becomes that at the end.
    """
    _, _, t0, away, _ = ray
    begin, end, first, last, count, active, angles = part
    _, _, lengths, variable, _, _ = nodes
    inverse_count = F(1.0) / F(count - 1)
    for j in range(count):
        share = F(j) * inverse_count
        if angles:
            # Denser towards both ends, where extinction changes within little angle.
            share = share * share * (F(3.0) - F(2.0) * share)
            x = first + (last - first) * share
            t = t0 + away * tangent(x)
        else:
            x = first + (last - first) * share
            t = x
        variable[j] = x
        lengths[j] = min(max(t, begin), end)
    lengths[0], lengths[count - 1] = begin, end
    variable[count - 1] = last
    light_nodes(media, kind, light, ray, (active, count, angles), nodes)


@kernel(inline=True)
def light_nodes(media, kind, light, ray, part, nodes):
    """Factor and exponent of nodes whose lengths are given, as :func:`fill_nodes`.

    Args:
        part: active media (M,) bool, nodes, and whether light is told per angle at the lamp; else per length.
    """
    o, d, t0, away, offset = ray
    active, count, angles = part
    factor, exponent, lengths, _, scratch, before = nodes
    channels = media.extinction.shape[1]
    for j in range(count):
        along = lengths[j] - t0
        if kind == SUN or kind == AMBIENT:
            base = F(1.0)
        else:
            near = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]
            base = falloff(kind, light, near + along * along, along, d, offset)
            if angles:
                base *= (away * away + along * along) / away
        scratch[0, j] = base
    for c in range(channels):
        for j in range(count):
            factor[c, j] = F(0.0)
            exponent[c, j] = before[c]
    for m in range(media.low.shape[0]):
        if active[m]:
            add_active(media, m, kind, light, ray, lengths, count, nodes)
        if kind != AMBIENT:
            within = active[m]
            if within and kind != SUN:
                for c in range(3):
                    within = within and light[c] >= media.low[m, c] and light[c] <= media.high[m, c]
            if within:
                add_ways_inside(media, m, kind, light, ray, count, nodes)
                continue
            for j in range(count):
                t = lengths[j]
                way = light_way(media, m, kind, light, o[0] + d[0] * t, o[1] + d[1] * t, o[2] + d[2] * t)
                for c in range(channels):
                    exponent[c, j] += media.extinction[m, c] * way


@kernel(inline=True)
def add_ways_inside(media, m, kind, light, ray, count, nodes):
    """Add the ways from the light to the nodes through a medium that nodes and lamp lie in, as :func:`light_way`.

    Densities at the nodes are those that :func:`add_active` left.
    """
    o, d, t0, _, offset = ray
    _, exponent, lengths, _, scratch, _ = nodes
    low, high, of, density = media.low[m], media.high[m], media.kind[m], scratch[1]
    a, b, ground = media.numbers[m, DENSITY], media.numbers[m, FALLOFF], media.numbers[m, GROUND]
    at_lamp = F(0.0)
    if of == HEIGHT and kind != SUN:
        at_lamp = a * exponential(b * (ground - light[1]))
    # To the sun: the sides that ways leave through, and lengths per distance from them.
    sx, sy, sz = -light[AXIS], -light[AXIS + 1], -light[AXIS + 2]
    gx = high[0] if sx > F(0.0) else low[0]
    gy = high[1] if sy > F(0.0) else low[1]
    gz = high[2] if sz > F(0.0) else low[2]
    ix = F(0.0) if sx == F(0.0) else F(1.0) / sx
    iy = F(0.0) if sy == F(0.0) else F(1.0) / sy
    iz = F(0.0) if sz == F(0.0) else F(1.0) / sz
    near = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]
    for j in range(count):
        t = lengths[j]
        x, y, z = o[0] + d[0] * t, o[1] + d[1] * t, o[2] + d[2] * t
        if kind == SUN:
            length = F(BIG)
            if ix != F(0.0):
                length = min(length, (gx - x) * ix)
            if iy != F(0.0):
                length = min(length, (gy - y) * iy)
            if iz != F(0.0):
                length = min(length, (gz - z) * iz)
            length = max(length, F(0.0))
            climb = sy * length
        else:
            length = math.sqrt(near + (t - t0) * (t - t0))
            climb = light[1] - y
        if of == FLAT:
            way = a * length
        elif of == HEIGHT:
            last = density[j] * exponential(-b * climb) if kind == SUN else at_lamp
            way = length * mean_of_exponential(density[j], last, b * climb)
        else:
            way = length * trilinear(media.means, media.coarse[m], low, high, x, y, z)
        for c in range(media.extinction.shape[1]):
            exponent[c, j] += media.extinction[m, c] * way


@kernel(inline=True)
def along_grid(media, m, o, d, lengths, count, density, eye):
    """Densities at the nodes, and integrals up to them.

    Nodes of equal angle are far apart away from a lamp: a grid is asked as often between two of them as elsewhere.
    """
    begin, end = lengths[0], lengths[count - 1]
    low, high, dims = media.low[m], media.high[m], media.dims[m]
    longest = (end - begin) * F(1.01) / F(count - 1)
    x, y, z = o[0] + d[0] * begin, o[1] + d[1] * begin, o[2] + d[2] * begin
    density[0] = trilinear(media.cells, dims, low, high, x, y, z)
    eye[0] = F(0.0)
    for j in range(1, count):
        way = lengths[j] - lengths[j - 1]
        parts = np.int64(min(max(way / max(longest, F(1e-20)), F(0.0)), F(1e4))) + 1
        step = way / F(parts)
        value, total = density[j - 1], F(0.0)
        for k in range(parts):
            t = lengths[j - 1] + F(k + 1) * step
            after = trilinear(media.cells, dims, low, high, o[0] + d[0] * t, o[1] + d[1] * t, o[2] + d[2] * t)
            total += F(0.5) * (value + after)
            value = after
        density[j] = value
        eye[j] = eye[j - 1] + total * step


@kernel(inline=True)
def add_active(media, m, kind, light, ray, lengths, count, nodes):
    """Add a medium that the nodes lie in."""
    o, d, t0, _, offset = ray
    factor, exponent, _, _, scratch, before = nodes
    channels = media.extinction.shape[1]
    begin = lengths[0]
    density, eye = scratch[1], scratch[2]
    if media.kind[m] == GRID:
        along_grid(media, m, o, d, lengths, count, density, eye)
    elif media.kind[m] == FLAT:
        a = media.numbers[m, DENSITY]
        for j in range(count):
            density[j] = a
            eye[j] = a * (lengths[j] - begin)
    else:
        a, b, ground = media.numbers[m, DENSITY], media.numbers[m, FALLOFF], media.numbers[m, GROUND]
        for j in range(count):
            density[j] = a * exponential(b * (ground - o[1] - d[1] * lengths[j]))
        for j in range(count):
            way = lengths[j] - begin
            eye[j] = way * mean_of_exponential(density[0], density[j], b * d[1] * way)
    g = media.numbers[m, G]
    near = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]
    turned = PER_SPHERE
    if kind == SUN:
        turned = phase(g, -(light[AXIS] * d[0] + light[AXIS + 1] * d[1] + light[AXIS + 2] * d[2]))
    for j in range(count):
        if kind == AMBIENT:
            value = density[j] * scratch[0, j]
        elif kind == SUN or g == F(0.0):
            value = density[j] * scratch[0, j] * turned
        else:
            along = lengths[j] - t0
            value = density[j] * scratch[0, j] * phase(g, -along / math.sqrt(max(near + along * along, F(1e-30))))
        for c in range(channels):
            factor[c, j] += media.scattering[m, c] * value
            exponent[c, j] += media.extinction[m, c] * eye[j]
    for c in range(channels):
        before[c] += media.extinction[m, c] * eye[count - 1]
