"""Quads of a few pixels, the usual ones: found, tested and drawn by the row, in loops that vectorise.

A quad whose box holds no pixel centre is left out. The first pixel of every box is tested for all quads together; what
larger boxes hold besides is listed, unless something nearer is drawn there, and tested after. In 32 bits relative to
the pixel the edge functions are exact, the same numbers as those of :func:`~torchrender.kernels.warp.warp.draw`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.atomics import store_max
from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.corners import DIAGONAL, FIRST, SECOND

CHUNK = 128  # quads projected together
SUBPIXEL = 1 << 12
HALF = SUBPIXEL >> 1
BITS = 12
OUTSIDE = np.int32(-(2**31))

WIDEST = 4 * SUBPIXEL  # of small quads; products of their edges fit into 32 bits
MOST = 8  # pixels in the box of a small quad
NOTHING, ONE, SMALL, LARGE, CUT = 0, 1, 2, 3, 4
"""Sizes of quads: boxes of no pixel, one, a few, or more; and with corners that have no position."""


class Snapped(NamedTuple):
    """The four corners of up to CHUNK quads in the target."""

    x: np.ndarray  # (4,CHUNK) int32; OUTSIDE where a corner has none
    y: np.ndarray
    q: np.ndarray  # (4,CHUNK) biased 1/depth


class Boxes(NamedTuple):
    """Pixels whose centres up to CHUNK quads may cover."""

    size: np.ndarray  # (CHUNK,) uint8 NOTHING to CUT
    left: np.ndarray  # (CHUNK,) int32, first and last pixel
    right: np.ndarray
    top: np.ndarray
    bottom: np.ndarray
    nearest: np.ndarray  # (CHUNK,) uint32 bits that no 1/depth of the quad exceeds
    key: np.ndarray  # (CHUNK,) uint32 bits of 1/depth at the first pixel; 0 where the quad does not cover it


class Candidates(NamedTuple):
    """Further pixels that small quads may cover."""

    quad: np.ndarray  # (CHUNK*MOST,) int32 in the chunk
    column: np.ndarray  # (CHUNK*MOST,) int32
    row: np.ndarray
    shape: np.ndarray  # (CHUNK*MOST,) uint8 bits of the quad
    x: np.ndarray  # (4,CHUNK*MOST) int32 corners relative to the pixel's centre
    y: np.ndarray
    q: np.ndarray  # (4,CHUNK*MOST) float64
    key: np.ndarray  # (CHUNK*MOST,) uint32 bits of 1/depth; 0 where the quad does not cover the pixel


class Room(NamedTuple):
    """One thread's."""

    snapped: Snapped
    boxes: Boxes
    candidates: Candidates


@kernel(inline=True)
def new_room():
    """Room for one thread."""
    x, y = np.zeros((4, CHUNK), np.int32), np.zeros((4, CHUNK), np.int32)
    boxes = np.zeros((4, CHUNK), np.int32)
    most = CHUNK * MOST
    found, shape = np.zeros((3, most), np.int32), np.zeros(most, np.uint8)
    relative, q = np.zeros((2, 4, most), np.int32), np.zeros((4, most))
    words = np.zeros((2, CHUNK), np.uint32)
    return Room(
        Snapped(x, y, np.zeros((4, CHUNK))),
        Boxes(np.zeros(CHUNK, np.uint8), boxes[0], boxes[1], boxes[2], boxes[3], words[0], words[1]),
        Candidates(found[0], found[1], found[2], shape, relative[0], relative[1], q, np.zeros(most, np.uint32)),
    )


