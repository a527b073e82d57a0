"""Which pixel centres the smallest triangles hit, found for many of them together.

Where triangles are about as large as pixels, most of them hit no centre at all, and branches that cannot be foretold
cost more than the arithmetic.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.project import (
    CULL_BACK,
    CULL_FRONT,
    HALF,
    NEEDS_CLIP,
    SUBPIXEL_BITS,
    snapped_x,
    snapped_y,
)

BELOW = 1 << 8  # the bit of the pixel below the first one
SAMPLES = 3 + 3 * BELOW  # of 2 x 2 pixels
LARGE, CROSSING, MIDDLE = 1 << 40, 1 << 41, 1 << 42
SIDE = 4  # columns and rows that boxes have at most which are tested for many triangles together


class Chunk(NamedTuple):
    """Triangles of a cluster, and room for more."""

    a: np.ndarray  # (N,) int64 snapped corners
    b: np.ndarray
    c: np.ndarray
    codes: np.ndarray  # (N,) int64 of :func:`find_samples`
    found: np.ndarray  # (N,) int64 numbers of those whose code is not 0
    middle: np.ndarray  # (4,N) int64 room for :func:`find_windows`


@kernel()
def room_for(runs, chosen):
    """A :class:`Chunk` for the largest of the chosen clusters."""
    most = np.int64(0)
    for c in chosen:
        most = max(most, runs[c, 1] - runs[c, 0])
    return Chunk(
        np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64),
        np.empty(most, np.int64), np.empty((4, most), np.int64),
    )  # fmt: skip


@kernel()
def gather_corners(packed, listed, first, count, chunk):
    """Snapped corners of the triangles at the places from ``first`` on."""
    packed, listed, chunk = borrowed(packed), borrowed(listed), borrowed(chunk)
    a, b, c = chunk.a, chunk.b, chunk.c
    for n in range(np.uintp(count)):
        place = np.uintp(first) + n
        a[n] = packed[np.uintp(listed[place, 0]), 3]
        b[n] = packed[np.uintp(listed[place, 1]), 3]
        c[n] = packed[np.uintp(listed[place, 2]), 3]


@kernel(inline=True)
def product(one, other):
    """Of two numbers that 32 bits hold: processors multiply vectors of such in one step, others in eight."""
    return np.int64(np.int32(one)) * np.int64(np.int32(other))


@kernel(inline=True)
def edge_samples(a, b, turned, px, py):
    """Edge a-b at a snapped point and at those one pixel to the right, below, and both; inside is >= 0."""
    ax, ay = snapped_x(a), snapped_y(a)
    dx, dy = snapped_x(b) - ax, snapped_y(b) - ay
    dx, dy = -dx if turned else dx, -dy if turned else dy
    owns = (dy > 0) | ((dy == 0) & (dx < 0))
    value = product(dx, py - ay) - product(dy, px - ax) - (0 if owns else 1)
    right, down = dy << SUBPIXEL_BITS, dx << SUBPIXEL_BITS
    return value, value - right, value + down, value - right + down


@kernel()
def find_samples(chunk, count, frame, bounds, cull):
    """Set ``chunk.codes``: what each triangle covers within ``bounds``, x0, y0, x1, y1 inclusive of the image.

    Bits of a window of which four pixels may be set: see :func:`~.coverage.window_bits`; the first one is that of the
    triangle's box. LARGE: its box has more than 2 x 2 pixels; MIDDLE: neither more than SIDE columns nor rows, see
    :func:`find_windows`; CROSSING: it may need clipping. Without branches, so that LLVM makes vectors of it.
    """
    chunk = borrowed(chunk)
    corners_a, corners_b, corners_c, codes = chunk.a, chunk.b, chunk.c, chunk.codes
    left, top = np.int64(frame.width) >> 1, np.int64(frame.height) >> 1
    low_x, low_y, high_x, high_y = bounds[0] - left, bounds[1] - top, bounds[2] - left, bounds[3] - top
    drops_back, drops_front = cull == CULL_BACK, cull == CULL_FRONT
    for n in range(np.uintp(count)):
        a, b, c = corners_a[n], corners_b[n], corners_c[n]
        ax, bx, cx = snapped_x(a), snapped_x(b), snapped_x(c)
        ay, by, cy = snapped_y(a), snapped_y(b), snapped_y(c)
        x0 = max((min(ax, min(bx, cx)) + (HALF - 1)) >> SUBPIXEL_BITS, low_x)
        y0 = max((min(ay, min(by, cy)) + (HALF - 1)) >> SUBPIXEL_BITS, low_y)
        x1 = min((max(ax, max(bx, cx)) - HALF) >> SUBPIXEL_BITS, high_x)
        y1 = min((max(ay, max(by, cy)) - HALF) >> SUBPIXEL_BITS, high_y)
        area = product(bx - ax, cy - ay) - product(by - ay, cx - ax)
        px, py = (x0 << SUBPIXEL_BITS) + HALF, (y0 << SUBPIXEL_BITS) + HALF
        turned = area < 0
        p0, p1, p2, p3 = edge_samples(a, b, turned, px, py)
        q0, q1, q2, q3 = edge_samples(b, c, turned, px, py)
        r0, r1, r2, r3 = edge_samples(c, a, turned, px, py)
        wide, tall = x1 > x0, y1 > y0
        code = 1 if (p0 | q0 | r0) >= 0 else 0
        code |= 2 if ((p1 | q1 | r1) >= 0) & wide else 0
        code |= BELOW if ((p2 | q2 | r2) >= 0) & tall else 0
        code |= 2 * BELOW if ((p3 | q3 | r3) >= 0) & wide & tall else 0
        most = max(x1 - x0, y1 - y0)
        code = MIDDLE if most > 1 else code
        code = LARGE if most >= SIDE else code
        dropped = (x0 > x1) | (y0 > y1) | (area == 0) | (drops_back & (area > 0)) | (drops_front & (area < 0))
        code = 0 if dropped else code
        crossing = (a == NEEDS_CLIP) | (b == NEEDS_CLIP) | (c == NEEDS_CLIP)
        codes[n] = CROSSING if crossing else code


@kernel(inline=True)
def four_samples(p, q, r, right):
    """Bits of the pixels of a row that three edges have on their inner sides; ``right``: their steps."""
    bits = 1 if (p | q | r) >= 0 else 0
    p, q, r = p + right[0], q + right[1], r + right[2]
    bits |= 2 if (p | q | r) >= 0 else 0
    p, q, r = p + right[0], q + right[1], r + right[2]
    bits |= 4 if (p | q | r) >= 0 else 0
    p, q, r = p + right[0], q + right[1], r + right[2]
    return bits | (8 if (p | q | r) >= 0 else 0)


@kernel(inline=True)
def edge_steps(a, b, turned, px, py):
    """Edge a-b at a snapped point, and its steps to the right and down; inside is >= 0."""
    value, right, down, _ = edge_samples(a, b, turned, px, py)
    return value, right - value, down - value


@kernel()
def find_windows(chunk, count, frame, bounds):
    """Replace the codes MIDDLE by what these triangles cover: bits of a window of which SIDE x SIDE pixels may be set.

    Apart from :func:`find_samples`, whose arithmetic is a quarter of this.
    """
    chunk = borrowed(chunk)
    codes, numbers = chunk.codes, chunk.found
    corners_a, corners_b, corners_c, bits = chunk.middle[0], chunk.middle[1], chunk.middle[2], chunk.middle[3]
    m = np.uintp(0)
    for i in range(np.uintp(count)):
        numbers[m] = i
        m += np.uintp(codes[i] == MIDDLE)
    for k in range(m):
        n = np.uintp(numbers[k])
        corners_a[k], corners_b[k], corners_c[k] = chunk.a[n], chunk.b[n], chunk.c[n]
    left, top = np.int64(frame.width) >> 1, np.int64(frame.height) >> 1
    low_x, low_y, high_x, high_y = bounds[0] - left, bounds[1] - top, bounds[2] - left, bounds[3] - top
    for k in range(m):
        a, b, c = corners_a[k], corners_b[k], corners_c[k]
        ax, bx, cx = snapped_x(a), snapped_x(b), snapped_x(c)
        ay, by, cy = snapped_y(a), snapped_y(b), snapped_y(c)
        x0 = max((min(ax, min(bx, cx)) + (HALF - 1)) >> SUBPIXEL_BITS, low_x)
        y0 = max((min(ay, min(by, cy)) + (HALF - 1)) >> SUBPIXEL_BITS, low_y)
        turned = product(bx - ax, cy - ay) - product(by - ay, cx - ax) < 0
        px, py = (x0 << SUBPIXEL_BITS) + HALF, (y0 << SUBPIXEL_BITS) + HALF
        p, p_right, p_down = edge_steps(a, b, turned, px, py)
        q, q_right, q_down = edge_steps(b, c, turned, px, py)
        r, r_right, r_down = edge_steps(c, a, turned, px, py)
        right = (p_right, q_right, r_right)
        code = four_samples(p, q, r, right)
        p, q, r = p + p_down, q + q_down, r + r_down
        code |= four_samples(p, q, r, right) << 8
        p, q, r = p + p_down, q + q_down, r + r_down
        code |= four_samples(p, q, r, right) << 16
        p, q, r = p + p_down, q + q_down, r + r_down
        code |= four_samples(p, q, r, right) << 24
        bits[k] = code & inside_bits(high_x - x0, high_y - y0)
    for k in range(m):
        codes[np.uintp(numbers[k])] = bits[k]


@kernel(inline=True)
def inside_bits(columns, rows):
    """Those of a window of SIDE x SIDE pixels in its first columns and rows, given the last of each."""
    row = 1 | (2 if columns > 0 else 0) | (4 if columns > 1 else 0) | (8 if columns > 2 else 0)
    bits = row | (row << 8 if rows > 0 else 0) | (row << 16 if rows > 1 else 0)
    return bits | (row << 24 if rows > 2 else 0)


@kernel()
def list_found(chunk, count):
    """Fill ``chunk.found``; returns how many these are. Without a branch, which could not be foretold."""
    codes, found = borrowed(chunk.codes), borrowed(chunk.found)
    m = np.uintp(0)
    for n in range(np.uintp(count)):
        found[m] = n
        m += np.uintp(codes[n] != 0)
    return m


@kernel(inline=True)
def look_at(packed, listed, run, frame, bounds, cull, chunk):
    """Corners and codes of the triangles of a cluster: those at the places ``run[0]`` to ``run[1] - 1``.

    Returns how many meet a pixel or may: see :func:`list_found`.
    """
    gather_corners(packed, listed, run[0], run[1] - run[0], chunk)
    find_samples(chunk, run[1] - run[0], frame, bounds, cull)
    find_windows(chunk, run[1] - run[0], frame, bounds)
    return list_found(chunk, run[1] - run[0])
