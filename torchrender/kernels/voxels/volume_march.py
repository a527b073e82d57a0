"""Rays through layers of coloured, translucent cells, blended front to back. Source: specification 05, section 8."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.voxels.bits import span

BRICK = 8  # cells per side of the blocks that are skipped where empty
ROW = 64  # rays handed to a thread at once
OPAQUE = 0.995


class Layers(NamedTuple):
    """L layers of cells."""

    low: np.ndarray  # (L,3) float64
    high: np.ndarray  # (L,3) float64
    per_unit: np.ndarray  # (L,3) float64 cells per scene unit
    reference: np.ndarray  # (L,) float64 length that opacities stand for
    counts: np.ndarray  # (L,3) int64 cells
    firsts: np.ndarray  # (L,2) int64 first cell and first brick
    smooth: np.ndarray  # (L,) bool


class Cells(NamedTuple):
    """What the layers hold."""

    cells: np.ndarray  # (M,4) uint8 colour and opacity; x fastest, layer after layer
    bricks: np.ndarray  # uint8, not zero where a block of BRICK cells, or one beside it, has any opacity
    depth_of: np.ndarray  # (256,) float32 optical depth over the reference length
    linear: np.ndarray  # (256,) float32 linear colour


@kernel(inline=True)
def box_span(origin, direction, low, high):
    """Ray parameters at which a ray enters and leaves a box; the first is not smaller where it misses."""
    begin, end = -np.inf, np.inf
    for c in range(3):
        if direction[c] == 0.0:
            if origin[c] < low[c] or origin[c] > high[c]:
                return 0.0, 0.0
            continue
        t0, t1 = (low[c] - origin[c]) / direction[c], (high[c] - origin[c]) / direction[c]
        begin, end = max(begin, min(t0, t1)), min(end, max(t0, t1))
    return max(begin, 0.0), end


@kernel(inline=True)
def add_cell(held, index, share, sample):
    """Add a cell's optical depth, and its colour weighted with that, to ``sample`` (4,)."""
    cells, _, depth_of, linear = held
    depth = share * depth_of[cells[index, 3]]
    sample[0] += depth * linear[cells[index, 0]]
    sample[1] += depth * linear[cells[index, 1]]
    sample[2] += depth * linear[cells[index, 2]]
    sample[3] += depth


@kernel(inline=True)
def sample_nearest(held, first, dims, at, scale, sample):
    x, y, z = at
    i = min(max(np.int64(x), 0), dims[0] - 1)
    j = min(max(np.int64(y), 0), dims[1] - 1)
    k = min(max(np.int64(z), 0), dims[2] - 1)
    add_cell(held, first + (k * dims[1] + j) * dims[0] + i, scale, sample)


@kernel(inline=True)
def sample_smooth(held, first, dims, at, scale, sample):
    """Trilinear between the centres of cells, the outermost values continued."""
    x, y, z = at[0] - 0.5, at[1] - 0.5, at[2] - 0.5
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    a, b, c = x - fx, y - fy, z - fz
    i0, i1 = min(max(np.int64(fx), 0), dims[0] - 1), min(max(np.int64(fx) + 1, 0), dims[0] - 1)
    j0, j1 = min(max(np.int64(fy), 0), dims[1] - 1), min(max(np.int64(fy) + 1, 0), dims[1] - 1)
    k0, k1 = min(max(np.int64(fz), 0), dims[2] - 1), min(max(np.int64(fz) + 1, 0), dims[2] - 1)
    for k in range(2):
        plane = first + (k1 if k else k0) * dims[1] * dims[0]
        wz = (c if k else 1.0 - c) * scale
        for j in range(2):
            row = plane + (j1 if j else j0) * dims[0]
            wy = (b if j else 1.0 - b) * wz
            add_cell(held, row + i0, (1.0 - a) * wy, sample)
            add_cell(held, row + i1, a * wy, sample)


@kernel(inline=True)
def brick_exit(at, direction, dims, block):
    """Ray length, in cells of each axis, from a point (x, y, z) to where its block of cells ends."""
    reach = np.inf
    for c in range(3):
        if direction[c] != 0.0:
            side = (block[c] + 1) * BRICK if direction[c] > 0.0 else block[c] * BRICK
            if side >= dims[c] or side <= 0:
                continue  # the layer ends here, not only the block
            reach = min(reach, (side - at[c]) / direction[c])
    return reach


