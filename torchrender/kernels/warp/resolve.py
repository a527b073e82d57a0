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
def weight_of(weight, word, k, label):
    return weight if ((word >> (2 * k)) & 3) == label else 0.0


@kernel(inline=True)
def pick(b, j, i, colors):
    b, j, i = np.uintp(b), np.uintp(j), np.uintp(i)
    return colors[b, j, i, np.uintp(0)], colors[b, j, i, np.uintp(1)], colors[b, j, i, np.uintp(2)]


@kernel(inline=True)
def add(weight, color, total):
    w = np.float32(weight)
    return total[0] + w * color[0], total[1] + w * color[1], total[2] + w * color[2]


@kernel(inline=True)
def sample(u, v, b, j, i, centred, joined, colors):
    """Colour at source position (u, v), in quad (j,i) of image ``b``: bilinear among the pixels of its surface."""
    if centred:
        # The quad lies around corner (j+1, i+1); pixel 0 or else pixel 1 around it leads the group that is drawn.
        row, column = j + 1, i + 1
        k = 0 if joined[b, row, column] & 256 else 1
        near_row, near_column = j + 1 - k, i + 1
    else:
        u, v = clamp(u, float(i), i + 1.0), clamp(v, float(j), j + 1.0)
        row, column = j + int(v - j >= 0.5), i + int(u - i >= 0.5)
        k = (1 if column == i else 2) if row > j else (0 if column == i else 3)
        near_row, near_column = j, i
    word = joined[np.uintp(b), np.uintp(row), np.uintp(column)]
    label = (word >> (2 * k)) & 3
    x, y = clamp(u - (column - 0.5), 0.0, 1.0), clamp(v - (row - 0.5), 0.0, 1.0)
    w0, w1 = weight_of(x * y, word, 0, label), weight_of(x * (1.0 - y), word, 1, label)
    w2, w3 = weight_of((1.0 - x) * (1.0 - y), word, 2, label), weight_of((1.0 - x) * y, word, 3, label)
    total = w0 + w1 + w2 + w3
    if total <= 1e-6:
        return pick(b, near_row, near_column, colors)
    color = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
    if w0 > 0.0:
        color = add(w0, pick(b, row, column, colors), color)
    if w1 > 0.0:
        color = add(w1, pick(b, row - 1, column, colors), color)
    if w2 > 0.0:
        color = add(w2, pick(b, row - 1, column - 1, colors), color)
    if w3 > 0.0:
        color = add(w3, pick(b, row, column - 1, colors), color)
    scale = np.float32(1.0 / total)
    return color[0] * scale, color[1] * scale, color[2] * scale


@kernel(inline=True)
def source_position(u, v, z, m, b):
    """Position in source image ``b`` of target position (u, v) at depth ``z``."""
    x = z * (m[b, 0, 0] * u + (m[b, 0, 1] * v + m[b, 0, 2])) + m[b, 0, 3]
    y = z * (m[b, 1, 0] * u + (m[b, 1, 1] * v + m[b, 1, 2])) + m[b, 1, 3]
    w = z * (m[b, 2, 0] * u + (m[b, 2, 1] * v + m[b, 2, 2])) + m[b, 2, 3]
    return x / w, y / w


@kernel(parallel=True)
def resolve(keys, quads, back, bias, near_far, colors, smooth, outputs):
    """Fill ``outputs`` = color (H,W,3), depth (H,W), valid (H,W) and source (H,W) of one target camera.

    ``quads`` = rows and columns of quads in an image, joined (B,H',W'), centred; ``back`` (B,3,4): homogeneous source
    pixel from target pixel and depth, like the matrices of :func:`~torchrender.kernels.warp.warp.draw_quads`;
    ``bias`` as there; ``colors`` (B,H,W,3).
    """
    rows, columns, joined, centred = quads
    color, depth, valid, source = outputs
    height, width = depth.shape
    for n in prange(height):
        y = np.int64(n)
        for x in range(width):
            key = keys[np.uintp(y * width + x)]
            z, b, j, i = np.inf, np.int64(-1), np.int64(0), np.int64(0)
            if key != 0:
                number = np.uint64(0xFFFFFFFF) - (key & np.uint64(0xFFFFFFFF))
                line = number // np.uint64(columns)
                i = np.int64(number - line * np.uint64(columns))
                b = np.int64(line // np.uint64(rows))
                j = np.int64(line) - b * rows
                z = bias[b] / np.float64(np.uint32(key >> np.uint64(32)).view(np.float32))
            known = key != 0 and z >= near_far[0] and z <= near_far[1]
            depth[y, x] = z if known else np.inf
            valid[y, x] = known
            source[y, x] = b if known else -1
            result = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
            if known and smooth:
                u, v = source_position(x + 0.5, y + 0.5, z, back, b)
                if not (math.isfinite(u) and math.isfinite(v)):
                    u, v = i + 0.5, j + 0.5
                result = sample(u, v, b, j, i, centred, joined, colors)
            elif known:
                result = pick(b, j, i, colors)
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = result