@kernel(inline=True)
def measure(bits, width, height, snapped, boxes):
    """The boxes of quads with these shape ``bits``; no branches, so that it vectorises."""
    xs, ys, qs = snapped
    one, half, last_x, last_y = np.int32(SUBPIXEL - 1), np.int32(HALF), np.int32(width - 1), np.int32(height - 1)
    shift, zero = np.int32(BITS), np.int32(0)
    for i in range(np.uintp(bits.shape[0])):
        x0, x1, x2, x3 = xs[0, i], xs[1, i], xs[2, i], xs[3, i]
        y0, y1, y2, y3 = ys[0, i], ys[1, i], ys[2, i], ys[3, i]
        low_x, high_x = min(min(x0, x1), min(x2, x3)), max(max(x0, x1), max(x2, x3))
        low_y, high_y = min(min(y0, y1), min(y2, y3)), max(max(y0, y1), max(y2, y3))
        cut = low_x == OUTSIDE
        low_x = zero if cut else low_x
        left = max(np.int32((low_x - half + one) >> shift), zero)
        right = min(np.int32((high_x - half) >> shift), last_x)
        top = max(np.int32((low_y - half + one) >> shift), zero)
        bottom = min(np.int32((high_y - half) >> shift), last_y)
        across, down = np.int32(right - left + 1), np.int32(bottom - top + 1)
        small = (high_x - low_x <= WIDEST) & (high_y - low_y <= WIDEST) & (across * down <= MOST)
        size = np.uint8(SMALL) if across * down > 1 else np.uint8(ONE)
        size = size if small else np.uint8(LARGE)
        size = size if (across > 0) & (down > 0) else np.uint8(NOTHING)
        size = np.uint8(CUT) if cut else size
        boxes.size[i] = size if bits[i] != 0 else np.uint8(NOTHING)
        boxes.left[i], boxes.right[i], boxes.top[i], boxes.bottom[i] = left, right, top, bottom
        most = np.float32(max(max(qs[0, i], qs[1, i]), max(qs[2, i], qs[3, i])))
        boxes.nearest[i] = np.uint32(most.view(np.uint32) + np.uint32(1))  # interpolating rounds


@kernel(inline=True)
def is_behind(stored, nearest):
    """Whether a key stands for something nearer than these bits of 1/depth."""
    return np.uint32(stored >> np.uint64(32)) > nearest


@kernel(inline=True)
def list_pixels(i, boxes, canvas, count, found):
    """Append all pixels but the first of small quad ``i`` that may show it; returns how many there are then."""
    keys, width, _ = canvas
    nearest = boxes.nearest[i]
    left, right, top = boxes.left[i], boxes.right[i], boxes.top[i]
    begin = left + np.int32(1)
    for row in range(top, boxes.bottom[i] + 1):
        line = np.int64(row) * width
        for column in range(begin, right + 1):
            if not is_behind(keys[np.uintp(line + column)], nearest):
                n = np.uintp(count)
                found.quad[n], found.column[n], found.row[n] = i, column, row
                count += 1
        begin = left
    return count


@kernel(inline=True)
def edge(ax, ay, bx, by):
    """Edge function of a-b at the origin, tie rule folded in."""
    dy = by - ay
    owns = (dy > 0) | ((dy == 0) & (bx < ax))
    return np.int32(ax * by - bx * ay - (np.int32(0) if owns else np.int32(1)))


@kernel(inline=True)
def cover(shape, x, y, q):
    """Bits of 1/depth where the quad with these corners relative to a pixel covers it, or 0; no branches."""
    turned = (shape & DIAGONAL) != 0
    ax, bx, cx, dx = (
        x[1] if turned else x[0],
        x[2] if turned else x[1],
        x[3] if turned else x[2],
        x[0] if turned else x[3],
    )
    ay, by, cy, dy = (
        y[1] if turned else y[0],
        y[2] if turned else y[1],
        y[3] if turned else y[2],
        y[0] if turned else y[3],
    )
    qa, qb, qc, qd = (
        q[1] if turned else q[0],
        q[2] if turned else q[1],
        q[3] if turned else q[2],
        q[0] if turned else q[3],
    )
    # Triangles a, c, b and c, a, d.
    area = np.int32((cx - ax) * (by - ay) - (cy - ay) * (bx - ax))
    other = np.int32((ax - cx) * (dy - cy) - (ay - cy) * (dx - cx))
    cb, ba, ac = edge(cx, cy, bx, by), edge(bx, by, ax, ay), edge(ax, ay, cx, cy)
    ad, dc, ca = edge(ax, ay, dx, dy), edge(dx, dy, cx, cy), edge(cx, cy, ax, ay)
    first = ((cb | ba | ac) >= 0) & (area > 0) & ((shape & FIRST) != 0)
    second = ((ad | dc | ca) >= 0) & (other > 0) & ((shape & SECOND) != 0)
    # At most one of them: they lie on either side of their common edge.
    whole = np.float64(area if first else other)
    fa, fb = np.float64(cb if first else ad), np.float64(ba if first else dc)
    q0, q1, q2 = qa if first else qc, qc if first else qa, qb if first else qd
    inverse = np.float32((fa * q0 + fb * q1 + (whole - fa - fb) * q2) * (1.0 / whole))
    return inverse.view(np.uint32) if first | second else np.uint32(0)


