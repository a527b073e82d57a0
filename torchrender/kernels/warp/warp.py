"""Quads of depth images straight into another camera's image, without a mesh in between.

One 64-bit key per target pixel: the upper half is the float32 bits of 1/depth times the image's bias (they grow towards
the camera), the lower half the complement of the quad's number, so that an atomic maximum finds the nearest quad, the
first of equal ones, whatever the order of threads. Corners are snapped to 1/4096 pixel; edges are integers with a tie
rule, so joined quads neither overlap nor gap. Triangles that reach the near plane or far outside the image take a slow
way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add, store_max
from torchrender.kernels.atomics import keep as hold
from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.corners import DIAGONAL, FIRST, SECOND
from torchrender.kernels.warp.quads.flat_blocks import COLUMNS, ROWS, is_block_hidden
from torchrender.kernels.warp.quads.homogeneous import cross, point, visible_box
from torchrender.kernels.warp.quads.small_quads import (
    BITS,
    CHUNK,
    CUT,
    HALF,
    LARGE,
    OUTSIDE,
    SUBPIXEL,
    draw_small,
    measure,
    new_room,
)

GUARD = float(1 << 17)  # pixels; snapped positions stay below 2**29
LIFT = 1 << 30  # makes snapped positions positive, so that cutting off is rounding down
NO_PLANES = np.zeros((0, 0, 0, 4))


class Quads(NamedTuple):
    """The quads of B images."""

    corners: np.ndarray  # (B,h,4,w) float32 depths
    shape: np.ndarray  # (B,h,w) uint8
    start: float  # column and row of the first quad's first corner
    planes: np.ndarray = NO_PLANES  # (B,.,.,4) of the blocks of quads: see ``flat_blocks``; without rows: unknown


class Poses(NamedTuple):
    """From pixels of B images to those of the target."""

    matrices: np.ndarray  # (B,3,4): homogeneous target pixel = z M[:, :3] (u, v, 1) + M[:, 3]
    near: float  # of the target
    bias: np.ndarray  # (B,) factors of 1/depth, just below one for images that others go before


class Pose(NamedTuple):
    """The same of one image."""

    matrix: np.ndarray
    near: float
    bias: float


class Canvas(NamedTuple):
    """What is drawn to."""

    keys: np.ndarray  # (H*W,) uint64, zero where nothing is
    width: int
    height: int


@kernel(inline=True)
def project_row(values, part, across, row, pose, k, snapped):
    """Snapped position and biased 1/depth of corner ``k`` of up to CHUNK quads; OUTSIDE where it has none.

    ``values``: corner depths of a row; ``part``: first column and the one past the last; corner ``i`` is at column
    ``part[0] + i + across`` of the source image.
    """
    matrix, near, bias = pose
    x, y, q = snapped.x[k], snapped.y[k], snapped.q[k]
    a0, a1, a2 = matrix[0, 0], matrix[1, 0], matrix[2, 0]
    b0 = matrix[0, 1] * row + matrix[0, 2]
    b1 = matrix[1, 1] * row + matrix[1, 2]
    b2 = matrix[2, 1] * row + matrix[2, 2]
    c0, c1, c2 = matrix[0, 3], matrix[1, 3], matrix[2, 3]
    begin = np.uintp(part[0])
    for i in range(np.uintp(part[1] - part[0])):
        z = np.float64(values[begin + i])
        u = np.float64(begin + i) + across
        depth = z * (a2 * u + b2) + c2
        inverse = 1.0 / depth
        px = (z * (a0 * u + b0) + c0) * inverse
        py = (z * (a1 * u + b1) + c1) * inverse
        good = (depth >= near) & (depth < np.inf) & (abs(px) < GUARD) & (abs(py) < GUARD)
        px = px if good else 0.0
        py = py if good else 0.0
        sx = np.int32(px * SUBPIXEL + (LIFT + 0.5)) - np.int32(LIFT)
        x[i] = sx if good else OUTSIDE
        y[i] = np.int32(py * SUBPIXEL + (LIFT + 0.5)) - np.int32(LIFT)
        q[i] = inverse * bias


@kernel(inline=True)
def key_of(inverse_depth, number):
    return (np.uint64(np.float32(inverse_depth).view(np.uint32)) << np.uint64(32)) | (
        np.uint64(0xFFFFFFFF) - np.uint64(number)
    )


@kernel(inline=True)
def keep(keys, place, inverse_depth, number):
    key = key_of(inverse_depth, number)
    if key > keys[np.uintp(place)]:
        store_max(keys, place, key)


@kernel(inline=True)
def edge(ax, ay, bx, by, px, py):
    """Edge function of a-b at a snapped point, tie rule folded in, and its steps per pixel."""
    dx, dy = bx - ax, by - ay
    owns = dy > 0 or (dy == 0 and dx < 0)
    return dx * (py - ay) - dy * (px - ax) - (0 if owns else 1), -dy * SUBPIXEL, dx * SUBPIXEL


@kernel(inline=True)
def draw(a, b, c, number, canvas):
    """One triangle of snapped corners (x, y, 1/depth) in front-facing order; the others are left out."""
    keys, width, height = canvas
    ax, ay, qa = a
    bx, by, qb = b
    cx, cy, qc = c
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area <= 0:
        return
    x0 = max((min(ax, min(bx, cx)) - HALF + SUBPIXEL - 1) >> BITS, 0)
    x1 = min((max(ax, max(bx, cx)) - HALF) >> BITS, width - 1)
    y0 = max((min(ay, min(by, cy)) - HALF + SUBPIXEL - 1) >> BITS, 0)
    y1 = min((max(ay, max(by, cy)) - HALF) >> BITS, height - 1)
    if x0 > x1 or y0 > y1:
        return
    px, py = x0 * SUBPIXEL + HALF, y0 * SUBPIXEL + HALF
    ea, dax, day = edge(bx, by, cx, cy, px, py)
    eb, dbx, dby = edge(cx, cy, ax, ay, px, py)
    ec, dcx, dcy = edge(ax, ay, bx, by, px, py)
    scale = 1.0 / np.float64(area)
    for v in range(y0, y1 + 1):
        fa, fb, fc = ea, eb, ec
        for u in range(x0, x1 + 1):
            if (fa | fb | fc) >= 0:
                keep(keys, v * width + u, (fa * qa + fb * qb + (area - fa - fb) * qc) * scale, number)
            fa += dax
            fb += dbx
            fc += dcx
        ea += day
        eb += dby
        ec += dcy


@kernel()
def draw_clipped(a, b, c, pose, number, canvas):
    """One triangle of homogeneous corners (X, Y, Z), any of them behind the camera.

    Homogeneous edge functions need no clipping (Olano and Greer, Triangle scan conversion using 2D homogeneous
    coordinates, 1997).
    """
    keys, width, height = canvas
    near = pose.near
    ea, eb, ec = cross(b, c), cross(c, a), cross(a, b)
    volume = a[0] * ea[0] + a[1] * ea[1] + a[2] * ea[2]
    if not volume > 0.0:
        return
    x0, y0, x1, y1 = visible_box(a, b, c, near, width, height)
    for v in range(y0, y1 + 1):
        for u in range(x0, x1 + 1):
            px, py = u + 0.5, v + 0.5
            fa = ea[0] * px + ea[1] * py + ea[2]
            fb = eb[0] * px + eb[1] * py + eb[2]
            fc = ec[0] * px + ec[1] * py + ec[2]
            if fa >= 0.0 and fb >= 0.0 and fc >= 0.0:
                q = (fa + fb + fc) / volume
                if q > 0.0 and q * near <= 1.0:
                    keep(keys, v * width + u, q * pose.bias, number)


@kernel()
def draw_quad_clipped(i, row, start, z, shape, pose, number, canvas):
    """Both triangles of a quad that reaches the near plane or the guard band; ``z`` its four corner depths."""
    matrix, near = pose.matrix, pose.near
    c0 = point(i, row, start, 0.0, z[0], matrix)
    c1 = point(i, row, start, 1.0, z[1], matrix)
    c2 = point(i, row, start + 1.0, 1.0, z[2], matrix)
    c3 = point(i, row, start + 1.0, 0.0, z[3], matrix)
    if shape & DIAGONAL:
        c0, c1, c2, c3 = c1, c2, c3, c0
    if shape & FIRST and max(c0[2], max(c1[2], c2[2])) >= near:
        draw_clipped(c0, c2, c1, pose, number, canvas)
    if shape & SECOND and max(c0[2], max(c2[2], c3[2])) >= near:
        draw_clipped(c2, c0, c3, pose, number, canvas)


@kernel()
def draw_large(i, y, x, q, bits, number, canvas):
    """Both triangles of quad ``i`` of a chunk, of any size but cut by nothing."""
    c0 = (np.int64(x[0, i]), np.int64(y[0, i]), q[0, i])
    c1 = (np.int64(x[1, i]), np.int64(y[1, i]), q[1, i])
    c2 = (np.int64(x[2, i]), np.int64(y[2, i]), q[2, i])
    c3 = (np.int64(x[3, i]), np.int64(y[3, i]), q[3, i])
    if bits & DIAGONAL:
        c0, c1, c2, c3 = c1, c2, c3, c0
    if bits & FIRST:
        draw(c0, c2, c1, number, canvas)
    if bits & SECOND:
        draw(c2, c0, c3, number, canvas)


@kernel()
def draw_row(j, part, quads, pose, number, room, canvas):
    """Up to CHUNK quads of row ``j`` of one image: ``part``, first column and the one past the last.

    ``number``: that of the row's first quad.
    """
    corners, shape, start, _ = quads
    spare, boxes = room.snapped, room.boxes
    row, first = np.float64(j) + start, part[0]
    bits = shape[j, first : part[1]]
    if not is_any(bits):
        return
    project_row(corners[j, 0], part, start, row, pose, 0, spare)
    project_row(corners[j, 1], part, start, row + 1.0, pose, 1, spare)
    project_row(corners[j, 2], part, start + 1.0, row + 1.0, pose, 2, spare)
    project_row(corners[j, 3], part, start + 1.0, row, pose, 3, spare)
    measure(bits, canvas.width, canvas.height, spare, boxes)
    draw_small(bits, number + first, room, canvas)
    for i in range(np.uintp(bits.shape[0])):
        if boxes.size[i] == LARGE:
            draw_large(i, spare.y, spare.x, spare.q, bits[i], number + first + np.int64(i), canvas)
        elif boxes.size[i] == CUT:
            column = first + np.int64(i)
            z = (
                np.float64(corners[j, 0, column]),
                np.float64(corners[j, 1, column]),
                np.float64(corners[j, 2, column]),
                np.float64(corners[j, 3, column]),
            )
            draw_quad_clipped(column, row, start, z, bits[i], pose, number + column, canvas)


@kernel()
def find_hidden(band, size, quads, pose, hidden, canvas):
    """Which blocks of a band of rows cannot show; ``size``: rows and columns of all quads."""
    rows, columns = size
    start, planes = quads.start, quads.planes
    hidden[:] = False
    if planes.shape[0] == 0:
        return
    top, bottom = band * ROWS + start, min((band + 1) * ROWS, rows) + start
    for block in range(hidden.shape[0]):
        box = (block * COLUMNS + start, top, min((block + 1) * COLUMNS, columns) + start, bottom)
        hidden[block] = is_block_hidden(planes[band, block], box, pose, 0.5 * GUARD, canvas)


@kernel()
def draw_band(band, quads, pose, number, room, hidden, canvas):
    """ROWS rows of one image's quads, runs of blocks that are not hidden. ``number``: that of its first quad."""
    rows, columns = quads.shape.shape
    find_hidden(band, (rows, columns), quads, pose, hidden, canvas)
    last = hidden.shape[0]
    block = 0
    while block < last:
        if hidden[block]:
            block += 1
            continue
        end = block + 1
        while end < last and end - block < CHUNK // COLUMNS and not hidden[end]:
            end += 1
        part = (block * COLUMNS, min(end * COLUMNS, columns))
        for j in range(band * ROWS, min((band + 1) * ROWS, rows)):
            draw_row(j, part, quads, pose, number + j * columns, room, canvas)
        block = end


