"""From the keys of a warp to depth, validity and colour: back into the source image, and bilinear among its samples."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel

PART = 128  # pixels placed together


class Found(NamedTuple):
    """What the keys of one row of W pixels say."""

    image: np.ndarray  # (W,) int32 source image; -1 where there is none
    row: np.ndarray  # (W,) int32 quad in it
    column: np.ndarray
    depth: np.ndarray  # (W,) float64; +inf where there is none
    u: np.ndarray  # (W,) float64 position in the source image
    v: np.ndarray


class Blend(NamedTuple):
    """Where the colours of a row of W pixels come from."""

    row: np.ndarray  # (W,) int32 corner of the source image
    column: np.ndarray
    w0: np.ndarray  # (W,) float32 weights of the four pixels around it
    w1: np.ndarray
    w2: np.ndarray
    w3: np.ndarray
    scale: np.ndarray  # (W,) float32 one over their sum


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


@kernel()
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
    color = add_some((w0, w1, w2, w3), b, row, column, colors)
    scale = np.float32(1.0 / total)
    return color[0] * scale, color[1] * scale, color[2] * scale


@kernel(inline=True)
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
        inverse = np.float64(np.uint32(key >> np.uint64(32)).view(np.float32))
        depth[x] = inverse if key != 0 else np.inf


@kernel(inline=True)
def place_image(b, part, y, m, bias, near_far, found):
    """:func:`place` for the columns of a ``part`` that show image ``b``; no branches, so that it vectorises."""
    image, row, column, depth, us, vs = found
    near, far = near_far
    own, none = np.int32(b), np.int32(-1)
    x0, x1, x2, x3 = m[0, 0], m[0, 1] * y + m[0, 2], m[0, 3], bias
    y0, y1, y3 = m[1, 0], m[1, 1] * y + m[1, 2], m[1, 3]
    w0, w1, w3 = m[2, 0], m[2, 1] * y + m[2, 2], m[2, 3]
    for x in range(np.uintp(part[0]), np.uintp(part[1])):
        mine = image[x] == own
        z = x3 / depth[x]
        good = mine & (z >= near) & (z <= far)
        u = np.float64(np.int64(x)) + 0.5
        w = z * (w0 * u + w1) + w3
        su, sv = (z * (x0 * u + x1) + x2) / w, (z * (y0 * u + y1) + y3) / w
        inside = (abs(su) < np.inf) & (abs(sv) < np.inf)
        su = su if inside else np.float64(column[x]) + 0.5
        sv = sv if inside else np.float64(row[x]) + 0.5
        us[x] = su if good else us[x]
        vs[x] = sv if good else vs[x]
        z = z if good else np.inf
        depth[x] = z if mine else depth[x]
        image[x] = none if mine & (not good) else image[x]


@kernel(inline=True)
def place(y, back, bias, near_far, found):
    """``found.depth`` becomes the depth, and with it come source positions; images of other depths become -1.

    ``back`` (B,3,4): homogeneous pixels of the source images from pixel and depth of the target.
    """
    image = found.image
    for begin in range(0, image.shape[0], PART):
        end = min(begin + PART, image.shape[0])
        first, last = np.int32(2**31 - 1), np.int32(-1)
        for x in range(np.uintp(begin), np.uintp(end)):
            first = min(first, image[x] if image[x] >= 0 else first)
            last = max(last, image[x])
        for b in range(first, last + 1):
            place_image(b, (begin, end), y, borrowed(back[b]), bias[b], near_far, found)


@kernel(inline=True)
def weigh(found, centred, blend):
    """Corner of each pixel and what the four samples around it count, were they of one surface; no branches."""
    rows, columns, w0, w1, w2, w3, scale = blend
    _, js, i_s, _, us, vs = found
    for n in range(np.uintp(js.shape[0])):
        j, i = np.float64(js[n]), np.float64(i_s[n])
        u, v = us[n], vs[n]
        cu, cv = clamp(u, i, i + 1.0), clamp(v, j, j + 1.0)
        row = j + (1.0 if centred | (cv - j >= 0.5) else 0.0)
        column = i + (1.0 if centred | (cu - i >= 0.5) else 0.0)
        u, v = u if centred else cu, v if centred else cv
        x, y = clamp(u - (column - 0.5), 0.0, 1.0), clamp(v - (row - 0.5), 0.0, 1.0)
        a, b, c, d = x * y, x * (1.0 - y), (1.0 - x) * (1.0 - y), (1.0 - x) * y
        rows[n], columns[n] = np.int32(row), np.int32(column)
        w0[n], w1[n], w2[n], w3[n] = a, b, c, d
        scale[n] = 1.0 / (a + b + c + d)


@kernel(inline=True)
def blended(n, b, blend, colors):
    """Colour of pixel ``n`` of the row, whose four samples are of one surface."""
    row, column = np.int64(blend.row[n]), np.int64(blend.column[n])
    color = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
    color = add(blend.w0[n], pick(b, row, column, colors), color)
    color = add(blend.w1[n], pick(b, row - 1, column, colors), color)
    color = add(blend.w2[n], pick(b, row - 1, column - 1, colors), color)
    color = add(blend.w3[n], pick(b, row, column - 1, colors), color)
    scale = blend.scale[n]
    return color[0] * scale, color[1] * scale, color[2] * scale


@kernel(inline=True)
def color_row(found, quads, colors, blend, target):
    """Bilinear colours (W,3) of a row."""
    _, _, joined, centred = quads
    weigh(found, centred, blend)
    for x in range(np.uintp(target.shape[0])):
        b = np.int64(found.image[x])
        result = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
        if b >= 0:
            word = joined[np.uintp(b), np.uintp(blend.row[x]), np.uintp(blend.column[x])]
            if word & 255 == 0:  # the usual corner: all four are there and of one surface
                result = blended(x, b, blend, colors)
            else:
                j, i = np.int64(found.row[x]), np.int64(found.column[x])
                result = sample(found.u[x], found.v[x], b, j, i, centred, joined, colors)
        target[x, 0], target[x, 1], target[x, 2] = result


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
        words, numbers, weights = np.empty((5, width), np.int32), np.zeros((3, width)), np.empty((5, width), np.float32)
        found = Found(words[0], words[1], words[2], numbers[0], numbers[1], numbers[2])
        read_keys(keys[y * width : (y + 1) * width], rows, columns, found)
        place(np.float64(y) + 0.5, back, bias, near_far, found)
        for x in range(np.uintp(width)):
            b = found.image[x]
            depth[y, x], valid[y, x], source[y, x] = found.depth[x], b >= 0, b
        if smooth:
            blend = Blend(words[3], words[4], weights[0], weights[1], weights[2], weights[3], weights[4])
            color_row(found, (rows, columns, borrowed(joined), centred), borrowed(colors), blend, color[y])
            continue
        for x in range(np.uintp(width)):
            b, j, i = np.int64(found.image[x]), np.int64(found.row[x]), np.int64(found.column[x])
            result = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
            if b >= 0:
                result = pick(b, j, i, colors)
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = result