@kernel(inline=True)
def add_layer(n, ray, begin, end, layers, held, sample):
    """Add what layer ``n`` holds between two ray lengths to ``sample``; returns the length before which it is empty."""
    low, _, per_unit, reference, counts, firsts, smooth = layers
    o, d, spans = ray
    first, last = max(begin, spans[n, 0]), min(end, spans[n, 1])
    if last <= first:
        return spans[n, 0] if spans[n, 0] >= end else np.inf
    t = 0.5 * (first + last)
    x = (o[0] + t * d[0] - low[n, 0]) * per_unit[n, 0]
    y = (o[1] + t * d[1] - low[n, 1]) * per_unit[n, 1]
    z = (o[2] + t * d[2] - low[n, 2]) * per_unit[n, 2]
    dims = counts[n]
    i = min(max(np.int64(x), 0), dims[0] - 1) // BRICK
    j = min(max(np.int64(y), 0), dims[1] - 1) // BRICK
    k = min(max(np.int64(z), 0), dims[2] - 1) // BRICK
    across, down = (dims[0] + BRICK - 1) // BRICK, (dims[1] + BRICK - 1) // BRICK
    if held.bricks[firsts[n, 1] + (k * down + j) * across + i] == 0:
        speed = (d[0] * per_unit[n, 0], d[1] * per_unit[n, 1], d[2] * per_unit[n, 2])
        return min(t + brick_exit((x, y, z), speed, dims, (i, j, k)), spans[n, 1])
    scale = (last - first) / reference[n]
    if smooth[n]:
        sample_smooth(held, firsts[n, 0], dims, (x, y, z), scale, sample)
    else:
        sample_nearest(held, firsts[n, 0], dims, (x, y, z), scale, sample)
    return end


@kernel(parallel=True)
def march(origins, directions, layers, held, step, image):
    """Blend the layers along each ray.

    Args:
        origins, directions: (N,3) float64, directions of unit length.
        layers: :class:`Layers`.
        held: :class:`Cells`.
        step: length between samples; shortened so that whole steps fill a ray's way through the layers.
        image: (N,4) float32 colour times coverage, and coverage; written.
    """
    number = len(layers.low)
    chunks = (len(origins) + ROW - 1) // ROW
    scratch = np.zeros((chunks, number + 2, 2))
    for chunk in prange(chunks):
        spans, sample = borrowed(scratch[chunk, :number]), borrowed(scratch[chunk, number:].reshape(4))
        views, sources = borrowed(layers), borrowed(held)
        starts, towards = borrowed(origins), borrowed(directions)
        rays = span(chunk, ROW, len(origins))
        for ray in range(rays[0], rays[1]):
            way = starts[ray], towards[ray], spans
            begin, end = np.inf, -np.inf
            for n in range(number):
                spans[n, 0], spans[n, 1] = box_span(way[0], way[1], views.low[n], views.high[n])
                if spans[n, 1] > spans[n, 0]:
                    begin, end = min(begin, spans[n, 0]), max(end, spans[n, 1])
            if not end > begin:
                continue
            steps = np.int64(np.ceil((end - begin) / step - 1e-9))
            length = (end - begin) / steps
            red, green, blue, clear = 0.0, 0.0, 0.0, 1.0
            s = np.int64(0)
            while s < steps:
                sample[0], sample[1], sample[2], sample[3] = 0.0, 0.0, 0.0, 0.0
                here, free = begin + s * length, np.inf
                for n in range(number):
                    free = min(free, add_layer(n, way, here, here + length, views, sources, sample))
                if sample[3] <= 0.0:
                    if free == np.inf:
                        break
                    s = max(s + 1, np.int64((free - begin) / length))
                    continue
                s += 1
                alpha = 1.0 - np.exp(-sample[3])
                weight = clear * alpha / sample[3]
                red, green, blue = red + weight * sample[0], green + weight * sample[1], blue + weight * sample[2]
                clear *= 1.0 - alpha
                if clear < 1.0 - OPAQUE:
                    break
            image[ray, 0], image[ray, 1], image[ray, 2], image[ray, 3] = red, green, blue, 1.0 - clear
