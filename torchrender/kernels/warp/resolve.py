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
    word: np.ndarray  # (W,) int32 which of the four pixels around it are of one surface: see ``corner_groups``
    p0: np.ndarray  # (W,) int32 these pixels, or another one that is there
    p1: np.ndarray
    p2: np.ndarray
    p3: np.ndarray
    w0: np.ndarray  # (W,) float32 their weights
    w1: np.ndarray
    w2: np.ndarray
    w3: np.ndarray
    scale: np.ndarray  # (W,) float32 one over their sum


@kernel(inline=True)
def clamp(value, low, high):
    return min(max(value, low), high)


@kernel(inline=True)
def pick(b, j, i, colors):
    b, j, i = np.uintp(b), np.uintp(j), np.uintp(i)
    return colors[b, j, i, np.uintp(0)], colors[b, j, i, np.uintp(1)], colors[b, j, i, np.uintp(2)]


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
def find_corners(found, centred, blend):
    """The corner of the source image that each pixel is nearest to: colours are blended around it; no branches."""
    rows, columns = blend.row, blend.column
    _, js, i_s, _, us, vs = found
    for n in range(np.uintp(js.shape[0])):
        j, i = np.float64(js[n]), np.float64(i_s[n])
        below = centred | (clamp(vs[n], j, j + 1.0) - j >= 0.5)
        right = centred | (clamp(us[n], i, i + 1.0) - i >= 0.5)
        rows[n], columns[n] = js[n] + np.int32(below), i_s[n] + np.int32(right)


@kernel(inline=True)
def weigh(found, centred, width, blend):
    """Which samples each pixel blends, and how much they count: bilinear among those around its corner that are of the
    surface it shows, or that alone. No branches.

    ``width``: columns of the source images. Of pixels that show nothing, anything.
    """
    rows, columns, words, p0, p1, p2, p3, w0, w1, w2, w3, scale = blend
    _, js, i_s, _, us, vs = found
    three, none = np.int32(3), 0.0
    for n in range(np.uintp(js.shape[0])):
        j, i, word = np.float64(js[n]), np.float64(i_s[n]), words[n]
        below, right = rows[n] > js[n], columns[n] > i_s[n]
        # The quad of a centred one lies around its corner: pixel 0 or else pixel 1 leads the group that is drawn.
        second = (word & np.int32(256)) == 0
        turn = np.int32(2) if below else np.int32(0)
        turn = (np.int32(4) if below else np.int32(6)) if right else turn
        turn = (np.int32(2) if second else np.int32(0)) if centred else turn
        label = np.int32(word >> turn) & three
        u, v = us[n], vs[n]
        u, v = u if centred else clamp(u, i, i + 1.0), v if centred else clamp(v, j, j + 1.0)
        x, y = clamp(u - (columns[n] - 0.5), 0.0, 1.0), clamp(v - (rows[n] - 0.5), 0.0, 1.0)
        a = x * y if ((word & three) == label) else none
        b = x * (1.0 - y) if (((word >> np.int32(2)) & three) == label) else none
        c = (1.0 - x) * (1.0 - y) if (((word >> np.int32(4)) & three) == label) else none
        d = (1.0 - x) * y if (((word >> np.int32(6)) & three) == label) else none
        total = a + b + c + d
        some = total > 1e-6
        near_row = js[n] + (np.int32(0) if second else np.int32(1)) if centred else js[n]
        near_column = i_s[n] + np.int32(1) if centred else i_s[n]
        near = near_row * width + near_column
        place = rows[n] * width + columns[n]
        p0[n] = place if some & (a > 0.0) else near
        p1[n] = place - width if some & (b > 0.0) else near
        p2[n] = place - width - np.int32(1) if some & (c > 0.0) else near
        p3[n] = place - np.int32(1) if some & (d > 0.0) else near
        w0[n], w1[n], w2[n], w3[n] = a if some else 1.0, b if some else none, c if some else none, d if some else none
        scale[n] = 1.0 / total if some else 1.0


@kernel(inline=True)
def color_row(found, quads, colors, blend, target):
    """Bilinear colours (W,3) of a row; ``colors`` (B,H*W,3), ``quads`` = joined, centred, columns of an image."""
    joined, centred, width = quads
    find_corners(found, centred, blend)
    image, words = found.image, blend.word
    for x in range(np.uintp(target.shape[0])):
        words[x] = 0
        if image[x] >= 0:  # else there may be no quads at all
            words[x] = joined[np.uintp(image[x]), np.uintp(blend.row[x]), np.uintp(blend.column[x])]
    weigh(found, centred, np.int32(width), blend)
    for x in range(np.uintp(target.shape[0])):
        if image[x] < 0:
            target[x, 0] = target[x, 1] = target[x, 2] = 0.0
            continue
        b = np.uintp(image[x])
        p0, p1, p2, p3 = np.uintp(blend.p0[x]), np.uintp(blend.p1[x]), np.uintp(blend.p2[x]), np.uintp(blend.p3[x])
        w0, w1, w2, w3, scale = blend.w0[x], blend.w1[x], blend.w2[x], blend.w3[x], blend.scale[x]
        for k in range(np.uintp(3)):
            color = w0 * colors[b, p0, k] + w1 * colors[b, p1, k] + w2 * colors[b, p2, k] + w3 * colors[b, p3, k]
            target[x, k] = color * scale


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
    flat = colors.reshape((colors.shape[0], colors.shape[1] * colors.shape[2], 3))
    for n in prange(height):
        y = np.int64(n)
        words, numbers, weights = (
            np.empty((10, width), np.int32),
            np.zeros((3, width)),
            np.empty((5, width), np.float32),
        )
        found = Found(words[0], words[1], words[2], numbers[0], numbers[1], numbers[2])
        read_keys(keys[y * width : (y + 1) * width], rows, columns, found)
        place(np.float64(y) + 0.5, back, bias, near_far, found)
        for x in range(np.uintp(width)):
            b = found.image[x]
            depth[y, x], valid[y, x], source[y, x] = found.depth[x], b >= 0, b
        if smooth:
            blend = Blend(
                words[3], words[4], words[5], words[6], words[7], words[8], words[9],
                weights[0], weights[1], weights[2], weights[3], weights[4],
            )  # fmt: skip
            color_row(found, (borrowed(joined), centred, colors.shape[2]), borrowed(flat), blend, color[y])
            continue
        for x in range(np.uintp(width)):
            b, j, i = np.int64(found.image[x]), np.int64(found.row[x]), np.int64(found.column[x])
            result = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
            if b >= 0:
                result = pick(b, j, i, colors)
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = result
