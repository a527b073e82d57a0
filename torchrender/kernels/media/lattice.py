"""Integrals along some rays of a picture, between which those of all its pixels lie.

What a light brings to a ray where nothing stands in its way changes little from pixel to pixel, though it is dear to
find in grids. So is the density that a ray has passed. Either is found up to any length along rays that lie some pixels
apart, a lattice, and a pixel blends what four of them say of its own lengths. Only where it is lit is a pixel's own.

Lengths of a lamp's rays are counted by the mean of two shares, that of the ray's length and that of its angle at the
lamp: near the lamp light changes with the angle, far from it with what a grid holds there. Between two nodes light per
count is a quadratic. A node's ray goes on behind the box, as its sides have it, for the pixels around that leave the
box later: what it would lack there would be a share of all that they have.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import box_span, trilinear
from torchrender.kernels.media.functions import arctan2, exponential
from torchrender.kernels.media.nodes import light_nodes
from torchrender.kernels.media.records import NEAREST, SUN
from torchrender.kernels.voxels.bits import span as block_of

F: Any = np.float32
BEYOND = F(1.02)  # of the longest ray around, to which a node's ray is followed
THICK = F(1.0)  # greatest change of the exponent between two nodes, for which a quadratic will do
TURNS = 8  # of the search for a place
CLOSE = F(4.0)  # lattice steps from a lamp within which pixels do not lie between nodes
UNKNOWN = F(-1.0)
GROUP = 512  # rays that a thread takes at a time


@kernel(inline=True)
def node_ray(matrix, step, row, column, d):
    """Direction of a node's ray, in ``d`` (3,)."""
    u, v = F(column * step), F(row * step)
    x = matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]
    y = matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]
    z = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]
    inverse = F(1.0) / math.sqrt(x * x + y * y + z * z)
    d[0], d[1], d[2] = x * inverse, y * inverse, z * inverse


@kernel(inline=True)
def longest_around(span, shape, step, row, column):
    """Length of the longest ray of the pixels around a node; 0 if none of them meets a medium."""
    height, width = shape
    longest = F(0.0)
    for y in range(max((row - 1) * step, 0), min((row + 1) * step, height)):
        for x in range(max((column - 1) * step, 0), min((column + 1) * step, width)):
            i = y * width + x
            if span[i, 1] > span[i, 0]:
                longest = max(longest, span[i, 1])
    return longest


@kernel(parallel=True)
def fill_ways(media, m, matrix, step, span, shape, widths, ways):
    """Integrals of a grid's density up to equal lengths along the rays of a lattice.

    Args:
        m: medium, of kind GRID.
        matrix: (3,3) float32 from pixels to directions; the eye is the origin.
        step: pixels between nodes. span: (H W,2) of all pixels' rays. shape: (H,W).
        widths: (R,Q) lengths of the nodes' rays in the box, UNKNOWN where there is none; written.
        ways: (R,Q,K+1,2) integrals and densities, written.
    """
    count = ways.shape[2] - 1
    for row in prange(widths.shape[0]):
        fields, spans, turn, out, length = borrowed((media, span, matrix, ways, widths))
        low, high, dims = fields.low[m], fields.high[m], fields.dims[m]
        d = np.empty(3, F)
        for column in range(length.shape[1]):
            node_ray(turn, step, np.int64(row), column, d)
            begin, leave = box_span(low, high, F(0.0), F(0.0), F(0.0), d[0], d[1], d[2])
            begin = max(begin, F(0.0))
            end = longest_around(spans, shape, step, np.int64(row), column) * BEYOND
            length[row, column] = UNKNOWN
            if not (leave > begin and end > begin):
                continue
            length[row, column] = end - begin
            width, total, before = (end - begin) / F(count), F(0.0), F(0.0)
            for k in range(count + 1):
                t = begin + F(k) * width
                value = trilinear(fields.cells, dims, low, high, d[0] * t, d[1] * t, d[2] * t)
                if k > 0:
                    total += F(0.5) * (before + value) * width
                out[row, column, k, 0], out[row, column, k, 1] = total, value
                before = value


