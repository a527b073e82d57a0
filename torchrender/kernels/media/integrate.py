"""Light of one source that media scatter along rays towards the eye. Source: specification 09, sections 3 and 12.

First where a ray is lit, then what arrives from there: differences of one integral along the ray.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.airlight import add_sunlight, airlight_row, airlight_to
from torchrender.kernels.media.functions import arctan2, tangent
from torchrender.kernels.media.lattice import lattice_knows, lattice_to
from torchrender.kernels.media.nodes import fill_nodes
from torchrender.kernels.media.panels import WIDTH, fill_panel, integral_to
from torchrender.kernels.media.records import AMBIENT, FLAT, NEAREST, SQUARE, SUN
from torchrender.kernels.media.spans import PLACES, break_points, light_span, slice_ray
from torchrender.kernels.media.walk import walk_ray
from torchrender.kernels.voxels.bits import span as block_of

F: Any = np.float32
EVERYWHERE, WALKED, SLICED = 0, 1, 2
"""How it is found out where a ray is lit: it is everywhere, by a walk, by slices."""
GROUP = 256  # rays that a thread takes at a time
NEAR = 4  # times as many panels where a ray comes as near to a lamp as that gets no brighter
SHARE, PARTS, LOOKS = 0, 1, 2
"""What is told of a ray: its lit share (of the panels' variable), lit parts, and cells that were looked at."""


@kernel(inline=True)
def fill_panels(media, kind, light, ray, ends, steps, angles, scratch):
    """Panels of a ray for all channels; returns their number. ``scratch``: see :func:`scatter_rays`.

    ``ends``: where the ray begins, where it begins to be lit, and where it ends."""
    o, d, t0, away, _ = ray
    start, begin, end = ends
    panels, nodes, points, active = scratch
    factor, exponent, _, variable, _, before = nodes
    channels = media.extinction.shape[1]
    pieces = break_points(media, kind, light, o, d, start, end, points)
    if begin > start:
        last_one = pieces
        while points[last_one - 1] > begin:
            points[last_one] = points[last_one - 1]
            last_one -= 1
        points[last_one] = begin
        pieces += 1
    whole = arctan2(end - t0, away) - arctan2(begin - t0, away) if angles else end - begin
    count = np.int64(0)
    for c in range(channels):
        before[c] = F(0.0)
    for piece in range(pieces - 1):
        ta, tb = points[piece], points[piece + 1]
        if not tb > ta:
            continue
        middle = F(0.5) * (ta + tb)
        met = False
        for m in range(media.low.shape[0]):
            inside = True
            for c in range(3):
                at = o[c] + d[c] * middle
                inside = inside and at >= media.low[m, c] and at <= media.high[m, c]
            active[m] = inside
            met = met or inside
        if not met:
            continue
        first, last = ta, tb
        if angles:
            first, last = arctan2(ta - t0, away), arctan2(tb - t0, away)
        number = np.int64(F(steps) * (last - first) / max(whole, F(1e-30))) + 1
        if tb <= begin:
            number = np.int64(F(steps) * (tb - ta) / (begin - start)) + 1
        number = min(max(number, np.int64(2)), np.int64(steps))
        number = min(number, np.int64(panels.shape[1]) - count)
        if number <= 0 or not last > first:
            continue
        part = (ta, tb, first, last, 2 * number + 1, active, angles)
        fill_nodes(media, kind, light, ray, part, nodes)
        for c in range(channels):
            total = F(0.0)
            if count > 0:
                panel = panels[c, count - 1]
                total = panel[8]
            for k in range(number):
                a = (factor[c, 2 * k], factor[c, 2 * k + 1], factor[c, 2 * k + 2])
                e = (exponent[c, 2 * k], exponent[c, 2 * k + 1], exponent[c, 2 * k + 2])
                panel = panels[c, count + k]
                total = fill_panel(panel, variable[2 * k], variable[2 * k + 2] - variable[2 * k], total, a, e)
                panel[8] = total
        count += number
    return count


@kernel(inline=True)
def lit_spans(way, images, slices, ray, angles, spans, found):
    """Lit parts of a ray between two lengths; returns their number and what was looked at.

    With ``angles`` slices tell them as angles at the lamp, all others as lengths.
    """
    o, d, begin, end = ray
    if way == WALKED:
        return walk_ray(images, o, d, begin, end, spans)
    if way == SLICED:
        return slice_ray(slices, images.parallel, angles, d, (begin, end), spans, found)
    spans[0, 0], spans[0, 1] = begin, end
    return np.int64(1), np.int64(0)


@kernel(inline=True)
def blend_lattice(lattice, corner, light, lamp, lit, radiance):
    """Light of a ray, in ``radiance``, from a lattice.

    Args:
        light: (its kind, whether parts are told as angles). lamp: (t0, away, length at which the medium begins).
        lit: (P,2) parts of the ray.
    """
    kind, angles = light
    t0, away, enter = lamp
    first = arctan2(enter - t0, away) if kind != SUN else F(0.0)
    scale = F(1.0) / away if kind != SUN else F(1.0)
    for c in range(len(radiance)):
        total = F(0.0)
        for k in range(len(lit)):
            for side in range(2):
                x, t, turned = lit[k, side], lit[k, side], F(0.0)
                if kind != SUN:
                    if angles:
                        t = t0 + away * tangent(x)
                    else:
                        x = arctan2(t - t0, away)
                    turned = x - first
                value = lattice_to(lattice, corner, c, t - enter, turned)
                total += value if side == 1 else -value
        radiance[c] = max(total, F(0.0)) * scale


@kernel(inline=True)
def scatter_ray(media, source, seen, ray, settings, scratch, out):
    """One ray: light per channel in ``out[0]``, and what is told of it in ``out[1]``."""
    kind, reach, given = source
    light, table = given.numbers, given.table
    o, d, begin, end = ray
    way, steps = settings
    panels, nodes, points, active, spans, found = scratch
    radiance, told = out
    channels = media.extinction.shape[1]
    for c in range(channels):
        radiance[c] = F(0.0)
    told[0], told[1], told[2] = F(0.0), F(0.0), F(0.0)
    begin, end = light_span(kind, light, o, d, begin, end)
    if not end > begin:
        return
    t0, away, offset = F(0.0), F(1.0), (F(0.0), F(0.0), F(0.0))
    angles = kind != SUN and kind != AMBIENT and light[SQUARE] > F(0.0)
    if kind != SUN and kind != AMBIENT:
        t0 = d[0] * (light[0] - o[0]) + d[1] * (light[1] - o[1]) + d[2] * (light[2] - o[2])
        offset = (o[0] + d[0] * t0 - light[0], o[1] + d[1] * t0 - light[1], o[2] + d[2] * t0 - light[2])
        away = math.sqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2])
    tabled = table.shape[1] > 1 and away > light[NEAREST]
    close = kind != SUN and kind != AMBIENT and away <= light[NEAREST]
    away = max(away, max(F(0.5) * light[NEAREST], F(1e-12)))
    # Slices know the ray's own distance from the lamp only: where that is less than the least one, lengths it is.
    told_angles = angles and way == SLICED and not close
    count, looks = lit_spans(way, seen[0], seen[1], (o, d, begin, end), told_angles, spans, found)
    told[2] = F(looks)
    xa = arctan2(begin - t0, away) if angles else begin
    xb = arctan2(end - t0, away) if angles else end
    lit = np.int64(0)
    low, high = (xa, xb) if told_angles else (begin, end)
    for k in range(count):
        a, b = max(spans[k, 0], low), min(spans[k, 1], high)
        if b > a:
            if angles and not told_angles:
                a, b = arctan2(a - t0, away), arctan2(b - t0, away)
            spans[lit, 0], spans[lit, 1] = a, b
            told[0] += b - a
            lit += 1
    told[0] /= max(xb - xa, F(1e-30))
    told[1] = F(lit)
    if lit == 0:
        return
    if tabled:
        row, weight = airlight_row(table, away / reach)
        # The table holds extinction from the place nearest to the lamp on.
        for c in range(channels):
            total = F(0.0)
            for k in range(lit):
                total += airlight_to(table, c, row, weight, spans[k, 1]) - airlight_to(
                    table, c, row, weight, spans[k, 0]
                )
            strength = media.scattering[0, c] * media.numbers[0, 0] / away
            optical = media.extinction[0, c] * media.numbers[0, 0] * (ray[2] - t0)
            radiance[c] = max(total, F(0.0)) * strength * F(math.exp(min(optical, F(80.0))))
        return
    if kind == SUN and media.low.shape[0] == 1 and media.kind[0] == FLAT:
        for k in range(lit):
            add_sunlight(media, light, o, d, ray[2], spans[k, 0], spans[k, 1], radiance)
        return
    if given.angle > F(0.0):
        corner = lattice_knows(given, d, t0, away, kind)
        if corner[0] >= 0:
            blend_lattice(given, corner, (kind, angles), (t0, away, ray[2]), spans[:lit], radiance)
            return
    number = fill_panels(
        media, kind, light, (o, d, t0, away, offset), (ray[2], begin, end), NEAR * steps if close else steps, angles,
        (panels, nodes, points, active),
    )  # fmt: skip
    if number == 0:
        return
    for c in range(channels):
        total, hint = F(0.0), np.int64(0)
        for k in range(lit):
            below, hint = integral_to(panels[c], number, hint, spans[k, 0])
            above, hint = integral_to(panels[c], number, hint, spans[k, 1])
            total += above - below
        radiance[c] = max(total, F(0.0))


