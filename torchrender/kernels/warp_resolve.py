"""From the keys of a warp to depth, validity and colour: back into the source image, and bilinear among its samples."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(inline=True)
def clamp(value, low, high):
    return min(max(value, low), high)


@kernel(inline=True)
def accumulate(weight, row, column, label, k, word, color, total, out):
    """Add pixel ``k`` around a corner if it belongs to the group ``label``; returns the sum of weights so far."""
    if weight <= 0.0 or ((word >> (2 * k)) & 3) != label:
        return total
    for c in range(np.uintp(out.shape[0])):
        out[c] += np.float32(weight) * color[np.uintp(row), np.uintp(column), c]
    return total + weight


@kernel(inline=True)
def mix(j, i, label, weights, word, color, out):
    """Weighted mean colour of the pixels of one group around corner (j,i)."""
    a, b = weights  # how far right and down of the centre of the upper left pixel
    out[:] = 0.0
    total = accumulate(a * b, j, i, label, 0, word, color, 0.0, out)
    total = accumulate(a * (1.0 - b), j - 1, i, label, 1, word, color, total, out)
    total = accumulate((1.0 - a) * (1.0 - b), j - 1, i - 1, label, 2, word, color, total, out)
    total = accumulate((1.0 - a) * b, j, i - 1, label, 3, word, color, total, out)
    return total


@kernel(inline=True)
def sample(u, v, j, i, centred, joined, color, out):
    """Colour at source position (u, v), which lies in quad (j,i)."""
    if centred:
        # The quad lies around corner (j+1, i+1); pixel 0 or else pixel 1 around it leads the group that is drawn.
        row, column = j + 1, i + 1
        k = 0 if joined[row, column] & 256 else 1
        near_row, near_column = j + 1 - k, i + 1
    else:
        u, v = clamp(u, float(i), i + 1.0), clamp(v, float(j), j + 1.0)
        row, column = j + int(v - j >= 0.5), i + int(u - i >= 0.5)
        k = (1 if column == i else 2) if row > j else (0 if column == i else 3)
        near_row, near_column = j, i
    word = joined[row, column]
    label = (word >> (2 * k)) & 3
    a, b = clamp(u - (column - 0.5), 0.0, 1.0), clamp(v - (row - 0.5), 0.0, 1.0)
    total = mix(row, column, label, (a, b), word, color, out)
    if total > 1e-6:
        for c in range(np.uintp(out.shape[0])):
            out[c] /= np.float32(total)
    else:
        for c in range(np.uintp(out.shape[0])):
            out[c] = color[near_row, near_column, c]


@kernel(parallel=True)
def resolve(keys, quads, back, near_far, colors, smooth, outputs):
    """Fill ``outputs`` = color (H,W,C), depth (H,W), valid (H,W) and source (H,W) of one target camera.

    ``quads`` = shape (B,h,w), joined (B,H',W'), centred; ``back`` (B,3,4): homogeneous source pixel from target pixel
    and depth, as the matrices of :func:`~torchrender.kernels.warp.draw_quads`.
    """
    shape, joined, centred = quads
    color, depth, valid, source = outputs
    height, width = depth.shape
    rows, columns = shape.shape[1], shape.shape[2]
    for y in prange(height):
        v = np.float64(np.int64(y)) + 0.5
        for x in range(width):
            key = keys[np.uintp(y) * np.uintp(width) + np.uintp(x)]
            z = np.inf
            if key != 0:
                z = 1.0 / np.float64(np.uint32(key >> np.uint64(32)).view(np.float32))
            if z < near_far[0] or not z <= near_far[1] or key == 0:
                color[y, x, :] = 0.0
                depth[y, x] = np.inf
                valid[y, x] = False
                source[y, x] = -1
                continue
            number = np.int64(np.uint64(0xFFFFFFFF) - (key & np.uint64(0xFFFFFFFF)))
            b, rest = number // (rows * columns), number % (rows * columns)
            j, i = rest // columns, rest % columns
            depth[y, x] = z
            valid[y, x] = True
            source[y, x] = b
            if not smooth:
                color[y, x] = colors[b, j, i]
                continue
            u = x + 0.5
            m = back[b]
            w = z * (m[2, 0] * u + (m[2, 1] * v + m[2, 2])) + m[2, 3]
            su = (z * (m[0, 0] * u + (m[0, 1] * v + m[0, 2])) + m[0, 3]) / w
            sv = (z * (m[1, 0] * u + (m[1, 1] * v + m[1, 2])) + m[1, 3]) / w
            if not (math.isfinite(su) and math.isfinite(sv)):
                su, sv = i + 0.5, j + 0.5
            sample(su, sv, j, i, centred, joined[b], colors[b], color[y, x])
