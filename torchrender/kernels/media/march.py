"""Steps along every ray with a look-up each: the way of the source, and the slow reference of the others, in float64.

Source: specification 09, section 3, and Kulla, Fajardo, Importance sampling techniques for path tracing in
participating media, 2012, for steps of equal angle at a lamp.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import density_at, way_through
from torchrender.kernels.media.nodes import falloff, phase
from torchrender.kernels.media.records import AXIS, SQUARE, SUN, G
from torchrender.kernels.voxels.bits import span as block_of

GROUP = 64  # rays that a thread takes at a time
EYE_STEPS = 4  # through a grid, within a step
EXACT_SEGMENT, SOURCE = 0, 1
EVERYWHERE, LOOKED_UP, GIVEN = 0, 1, 2
"""How it is known where a ray is lit: it is everywhere, by the light's depth images, or it is given."""


@kernel(inline=True)
def looked_up(depth, views, parallel, x, y, z):
    """A place is lit, by the nearest texel; beside the image of parallel light it is, behind a cone it is not."""
    best, size = -1, -np.inf
    for n in range(views.shape[0]):
        m = views[n]
        w = m[8] * x + m[9] * y + m[10] * z + m[11]
        if w > size:
            best, size = n, w
    m = views[best]
    u = m[12] * (m[0] * x + m[1] * y + m[2] * z + m[3])
    v = m[13] * (m[4] * x + m[5] * y + m[6] * z + m[7])
    if not parallel:
        if size <= 0.0:
            return False
        u, v = u / size, v / size
    column, row = math.floor(u + m[14]), math.floor(v + m[15])
    if column < 0 or row < 0 or column >= depth.shape[2] or row >= depth.shape[1]:
        return parallel
    return size <= depth[best, np.int64(row), np.int64(column)]


@kernel(inline=True)
def step_at(k, count, span, lamp):
    """Ray length at a share of the steps: of equal length, or of equal angle at a lamp."""
    begin, end = span
    t0, away, first, last, angles = lamp
    if not angles:
        return begin + (end - begin) * k / count
    return min(max(t0 + away * math.tan(first + (last - first) * k / count), begin), end)


@kernel()
def towards_lamp(kind, light, o, d, span, equiangular):
    """Place on the ray that is nearest to the lamp, distance there and vector to it, and angles of the ray's ends."""
    if kind == SUN:
        return (0.0, 1.0, 0.0, 0.0, False), (0.0, 0.0, 0.0)
    t0 = d[0] * (light[0] - o[0]) + d[1] * (light[1] - o[1]) + d[2] * (light[2] - o[2])
    offset = (o[0] + d[0] * t0 - light[0], o[1] + d[1] * t0 - light[1], o[2] + d[2] * t0 - light[2])
    away = max(math.sqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]), 1e-9)
    first, last = math.atan2(span[0] - t0, away), math.atan2(span[1] - t0, away)
    return (t0, away, first, last, equiangular and light[SQUARE] > 0.0), offset


@kernel()
def arriving(media, kind, light, place, ray, light_steps, out):
    """What a place scatters towards the eye per unit of length, in ``out[0]``, and its extinction, in ``out[1]``."""
    x, y, z = place
    d, along, offset = ray
    if kind == SUN:
        base, cosine = 1.0, -(light[AXIS] * d[0] + light[AXIS + 1] * d[1] + light[AXIS + 2] * d[2])
        wx, wy, wz, length = -light[AXIS], -light[AXIS + 1], -light[AXIS + 2], 1e30
    else:
        r2 = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2] + along * along
        base = falloff(kind, light, r2, along, d, offset)
        length = math.sqrt(r2)
        cosine = -along / max(length, 1e-30)
        wx, wy, wz = light[0] - x, light[1] - y, light[2] - z
        inverse = 1.0 / max(length, 1e-30)
        wx, wy, wz = wx * inverse, wy * inverse, wz * inverse
    channels = media.extinction.shape[1]
    for c in range(channels):
        out[0, c], out[1, c], out[2, c] = 0.0, 0.0, 0.0
    for m in range(media.low.shape[0]):
        low, high = media.low[m], media.high[m]
        way = way_through(media, m, place, (wx, wy, wz), length, light_steps)
        density, turned = 0.0, 0.0
        if x >= low[0] and x <= high[0] and y >= low[1] and y <= high[1] and z >= low[2] and z <= high[2]:
            density = density_at(media, m, x, y, z)
            turned = phase(media.numbers[m, G], cosine)
        for c in range(channels):
            out[0, c] += media.scattering[m, c] * density * turned * base
            out[1, c] += media.extinction[m, c] * density
            out[2, c] += media.extinction[m, c] * way
    for c in range(channels):
        out[0, c] *= math.exp(-out[2, c])


