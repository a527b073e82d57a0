"""Spherical caps on a cube map of 6 x 32 x 32 texels, one bit each: 1 where the texel's centre lies in the cap.

Two layouts. Rows: (192,) uint32, face by face and row by row, the leftmost texel the highest bit. Blocks: (96,)
int64, which are 384 codes of 16 bits, face, row and column of a block of 4 x 4 texels; within a code texel (row,
column) is bit 15 - (4 row + column). Source: specification 08, section 5.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SIDE, ROWS, WORDS, BLOCKS = 32, 192, 96, 384
_LEAST_COSINE = 1e-9


@kernel(inline=True)
def _columns(low, high):
    """Bits of the texels of a row whose centres lie in [low, high]."""
    start = max(math.ceil(16.0 * (min(low, 2.0) + 1.0) - 0.5), 0.0)
    end = min(math.floor(16.0 * (max(min(high, 2.0), -2.0) + 1.0) - 0.5), 31.0)
    if not start <= end:
        return np.uint32(0)
    return np.uint32((np.uint64(0xFFFFFFFF) >> np.uint64(start)) & (np.uint64(0xFFFFFFFF) << np.uint64(31.0 - end)))


@kernel(inline=True)
def _roots(a, half, root, c):
    """Both roots of ``a t^2 - 2 half t + c`` within [-2, 2], the smaller first; a > 0, root = sqrt(half^2 - a c).

    The one nearer to zero comes of c: nothing is lost where a vanishes and the other goes to infinity.
    """
    far = abs(half) + root
    near = c / far if far > 0.0 else 0.0
    far = far / a if far < 2.0 * a else 2.0
    near = max(min(near, 2.0), -2.0)
    if half < 0.0:
        return -far, -near
    return near, far


@kernel()
def _face_rows(x, y, z, cosine, rows):
    """Adds to the rows (32,) of a face the cap about (x, y, z), in the face's own axes u, v and outward.

    A row is a line, which a cone meets between two places: roots of a quadratic.
    """
    square, sine2 = cosine * cosine, 1.0 - cosine * cosine
    first, last = 0, SIDE - 1
    if z * z > sine2:
        if z < 0.0:
            return
        inner = math.sqrt(max(sine2 * (y * y + z * z - sine2), 0.0))
        low, high = _roots(z * z - sine2, y * z, inner, y * y - sine2)
        first = int(max(math.floor(16.0 * (min(low, 2.0) + 1.0) - 0.5), 0.0))
        last = int(min(math.ceil(16.0 * (max(high, -2.0) + 1.0) - 0.5), 31.0))
    a = square - x * x
    for row in range(first, last + 1):
        v = (row + 0.5) * 0.0625 - 1.0
        q = y * v + z
        k = 1.0 + v * v
        inside = q * q - a * k
        if a > 0.0:
            if q <= 0.0 or inside < 0.0:
                continue
            low, high = _roots(a, x * q, cosine * math.sqrt(inside), square * k - q * q)
        else:
            root = cosine * math.sqrt(max(inside, 0.0))
            if q > 0.0:
                # Without the difference of two nearly equal numbers.
                edge = (square * k - q * q) / (abs(x) * q + root)
            elif a < 0.0:
                edge = (-abs(x) * q + root) / -a
            else:
                continue
            low, high = (edge, 2.0) if x > 0.0 else (-2.0, -edge)
        rows[row] |= _columns(low, high)


@kernel()
def add_cap(x, y, z, cosine, rows):
    """Adds to rows (192,) what lies about the unit vector (x, y, z) at a cosine of ``cosine`` >= 0 or more."""
    cosine = max(cosine, _LEAST_COSINE)
    _face_rows(-z, -y, x, cosine, rows[0:32])
    _face_rows(z, -y, -x, cosine, rows[32:64])
    _face_rows(x, z, y, cosine, rows[64:96])
    _face_rows(x, -z, -y, cosine, rows[96:128])
    _face_rows(x, -y, z, cosine, rows[128:160])
    _face_rows(-x, -y, -z, cosine, rows[160:192])


@kernel()
def pack_blocks(rows, words):
    """Rows (192,) as blocks (96,), which are replaced."""
    for group in range(48):
        top, second = np.uint64(rows[4 * group]), np.uint64(rows[4 * group + 1])
        third, bottom = np.uint64(rows[4 * group + 2]), np.uint64(rows[4 * group + 3])
        for half in range(2):
            word = np.uint64(0)
            for part in range(4):
                shift = np.uint64(28 - 16 * half - 4 * part)
                four = np.uint64(15)
                code = ((top >> shift) & four) << np.uint64(12)
                code |= ((second >> shift) & four) << np.uint64(8)
                code |= ((third >> shift) & four) << np.uint64(4)
                code |= (bottom >> shift) & four
                word |= code << np.uint64(16 * part)
            words[2 * group + half] = np.int64(word)


@kernel()
def filled_rows(words):
    """Which of 48 rows of blocks hold a bit, as bits of an int64."""
    mask = 0
    for group in range(48):
        if words[2 * group] | words[2 * group + 1]:
            mask |= 1 << group
    return mask


@kernel(parallel=True)
def fill_table(directions, radii, bits, filled):
    """Caps about directions (D,3) float64 of relative radii (R,): bits (D,R,96) int64, and their rows (D,R) int64."""
    for d in prange(directions.shape[0]):
        rows = np.empty(ROWS, np.uint32)
        for r in range(radii.size):
            rows[:] = np.uint32(0)
            cosine = math.sqrt(1.0 - radii[r] * radii[r])
            add_cap(directions[d, 0], directions[d, 1], directions[d, 2], cosine, rows)
            pack_blocks(rows, bits[d, r])
            filled[d, r] = filled_rows(bits[d, r])
