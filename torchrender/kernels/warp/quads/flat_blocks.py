"""Blocks of quads that lie nearly in a plane: what stands before all of one is found without drawing it.

Where several images see one surface, most quads of all but the first image are hidden. 1/depth is linear over the image
for a plane, in the source image and in the target: a few operations for a pixel of the target tell whether the block
can show there. The test errs on one side only, so that pictures do not depend on it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel

COLUMNS, ROWS = 16, 8  # quads of a block
UNEVEN = 1e-3  # share of the depth by which a corner may lie off the plane
MOST = 1 << 12  # pixels that are compared at most: drawing the block costs no more
SNAPPED = 2.0**-11  # pixels by which snapping and rounding may move a corner
ROUNDED = 1.0 + 1e-6  # float32, also of the sums below


@kernel(inline=True)
def share_bits(value):
    """Bits of the absolute float32 value: they grow with it, and maxima of integers vectorise."""
    return np.float32(value).view(np.uint32) & np.uint32(0x7FFFFFFF)


@kernel(inline=True)
def largest_share_off(corners, shape, box, plane):
    """Greatest |1 - z n.p| of the corners of a block's quads, as the bits of a float32, and the bits of all shapes.

    ``plane``: 1/z = n.p, counted from the first quad of the ``box``: first row, one past the last, and columns.
    """
    top, bottom, left, right = box
    a, b, c = np.float32(plane[0]), np.float32(plane[1]), np.float32(plane[2])
    one, most, some = np.float32(1.0), np.uint32(0), np.uint8(0)
    for j in range(np.uintp(top), np.uintp(bottom)):
        upper = b * np.float32(j - np.uintp(top)) + c
        lower = upper + b
        for i in range(np.uintp(left), np.uintp(right)):
            u = np.float32(np.int32(i - np.uintp(left)))
            near, far = a * u, a * (u + one)
            off = share_bits(one - corners[j, 0, i] * (near + upper))
            off = max(off, share_bits(one - corners[j, 1, i] * (near + lower)))
            off = max(off, share_bits(one - corners[j, 2, i] * (far + lower)))
            off = max(off, share_bits(one - corners[j, 3, i] * (far + upper)))
            bits = shape[j, i]
            most = max(most, off if bits != 0 else np.uint32(0))
            some |= bits
    return most, some


@kernel(inline=True)
def find_plane(corners, shape, start, box, plane):
    """Fill ``plane`` (4,): n with 1/z = n.(u,v,1) in pixels of the image, and how far corners are off it.

    The plane goes through the outermost corners of the block. The last is inf for blocks that have none or are uneven,
    and -1 for those without a quad; a share of the depth.
    """
    top, bottom, left, right = box
    wide, tall = np.float64(right - left), np.float64(bottom - top)
    q0 = 1.0 / np.float64(corners[top, 0, left])
    q1 = 1.0 / np.float64(corners[bottom - 1, 1, left])
    q2 = 1.0 / np.float64(corners[bottom - 1, 2, right - 1])
    q3 = 1.0 / np.float64(corners[top, 3, right - 1])
    a, b = 0.5 * (q3 - q0 + q2 - q1) / wide, 0.5 * (q1 - q0 + q2 - q3) / tall
    c = 0.25 * (q0 + q1 + q2 + q3) - 0.5 * (a * wide + b * tall)
    most, some = largest_share_off(corners, shape, box, (a, b, c))
    off = np.float64(np.uint32(most).view(np.float32))
    plane[0], plane[1], plane[2] = a, b, c - a * (left + start) - b * (top + start)
    plane[3] = (off + 4e-6 if off < UNEVEN else np.inf) if some != 0 else -1.0  # with that of float32


@kernel(parallel=True)
def find_planes(corners, shape, start, planes):
    """``planes`` (B,ceil(h/ROWS),ceil(w/COLUMNS),4) float64 of the blocks of quads, see :func:`find_plane`.

    ``corners`` (B,h,4,w) float32 depths, ``shape`` (B,h,w) uint8, ``start``: column and row of the first corner.
    """
    count, rows, _, columns = corners.shape
    down = planes.shape[1]
    for n in prange(count * down):
        b, j = np.int64(n) // down, np.int64(n) % down
        own, bits, out = borrowed(corners[b]), borrowed(shape[b]), borrowed(planes[b, j])
        for i in range(out.shape[0]):
            box = (j * ROWS, min((j + 1) * ROWS, rows), i * COLUMNS, min((i + 1) * COLUMNS, columns))
            find_plane(own, bits, start, box, out[i])


@kernel(inline=True)
def shown_at(u, v, plane, matrix):
    """Target position, 1/depth there and 1/depth in the source of a point of a plane at a source position."""
    q = plane[0] * u + plane[1] * v + plane[2]
    x = matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2] + matrix[0, 3] * q
    y = matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2] + matrix[1, 3] * q
    w = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2] + matrix[2, 3] * q
    return x / w, y / w, q / w, q


@kernel(inline=True)
def plane_in_target(plane, m):
    """The plane k with 1/depth = k.(x,y,1) over the target: the transposed inverse of its homography times n."""
    a, b, c = plane[0], plane[1], plane[2]
    h00, h01, h02 = m[0, 0] + m[0, 3] * a, m[0, 1] + m[0, 3] * b, m[0, 2] + m[0, 3] * c
    h10, h11, h12 = m[1, 0] + m[1, 3] * a, m[1, 1] + m[1, 3] * b, m[1, 2] + m[1, 3] * c
    h20, h21, h22 = m[2, 0] + m[2, 3] * a, m[2, 1] + m[2, 3] * b, m[2, 2] + m[2, 3] * c
    c00, c01, c02 = h11 * h22 - h12 * h21, h12 * h20 - h10 * h22, h10 * h21 - h11 * h20
    c10, c11, c12 = h21 * h02 - h22 * h01, h22 * h00 - h20 * h02, h20 * h01 - h21 * h00
    c20, c21, c22 = h01 * h12 - h02 * h11, h02 * h10 - h00 * h12, h00 * h11 - h01 * h10
    scale = 1.0 / (h00 * c00 + h01 * c01 + h02 * c02)
    kx = (c00 * a + c01 * b + c02 * c) * scale
    ky = (c10 * a + c11 * b + c12 * c) * scale
    kc = (c20 * a + c21 * b + c22 * c) * scale
    return kx, ky, kc


@kernel(inline=True)
def is_everywhere_behind(limit, box, canvas):
    """Whether all pixels of a box hold a 1/depth greater than ``limit`` = (step right, step down, value at pixel 0)."""
    keys, width, _ = canvas
    step, down, first = limit
    for y in range(box[1], box[3] + 1):
        line, base = np.uintp(y * width), first + down * y
        open_still = np.uint32(0)
        for x in range(np.uintp(box[0]), np.uintp(box[2] + 1)):
            held = np.float64(np.uint32(keys[line + x] >> np.uint64(32)).view(np.float32))
            open_still |= np.uint32(not held > base + step * np.float64(np.int64(x)))
        if open_still != 0:
            return False
    return True


@kernel()
def is_block_hidden(plane, box, pose, guard, canvas):
    """Whether nothing of a block can show: what is drawn already is nearer in all pixels that it may touch.

    ``plane``: of :func:`find_plane`; ``box``: source columns and rows of its outer corners, left, top, right, bottom;
    ``guard``: pixels within which corners are snapped.
    """
    canvas, (matrix, near, bias) = borrowed(canvas), borrowed(pose)
    uneven = plane[3]
    if uneven < 0.0:
        return True
    if not uneven < np.inf:
        return False
    left, top, right, bottom = box
    kx, ky, kc = plane_in_target(plane, matrix)
    least_x = least_y = np.inf
    most_x = most_y = most_q = -np.inf
    for k in range(4):
        x, y, q, own = shown_at(right if k & 1 else left, bottom if k & 2 else top, plane, matrix)
        inside = (abs(x) < guard) & (abs(y) < guard) & (q > 0.0) & (2.0 * q * near < 1.0) & (own > 0.0)
        if not (inside and abs(kx * x + ky * y + kc - q) <= 1e-7 * q):
            return False
        least_x, most_x = min(least_x, x), max(most_x, x)
        least_y, most_y, most_q = min(least_y, y), max(most_y, y), max(most_q, q)
    # A corner off the plane by a share d is moved by d (t - x t_w) / w, and its 1/depth is that of the plane there
    # over 1 - d (1 - k.t).
    off = uneven * abs(1.0 - (kx * matrix[0, 3] + ky * matrix[1, 3] + kc * matrix[2, 3]))
    turn = abs(matrix[2, 3])
    apart_x = SNAPPED + 2.0 * uneven * most_q * (abs(matrix[0, 3]) + turn * max(abs(least_x), abs(most_x)))
    apart_y = SNAPPED + 2.0 * uneven * most_q * (abs(matrix[1, 3]) + turn * max(abs(least_y), abs(most_y)))
    if not (off < 0.1 and uneven * most_q * turn < 0.1):
        return False
    x0 = np.int64(math.ceil(max(least_x - apart_x - 0.5, 0.0)))
    y0 = np.int64(math.ceil(max(least_y - apart_y - 0.5, 0.0)))
    x1 = np.int64(math.floor(min(most_x + apart_x - 0.5, canvas.width - 1.0)))
    y1 = np.int64(math.floor(min(most_y + apart_y - 0.5, canvas.height - 1.0)))
    if x0 > x1 or y0 > y1:
        return True
    if (x1 - x0 + 1) * (y1 - y0 + 1) > MOST:
        return False
    scale = bias * ROUNDED / (1.0 - off)
    first = (kx * 0.5 + ky * 0.5 + kc + (abs(kx) + abs(ky)) * SNAPPED) * scale
    return is_everywhere_behind((kx * scale, ky * scale, first), (x0, y0, x1, y1), canvas)