@kernel(inline=True)
def corner_of(inverse, shape, d):
    """Row and column of the node above and before a ray, and how far the ray is from it, as shares of a step."""
    w = inverse[2, 0] * d[0] + inverse[2, 1] * d[1] + inverse[2, 2] * d[2]
    w = F(1.0) / max(w, F(1e-20))
    u = (inverse[0, 0] * d[0] + inverse[0, 1] * d[1] + inverse[0, 2] * d[2]) * w
    v = (inverse[1, 0] * d[0] + inverse[1, 1] * d[1] + inverse[1, 2] * d[2]) * w
    u, v = min(max(u, F(0.0)), F(shape[1] - 1)), min(max(v, F(0.0)), F(shape[0] - 1))
    column, row = min(np.int64(u), shape[1] - 2), min(np.int64(v), shape[0] - 2)
    return row, column, v - F(row), u - F(column)


@kernel(parallel=True)
def ways_between(media, m, inverse, widths, nodes, beams, ways):
    """Fill ``ways`` (N,) of a grid from :func:`fill_ways`; negative where not all nodes around meet it.

    Args:
        inverse: (3,3) float32 from directions to rows and columns of the lattice.
    """
    intervals = nodes.shape[2] - 1
    for group in prange((len(ways) + GROUP - 1) // GROUP):
        fields, turn, length, known, out = borrowed((media, inverse, widths, nodes, ways))
        _, direction, span = borrowed(beams)
        first, end = block_of(group, GROUP, len(out))
        for i in range(first, end):
            out[i] = F(0.0)
            d = direction[i]
            a, b = box_span(fields.low[m], fields.high[m], F(0.0), F(0.0), F(0.0), d[0], d[1], d[2])
            a = max(a, span[i, 0])
            along = min(b, span[i, 1]) - a
            if not along > F(0.0):
                continue
            row, column, fv, fu = corner_of(turn, length.shape, d)
            total, whole = F(0.0), True
            for k in range(4):
                r, c = row + (k >> 1), column + (k & 1)
                weight = (fv if k >> 1 else F(1.0) - fv) * (fu if k & 1 else F(1.0) - fu)
                width = length[r, c]
                if width <= F(0.0):
                    whole = False
                    break
                at = min(along / width, F(1.0)) * F(intervals)
                j = min(np.int64(at), intervals - 1)
                s = at - F(j)
                here, there = known[r, c, j, 1], known[r, c, j + 1, 1]
                part = s * (here + F(0.5) * s * (there - here)) * width / F(intervals)
                total += weight * (known[r, c, j, 0] + part)
            out[i] = total if whole else UNKNOWN


@kernel(inline=True)
def place_at(share, near, ends, lamp, turned):
    """Length whose count is ``share``, and how fast lengths change with the count; ``near``: one before it."""
    begin, end = ends
    t0, away, first, _ = lamp
    rate = F(0.5) / (end - begin)
    low, high, t = near, end, near
    slope = rate
    for turn in range(TURNS):
        off = t - t0
        slope = rate + turned * away / (away * away + off * off)
        found = rate * (t - begin) + turned * (arctan2(off, away) - first)
        if turn == TURNS - 1 or abs(found - share) < F(2e-6):
            break
        if found > share:
            high = min(high, t)
        else:
            low = max(low, t)
        t += (share - found) / slope
        if not (t > low and t < high):
            t = F(0.5) * (low + high)
    return t, F(1.0) / slope


@kernel(inline=True)
def place_nodes(ends, lamp, count, lengths, rates):
    """Lengths of ``count`` nodes of equal counts, and how fast lengths change there; returns the lamp's factor."""
    begin, end = ends
    _, _, first, last = lamp
    turned = F(0.5) / max(last - first, F(1e-6)) if last > first else F(0.0)
    lengths[0] = begin
    for j in range(count):
        share = F(j) / F(count - 1)
        if turned > F(0.0):
            lengths[j], rates[j] = place_at(share, lengths[max(j - 1, 0)], ends, lamp, turned)
        else:
            lengths[j], rates[j] = begin + (end - begin) * share, end - begin
    lengths[count - 1] = end
    return turned


@kernel(parallel=True)
def fill_lattice(media, source, matrix, step, span, shape, widths, cells):
    """Light of one source along the rays of a lattice in the only medium.

    Args:
        source: kind of light, and its numbers.
        widths: (R,Q,2) counts per length and per angle, the first UNKNOWN where there is nothing; written.
        cells: (R,Q,K,C,4) integral before an interval and three coefficients of the quadratic in it, times the ray's
            distance from a lamp; written.
        others: as :func:`fill_ways`.
    """
    kind, light = source
    intervals, channels = cells.shape[2], cells.shape[3]
    count = 2 * intervals + 1
    for row in prange(widths.shape[0]):
        fields, lamp_numbers, turn, spans, out, known = borrowed((media, light, matrix, span, widths, cells))
        o, d, before, active = np.zeros(3, F), np.empty(3, F), np.empty(channels, F), np.ones(1, np.bool_)
        nodes = (
            np.empty((channels, count), F), np.empty((channels, count), F), np.empty(count, F), np.empty(count, F),
            np.empty((3, count), F), before,
        )  # fmt: skip
        factor, exponent, lengths, rates, _, _ = nodes
        for column in range(out.shape[1]):
            out[row, column, 0] = UNKNOWN
            node_ray(turn, step, np.int64(row), column, d)
            begin, leave = box_span(fields.low[0], fields.high[0], F(0.0), F(0.0), F(0.0), d[0], d[1], d[2])
            begin = max(begin, F(0.0))
            end = longest_around(spans, shape, step, np.int64(row), column) * BEYOND
            if not (leave > begin and end > begin):
                continue
            t0, away, offset = F(0.0), F(1.0), (F(0.0), F(0.0), F(0.0))
            lamp = (t0, away, F(0.0), F(0.0))
            if kind != SUN:
                p = (lamp_numbers[0], lamp_numbers[1], lamp_numbers[2])
                t0 = d[0] * p[0] + d[1] * p[1] + d[2] * p[2]
                offset = (d[0] * t0 - p[0], d[1] * t0 - p[1], d[2] * t0 - p[2])
                away = math.sqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2])
                if away <= max(lamp_numbers[NEAREST], F(1e-12)):
                    continue
                lamp = (t0, away, arctan2(begin - t0, away), arctan2(end - t0, away))
            turned = place_nodes((begin, end), lamp, count, lengths, rates)
            for c in range(channels):
                before[c] = F(0.0)
            light_nodes(fields, kind, lamp_numbers, (o, d, t0, away, offset), (active, count, False), nodes)
            thick = F(0.0)
            for c in range(channels):
                total = F(0.0)
                for k in range(intervals):
                    j = 2 * k
                    thick = max(thick, abs(exponent[c, j + 2] - exponent[c, j]))
                    g0 = factor[c, j] * exponential(-exponent[c, j]) * rates[j]
                    g1 = factor[c, j + 1] * exponential(-exponent[c, j + 1]) * rates[j + 1]
                    g2 = factor[c, j + 2] * exponential(-exponent[c, j + 2]) * rates[j + 2]
                    scale = away / F(intervals)
                    c0 = scale * g0
                    c1 = scale * F(0.5) * (F(4.0) * g1 - F(3.0) * g0 - g2)
                    c2 = scale * F(1.0 / 3.0) * (F(2.0) * (g0 + g2) - F(4.0) * g1)
                    cell = known[row, column, k, c]
                    cell[0], cell[1], cell[2], cell[3] = total, c0, c1, c2
                    total += c0 + c1 + c2
            if thick < THICK:
                out[row, column, 0] = (F(0.5) if turned > F(0.0) else F(1.0)) / (end - begin)
                out[row, column, 1] = turned