@kernel(inline=True)
def is_any(bits):
    """Whether a chunk has a quad at all."""
    found = np.uint8(0)
    for i in range(np.uintp(bits.shape[0])):
        found |= bits[i]
    return found != 0


@kernel()
def nearest_first(bias):
    """Numbers of the images from the greatest factor down; of equal ones the first."""
    order = np.zeros(bias.shape[0], np.int64)
    for b in range(bias.shape[0]):
        before = 0
        for other in range(bias.shape[0]):
            if bias[other] > bias[b] or (bias[other] == bias[b] and other < b):
                before += 1
        order[before] = b
    return order


@kernel(parallel=True)
def draw_quads(quads, poses, threads, canvas):
    """Draw :class:`Quads` by their :class:`Poses` onto a :class:`Canvas`."""
    corners, shape, start, planes = quads
    matrices, near, bias = poses
    keys, width, height = canvas
    count, rows, _, columns = corners.shape
    bands = (rows + ROWS - 1) // ROWS
    counter = np.zeros(1, np.int64)
    order = nearest_first(bias)  # so that most of the others are hidden
    for _ in prange(threads):
        own_room, own_hidden = new_room(), np.zeros((columns + COLUMNS - 1) // COLUMNS, np.bool_)
        room, hidden, target = borrowed(own_room), borrowed(own_hidden), Canvas(borrowed(keys), width, height)
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= count * bands:
                break
            b = order[turn // bands]
            known = planes[b] if planes.shape[0] > 0 else np.zeros((0, 0, 4))
            own, pose = Quads(corners[b], shape[b], start, known), Pose(matrices[b], near, bias[b])
            draw_band(turn % bands, own, pose, b * rows * columns, room, hidden, target)
        hold(own_room)
        hold(own_hidden)
