"""Rays through layers of coloured, translucent cells, blended front to back. Source: specification 05, section 8."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.voxel_bits import span

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
def brick_at(dims, x, y, z):
    """Number of the block that holds a point, in cells."""
    across, down = (dims[0] + BRICK - 1) // BRICK, (dims[1] + BRICK - 1) // BRICK
    i = min(max(np.int64(x), 0), dims[0] - 1) // BRICK
    j = min(max(np.int64(y), 0), dims[1] - 1) // BRICK
    k = min(max(np.int64(z), 0), dims[2] - 1) // BRICK
    return (k * down + j) * across + i


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
    low, high, per_unit, reference, counts, firsts, smooth = layers
    number = len(low)
    chunks = (len(origins) + ROW - 1) // ROW
    scratch = np.zeros((chunks, number + 2, 2))
    for chunk in prange(chunks):
        spans, sample = borrowed(scratch[chunk, :number]), borrowed(scratch[chunk, number:].reshape(4))
        rays = span(chunk, ROW, len(origins))
        for ray in range(rays[0], rays[1]):
            o, d = origins[ray], directions[ray]
            begin, end = np.inf, -np.inf
            for n in range(number):
                spans[n, 0], spans[n, 1] = box_span(o, d, low[n], high[n])
                if spans[n, 1] > spans[n, 0]:
                    begin, end = min(begin, spans[n, 0]), max(end, spans[n, 1])
            if not end > begin:
                continue
            steps = np.int64(np.ceil((end - begin) / step - 1e-9))
            length = (end - begin) / steps
            red, green, blue, clear = 0.0, 0.0, 0.0, 1.0
            for s in range(steps):
                sample[0], sample[1], sample[2], sample[3] = 0.0, 0.0, 0.0, 0.0
                for n in range(number):
                    first = max(begin + s * length, spans[n, 0])
                    last = min(begin + (s + 1) * length, spans[n, 1])
                    if last <= first:
                        continue
                    t = 0.5 * (first + last)
                    x = (o[0] + t * d[0] - low[n, 0]) * per_unit[n, 0]
                    y = (o[1] + t * d[1] - low[n, 1]) * per_unit[n, 1]
                    z = (o[2] + t * d[2] - low[n, 2]) * per_unit[n, 2]
                    if bricks[firsts[n, 1] + brick_at(counts[n], x, y, z)] == 0:
                        continue
                    scale = (last - first) / reference[n]
                    if smooth[n]:
                        sample_smooth(cells, firsts[n, 0], counts[n], x, y, z, scale, tables, sample)
                    else:
                        sample_nearest(cells, firsts[n, 0], counts[n], x, y, z, scale, tables, sample)
                if sample[3] <= 0.0:
                    continue
                alpha = 1.0 - np.exp(-sample[3])
                weight = clear * alpha / sample[3]
                red, green, blue = red + weight * sample[0], green + weight * sample[1], blue + weight * sample[2]
                clear *= 1.0 - alpha
                if clear < 1.0 - OPAQUE:
                    break
            image[ray, 0], image[ray, 1], image[ray, 2], image[ray, 3] = red, green, blue, 1.0 - clear