@kernel(inline=True)
def lattice_knows(lattice, d, t0, away, kind):
    """Corner of a ray's cell, as :func:`corner_of`, with the row negative where it is not known."""
    row, column, fv, fu = corner_of(lattice.inverse, lattice.widths.shape, d)
    known = True
    if kind != SUN:
        known = away > CLOSE * lattice.angle * max(t0, away)
    for k in range(4):
        known = known and lattice.widths[row + (k >> 1), column + (k & 1), 0] > F(0.0)
    return (row if known else np.int64(-1)), column, fv, fu


@kernel(inline=True)
def lattice_to(lattice, corner, c, along, turned):
    """Integral up to a length and an angle beyond the ray's begin, times its distance from a lamp."""
    row, column, fv, fu = corner
    intervals = lattice.cells.shape[2]
    total = F(0.0)
    for k in range(4):
        r, q = row + (k >> 1), column + (k & 1)
        weight = (fv if k >> 1 else F(1.0) - fv) * (fu if k & 1 else F(1.0) - fu)
        at = lattice.widths[r, q, 0] * along + lattice.widths[r, q, 1] * turned
        at = min(max(at, F(0.0)), F(1.0)) * F(intervals)
        j = min(np.int32(at), np.int32(intervals - 1))
        s = at - F(j)
        cell = lattice.cells[r, q, j, c]
        total += weight * (cell[0] + s * (cell[1] + s * (cell[2] + s * cell[3])))
    return total