@kernel(inline=True)
def test_first(bits, snapped, boxes):
    """``boxes.key`` of every quad."""
    xs, ys, qs = snapped
    for i in range(np.uintp(bits.shape[0])):
        px = np.int32(boxes.left[i] * np.int32(SUBPIXEL) + np.int32(HALF))
        py = np.int32(boxes.top[i] * np.int32(SUBPIXEL) + np.int32(HALF))
        size = boxes.size[i]
        shape = bits[i] if (size == ONE) | (size == SMALL) else np.uint8(0)
        x = (np.int32(xs[0, i] - px), np.int32(xs[1, i] - px), np.int32(xs[2, i] - px), np.int32(xs[3, i] - px))
        y = (np.int32(ys[0, i] - py), np.int32(ys[1, i] - py), np.int32(ys[2, i] - py), np.int32(ys[3, i] - py))
        boxes.key[i] = cover(shape, x, y, (qs[0, i], qs[1, i], qs[2, i], qs[3, i]))


@kernel(inline=True)
def fetch_corners(count, bits, snapped, found):
    """Corners of the quads of the first ``count`` candidates, relative to the pixel."""
    xs, ys, qs = snapped
    x, y, q = found.x, found.y, found.q
    for n in range(np.uintp(count)):
        i = np.uintp(found.quad[n])
        px = np.int32(found.column[n] * np.int32(SUBPIXEL) + np.int32(HALF))
        py = np.int32(found.row[n] * np.int32(SUBPIXEL) + np.int32(HALF))
        x[0, n], x[1, n], x[2, n], x[3, n] = xs[0, i] - px, xs[1, i] - px, xs[2, i] - px, xs[3, i] - px
        y[0, n], y[1, n], y[2, n], y[3, n] = ys[0, i] - py, ys[1, i] - py, ys[2, i] - py, ys[3, i] - py
        q[0, n], q[1, n], q[2, n], q[3, n] = qs[0, i], qs[1, i], qs[2, i], qs[3, i]
        found.shape[n] = bits[i]


@kernel(inline=True)
def test_pixels(count, found):
    """``found.key`` of the first ``count`` candidates."""
    xs, ys, qs = found.x, found.y, found.q
    for n in range(np.uintp(count)):
        x, y = (xs[0, n], xs[1, n], xs[2, n], xs[3, n]), (ys[0, n], ys[1, n], ys[2, n], ys[3, n])
        found.key[n] = cover(found.shape[n], x, y, (qs[0, n], qs[1, n], qs[2, n], qs[3, n]))


@kernel(inline=True)
def keep_pixel(bits, row, column, number, canvas):
    """Draw a pixel unless something nearer is there."""
    keys, width, _ = canvas
    key = (np.uint64(bits) << np.uint64(32)) | (np.uint64(0xFFFFFFFF) - np.uint64(number))
    place = np.int64(row) * width + column
    if key > keys[np.uintp(place)]:
        store_max(keys, place, key)


@kernel()
def draw_small(bits, number, room, canvas):
    """The small quads of a chunk with shape ``bits`` whose corners and boxes are known; ``number``: of the first."""
    boxes, found = room.boxes, room.candidates
    test_first(bits, room.snapped, boxes)
    count = np.int64(0)
    for i in range(np.uintp(bits.shape[0])):
        if boxes.key[i] != 0:
            keep_pixel(boxes.key[i], boxes.top[i], boxes.left[i], number + np.int64(i), canvas)
        if boxes.size[i] == SMALL:
            count = list_pixels(i, boxes, canvas, count, found)
    fetch_corners(count, bits, room.snapped, found)
    test_pixels(count, found)
    for n in range(np.uintp(count)):
        if found.key[n] != 0:
            keep_pixel(found.key[n], found.row[n], found.column[n], number + found.quad[n], canvas)
