"""Rays through layers of coloured, translucent cells, blended front to back. Source: specification 05, section 8."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.voxels.bits import span

BRICK = 8  # cells per side of the blocks that are skipped where empty
ROW = 64  # rays handed to a thread at once
OPAQUE = 0.995


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
def add_cell(cells, index, share, depth_of, linear, sample):
    """Add a cell's optical depth, and its colour weighted with that, to ``sample`` (4,)."""
    depth = share * depth_of[cells[index, 3]]
    sample[0] += depth * linear[cells[index, 0]]
    sample[1] += depth * linear[cells[index, 1]]
    sample[2] += depth * linear[cells[index, 2]]
    sample[3] += depth


@kernel(inline=True)
def sample_nearest(cells, first, dims, x, y, z, scale, tables, sample):
    i = min(max(np.int64(x), 0), dims[0] - 1)
    j = min(max(np.int64(y), 0), dims[1] - 1)
    k = min(max(np.int64(z), 0), dims[2] - 1)
    add_cell(cells, first + (k * dims[1] + j) * dims[0] + i, scale, tables[0], tables[1], sample)


@kernel(inline=True)
def sample_smooth(cells, first, dims, x, y, z, scale, tables, sample):
    """Trilinear between the centres of cells, the outermost values continued."""
    x, y, z = x - 0.5, y - 0.5, z - 0.5
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
            add_cell(cells, row + i0, (1.0 - a) * wy, tables[0], tables[1], sample)
            add_cell(cells, row + i1, a * wy, tables[0], tables[1], sample)


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
def add_layer(n, ray, begin, end, layers, sources, tables, sample):
    """Add what layer ``n`` holds between two ray lengths to ``sample``; returns the length before which it is empty."""
    low, _, per_unit, reference, counts, firsts, smooth = layers
    o, d, spans = ray
    cells, bricks = sources
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
    if bricks[firsts[n, 1] + (k * down + j) * across + i] == 0:
        speed = (d[0] * per_unit[n, 0], d[1] * per_unit[n, 1], d[2] * per_unit[n, 2])
        return min(t + brick_exit((x, y, z), speed, dims, (i, j, k)), spans[n, 1])
    scale = (last - first) / reference[n]
    if smooth[n]:
        sample_smooth(cells, firsts[n, 0], dims, x, y, z, scale, tables, sample)
    else:
        sample_nearest(cells, firsts[n, 0], dims, x, y, z, scale, tables, sample)
    return end


@kernel(inline=True)
def borrowed_all(layers):
    """The arrays of the layers without their reference counts."""
    low, high, per_unit, reference, counts, firsts, smooth = layers
    places = borrowed(low), borrowed(high), borrowed(per_unit), borrowed(reference)
    return (*places, borrowed(counts), borrowed(firsts), borrowed(smooth))


@kernel(parallel=True)
def march(origins, directions, layers, cells, bricks, tables, step, image):
    """Blend the layers along each ray.

    Args:
        origins, directions: (N,3) float64, directions of unit length.
        layers: low (L,3), high (L,3), cells per unit (L,3), reference length (L,) float64; cell counts (L,3), first
            cell and first brick (L,2) int64; smooth (L,) bool.
        cells: (M,4) uint8, colour and opacity; x fastest, layer after layer.
        bricks: uint8, not zero where a block of BRICK cells, or one beside it, has any opacity.
        tables: (256,) float32 optical depth over the reference length, and (256,) float32 linear colour.
        step: length between samples; shortened so that whole steps fill a ray's way through the layers.
        image: (N,4) float32 colour times coverage, and coverage; written.
    """
    number = len(layers[0])
    chunks = (len(origins) + ROW - 1) // ROW
    scratch = np.zeros((chunks, number + 2, 2))
    for chunk in prange(chunks):
        spans, sample = borrowed(scratch[chunk, :number]), borrowed(scratch[chunk, number:].reshape(4))
        views, sources = borrowed_all(layers), (borrowed(cells), borrowed(bricks))
        lookup = borrowed(tables[0]), borrowed(tables[1])
        starts, towards = borrowed(origins), borrowed(directions)
        rays = span(chunk, ROW, len(origins))
        for ray in range(rays[0], rays[1]):
            way = starts[ray], towards[ray], spans
            begin, end = np.inf, -np.inf
            for n in range(number):
                spans[n, 0], spans[n, 1] = box_span(way[0], way[1], views[0][n], views[1][n])
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
                    free = min(free, add_layer(n, way, here, here + length, views, sources, lookup, sample))
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