@kernel(parallel=True)
def scatter_rays(media, source, images, slices, beams, chosen, settings, out):
    """Light of one source along the chosen rays.

    Args:
        media: :class:`Media`. source: :class:`Source`. images: :class:`Images`. slices: :class:`Slices`.
        beams: :class:`Beams`. chosen: (P,) int64 rows of rays.
        settings: (kind of light, way, panels, most lit parts, greatest distance of the table).
        out: :class:`Scattered`; rows of other rays stay as they are.
    """
    kind, way, steps, most, reach = settings
    boxes, channels = media.extinction.shape
    most_panels = (PLACES * boxes + 3) * 2 + 2 * NEAR * steps + 8
    groups = (len(chosen) + GROUP - 1) // GROUP
    for group in prange(groups):
        fields, sight = borrowed(media), (borrowed(images), borrowed(slices))
        lamp = (kind, reach, borrowed(source))
        origin, direction, span = borrowed(beams)
        radiance, told = borrowed(out)
        rows = borrowed(chosen)
        most_nodes = 2 * NEAR * steps + 1
        nodes = (
            np.empty((channels, most_nodes), F), np.empty((channels, most_nodes), F), np.empty(most_nodes, F),
            np.empty(most_nodes, F), np.empty((3, most_nodes), F), np.empty(channels, F),
        )  # fmt: skip
        own = (
            np.empty((channels, most_panels, WIDTH), F), nodes, np.empty(PLACES * boxes + 3, F),
            np.empty(boxes, np.bool_), np.empty((most, 2), F), np.empty(slices.rows.shape[1], np.int64),
        )  # fmt: skip
        scratch = borrowed(own)
        begin, end = block_of(group, GROUP, len(rows))
        for n in range(begin, end):
            i = rows[n]
            k = i if len(origin) > 1 else 0
            if span[i, 1] > span[i, 0]:
                ray = (origin[k], direction[i], span[i, 0], span[i, 1])
                scatter_ray(fields, lamp, sight, ray, (way, steps), scratch, (radiance[i], told[i]))
            else:
                for c in range(channels):
                    radiance[i, c] = F(0.0)
                for c in range(3):
                    told[i, c] = F(0.0)
        keep(own)
