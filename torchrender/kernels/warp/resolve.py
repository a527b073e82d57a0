"""From the keys of a warp to depth, validity and colour: back into the source image, and bilinear among its samples."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


class Found(NamedTuple):
    """What the keys of one row of W pixels say."""

    image: np.ndarray  # (W,) int32 source image; -1 where there is none
    row: np.ndarray  # (W,) int32 quad in it
    column: np.ndarray
    depth: np.ndarray  # (W,) float64; +inf where there is none
    u: np.ndarray  # (W,) float64 position in the source image
    v: np.ndarray


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
    if word & 255 == 0:  # the usual corner: all four are there and of one surface
        color = add(w0, pick(b, row, column, colors), color)
        color = add(w1, pick(b, row - 1, column, colors), color)
        color = add(w2, pick(b, row - 1, column - 1, colors), color)
        color = add(w3, pick(b, row, column - 1, colors), color)
    else:
        color = add_some((w0, w1, w2, w3), b, row, column, colors)
    scale = np.float32(1.0 / total)
    return color[0] * scale, color[1] * scale, color[2] * scale


@kernel()
def add_some(weights, b, row, column, colors):
    """Weighted sum of those of the four pixels around corner (row,column) whose weight is not 0."""
    color = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
    if weights[0] > 0.0:
        color = add(weights[0], pick(b, row, column, colors), color)
    if weights[1] > 0.0:
        color = add(weights[1], pick(b, row - 1, column, colors), color)
    if weights[2] > 0.0:
        color = add(weights[2], pick(b, row - 1, column - 1, colors), color)
    if weights[3] > 0.0:
        color = add(weights[3], pick(b, row, column - 1, colors), color)
    return color


@kernel(inline=True)
def read_keys(keys, rows, columns, found):
    """Whose quads the keys are, and ``found.depth`` = 1/depth times the image's bias; no branches."""
    image, row, column, depth, _, _ = found
    by_columns, by_rows = 1.0 / np.float64(columns), 1.0 / np.float64(rows)
    for x in range(np.uintp(keys.shape[0])):
        key = keys[x]
        number = np.float64(np.uint32(0xFFFFFFFF) - np.uint32(key))
        line = math.floor((number + 0.5) * by_columns)  # exact: numbers are below 2^32
        b = math.floor((line + 0.5) * by_rows)
        column[x] = np.int32(number - line * columns)
        row[x] = np.int32(line - b * rows)
        image[x] = np.int32(b) if key != 0 else np.int32(-1)
        depth[x] = np.float64(np.uint32(key >> np.uint64(32)).view(np.float32))


@kernel(inline=True)
def place(y, back, bias, near_far, found):
    """``found.depth`` becomes the depth, and with it come source positions; images of other depths become -1."""
    image, row, column, depth, us, vs = found
    near, far = near_far
    for x in range(np.uintp(image.shape[0])):
        b = image[x]
        if b < 0:
            depth[x] = np.inf
            continue
        z = bias[np.uintp(b)] / depth[x]
        if not (z >= near and z <= far):
            image[x], depth[x] = np.int32(-1), np.inf
            continue
        u, v = source_position(np.float64(x) + 0.5, y + 0.5, z, back, np.uintp(b))
        inside = math.isfinite(u) and math.isfinite(v)
        depth[x] = z
        us[x], vs[x] = u if inside else column[x] + 0.5, v if inside else row[x] + 0.5


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
        words, numbers = np.empty((3, width), np.int32), np.empty((3, width))
        found = Found(words[0], words[1], words[2], numbers[0], numbers[1], numbers[2])
        read_keys(keys[y * width : (y + 1) * width], rows, columns, found)
        place(np.float64(y), back, bias, near_far, found)
        for x in range(np.uintp(width)):
            b = found.image[x]
            depth[y, x], valid[y, x], source[y, x] = found.depth[x], b >= 0, b
        for x in range(np.uintp(width)):
            b, j, i = np.int64(found.image[x]), np.int64(found.row[x]), np.int64(found.column[x])
            result = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
            if b >= 0 and smooth:
                result = sample(found.u[x], found.v[x], b, j, i, centred, joined, colors)
            elif b >= 0:
                result = pick(b, j, i, colors)
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = result