@kernel()
def eye_ways(media, o, d, lengths, out):
    """Optical depths of a step per channel: up to its sample in ``out[1]``, of all of it in ``out[2]``.

    Steps of equal angle are long far from the lamp: one density would not do for all of them.
    """
    a, t, b = lengths
    x, y, z = o[0] + d[0] * a, o[1] + d[1] * a, o[2] + d[2] * a
    channels = media.extinction.shape[1]
    for c in range(channels):
        out[1, c], out[2, c] = 0.0, 0.0
    for m in range(media.low.shape[0]):
        part = way_through(media, m, (x, y, z), d, t - a, EYE_STEPS)
        there = (x + d[0] * (t - a), y + d[1] * (t - a), z + d[2] * (t - a))
        whole = part + way_through(media, m, there, d, b - t, EYE_STEPS)
        for c in range(channels):
            out[1, c] += media.extinction[m, c] * part
            out[2, c] += media.extinction[m, c] * whole


@kernel()
def march_ray(media, source, seen, ray, settings, work, out):
    """One ray: light per channel in ``out[0]``, lit share and number of lit parts in ``out[1]``."""
    kind, light = source
    way, depth, views, parallel, visible = seen
    o, d, begin, end, shift = ray
    steps, scheme, equiangular, light_steps = settings
    radiance, told = out
    channels = media.extinction.shape[1]
    before, arrived = work
    lamp, offset = towards_lamp(kind, light, o, d, (begin, end), equiangular)
    t0, away, first, last, angles = lamp
    lit, parts, was = 0, 0, False
    for c in range(channels):
        before[c] = 0.0
        radiance[c] = 0.0
    for k in range(steps):
        a, b = step_at(k, steps, (begin, end), lamp), step_at(k + 1, steps, (begin, end), lamp)
        t = step_at(k + shift, steps, (begin, end), lamp)
        place = (o[0] + d[0] * t, o[1] + d[1] * t, o[2] + d[2] * t)
        arriving(media, kind, light, place, (d, t - t0, offset), light_steps, arrived)
        sees = way == EVERYWHERE
        if way == LOOKED_UP:
            sees = looked_up(depth, views, parallel, place[0], place[1], place[2])
        elif way == GIVEN:
            sees = visible[k]
        if angles:
            eye_ways(media, o, d, (a, t, b), arrived)
        for c in range(channels):
            thick = arrived[2, c] if angles else arrived[1, c] * (b - a)
            if sees:
                if angles:
                    # Per angle: the square of the distance cancels what falls off with it.
                    weight = (away * away + (t - t0) * (t - t0)) / away * (last - first) / steps
                    weight *= math.exp(-arrived[1, c])
                elif scheme == SOURCE or thick < 1e-6:
                    weight = b - a
                else:
                    weight = -math.expm1(-thick) / arrived[1, c]
                radiance[c] += math.exp(-before[c]) * arrived[0, c] * weight
            before[c] += thick
        lit += sees
        parts += sees and not was
        was = sees
    told[0], told[1], told[2] = lit / steps, parts, steps


@kernel(parallel=True)
def march_rays(media, source, depth, seen, beams, chosen, settings, out):
    """Light of one source along the chosen rays, step by step.

    Args:
        media: :class:`Media` in float64. source: (12,) float64 numbers of the light.
        depth: (V,H,W) float32 of its views.
        seen: (views (V,16) float64, visible (N,steps) bool or (0,0), shifts (N,) in [0,1)): how far into a step a ray's
            samples lie.
        beams: :class:`Beams`. chosen: (P,) int64 rows of rays.
        settings: (kind of light, way, parallel, steps, scheme, equiangular, steps towards the light).
        out: :class:`Scattered`; rows of other rays stay as they are.
    """
    kind, way, parallel, steps, scheme, equiangular, light_steps = settings
    views, visible, shifts = seen
    channels = media.extinction.shape[1]
    for group in prange((len(chosen) + GROUP - 1) // GROUP):
        fields, light, images = borrowed(media), borrowed(source), borrowed(depth)
        where, given, shift = borrowed(views), borrowed(visible), borrowed(shifts)
        origin, direction, span = borrowed(beams)
        radiance, told = borrowed(out)
        rows = borrowed(chosen)
        work = (np.empty(channels), np.empty((3, channels)))
        o, d = np.empty(3), np.empty(3)
        begin, end = block_of(group, GROUP, len(rows))
        for n in range(begin, end):
            i = rows[n]
            k = i if len(origin) > 1 else 0
            for c in range(channels):
                radiance[i, c] = 0.0
            for c in range(3):
                o[c], d[c] = origin[k, c], direction[i, c]
                told[i, c] = 0.0
            if span[i, 1] > span[i, 0]:
                ray = (o, d, np.float64(span[i, 0]), np.float64(span[i, 1]), shift[i])
                row = given[i] if len(given) > 0 else given[:0].reshape(-1)
                march_ray(
                    fields, (kind, light), (way, images, where, parallel, row), ray,
                    (steps, scheme, equiangular, light_steps), work, (radiance[i], told[i]),
                )  # fmt: skip
