"""Records of points to pixels: sorted into tiles, then two passes in each tile, nearest depth and blending.

Points keep their order within a tile whatever the number of threads: pictures are the same bit by bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.points.ewa import (
    BLUE,
    GREEN,
    INVERSE_HIGH,
    INVERSE_LOW,
    INVERSE_Z,
    LOW_PASS,
    RED,
    SCALE,
    SLOPE_X,
    SLOPE_Y,
    SQUARE,
    TOLERANCE,
    XX,
    XY,
    YY,
    U,
    V,
)  # fmt: skip

TILE = 32
PAD = 4  # pixels around a tile that low-pass stamps may spill over: their loops then need no limits
SIDE = TILE + 2 * PAD
STEPS = 16  # positions within a pixel that have a low-pass stamp of their own, per axis


class Binned(NamedTuple):
    """Projected points, and those of each tile."""

    records: np.ndarray  # (M,RECORD) float32
    boxes: np.ndarray  # (M,BOX) int16
    entries: np.ndarray  # (E,) int32 points, tile after tile
    start: np.ndarray  # (T+1,) int64 first entry of each tile


class Weights(NamedTuple):
    """How much a point weighs in its pixels."""

    reach: np.float32  # radius of the low-pass, pixels
    stamps: np.ndarray  # (STEPS,STEPS,side,side) float32 low-pass by position within a pixel
    polynomial: np.ndarray  # (9,) float32 of exp(-q / (2 kappa^2))


class Picture(NamedTuple):
    """What is drawn to."""

    image: np.ndarray  # (H,W,3) float32
    depth: np.ndarray  # (H,W) float32
    weight: np.ndarray  # (H,W) float32
    evaluations: np.ndarray  # (T,) int64 kernel weights that were computed in each tile


class Paint(NamedTuple):
    """What a point adds to a pixel, times its weight there."""

    iz: np.float32
    tolerance: np.float32
    scale: np.float32
    red: np.float32
    green: np.float32
    blue: np.float32
    depth: np.float32


class Ellipse(NamedTuple):
    """Weight and inverse depth of a point over the image."""

    u: np.float32  # centre, from the box
    v: np.float32
    iz: np.float32  # inverse depth there
    xx: np.float32
    xy: np.float32
    yy: np.float32
    slope_x: np.float32
    slope_y: np.float32
    low: np.float32
    high: np.float32


@kernel()
def scan_tiles(tiles, start):
    """Turn the counts (chunks, tiles) into first places; ``start`` (tiles + 1,) first place of each tile."""
    place = 0
    for tile in range(tiles.shape[1]):
        start[tile] = place
        for chunk in range(tiles.shape[0]):
            count = tiles[chunk, tile]
            tiles[chunk, tile] = place
            place += count
    start[tiles.shape[1]] = place


@kernel(parallel=True)
def sort_points(boxes, runs, tiles, across, threads, entries):
    """Write the number of every point into each tile that its box meets; ``runs`` (chunks, 2) of points."""
    counter = np.zeros(1, np.int64)
    for worker in prange(threads):
        while True:
            chunk = fetch_add(counter, 0, 1)
            if chunk >= len(runs):
                break
            for point in range(runs[chunk, 0], runs[chunk, 1]):
                x0, x1, y0, y1 = boxes[point, 0], boxes[point, 1], boxes[point, 2], boxes[point, 3]
                if x0 > x1:
                    continue
                for ty in range(max(y0, 0) // TILE, y1 // TILE + 1):
                    for tx in range(max(x0, 0) // TILE, x1 // TILE + 1):
                        tile = ty * across + tx
                        entries[tiles[chunk, tile]] = point
                        tiles[chunk, tile] += 1


@kernel(inline=True)
def stamp_step(offset, reach):
    """Which stamp: ``offset`` lies in (reach - 1, reach]."""
    return min(max(int((reach - offset) * np.float32(STEPS)), 0), STEPS - 1)


@kernel(inline=True)
def weight_of(q, p):
    """exp(-q / (2 kappa^2)) for 0 <= q <= 1 by its polynomial."""
    return ((((((((p[8] * q + p[7]) * q + p[6]) * q + p[5]) * q + p[4]) * q + p[3]) * q + p[2]) * q + p[1]) * q) + p[0]


@kernel(inline=True)
def add(sums, y, x, w, paint):
    """Add a weight and what it weighs; read before written, so that it becomes one vector operation."""
    red, green, blue, depth = paint.red, paint.green, paint.blue, paint.depth
    r, g, b, s, d = sums[y, x, 0], sums[y, x, 1], sums[y, x, 2], sums[y, x, 3], sums[y, x, 4]
    r, g, b, s, d = r + w * red, g + w * green, b + w * blue, s + w, d + w * depth
    sums[y, x, 0], sums[y, x, 1], sums[y, x, 2], sums[y, x, 3], sums[y, x, 4] = r, g, b, s, d


@kernel(inline=True)
def nearest_stamp(side, y0, x0, iz, stamp, nearest):
    """Low-pass stamp in the depth pass. The usual side of 2 is passed as a constant: its loops are unrolled."""
    none = np.float32(0.0)
    for j in range(side):
        for i in range(side):
            at = iz if stamp[j, i] > none else none
            nearest[y0 + j, x0 + i] = max(nearest[y0 + j, x0 + i], at)


@kernel(inline=True)
def blend_stamp(side, y0, x0, paint, stamp, nearest, sums):
    """Low-pass stamp in the blend pass."""
    one, none = np.float32(1.0), np.float32(0.0)
    for j in range(side):
        for i in range(side):
            front = nearest[y0 + j, x0 + i]
            w = paint.scale * stamp[j, i]
            w = w if paint.iz * (one + paint.tolerance * front) >= front else none
            add(sums, y0 + j, x0 + i, w, paint)


@kernel(inline=True)
def stamp_of(record, weights):
    """The low-pass stamp for a point's position within its pixel."""
    reach = weights.reach
    return weights.stamps[stamp_step(record[V], reach), stamp_step(record[U], reach)]


@kernel(inline=True)
def covered(box, left, top):
    """First and last column and row of a box within a tile whose buffers begin at ``left`` and ``top``."""
    xa, xb = max(box[0], left + PAD), min(box[1], left + PAD + TILE - 1)
    ya, yb = max(box[2], top + PAD), min(box[3], top + PAD + TILE - 1)
    return xa, xb, ya, yb


@kernel(inline=True)
def ellipse_of(record):
    return Ellipse(
        record[U], record[V], record[INVERSE_Z], record[XX], record[XY], record[YY],
        record[SLOPE_X], record[SLOPE_Y], record[INVERSE_LOW], record[INVERSE_HIGH],
    )  # fmt: skip


@kernel(inline=True)
def ellipse_row(e, y):
    """What a row ``y`` pixels below the box's first one adds to the form, twice, and to the inverse depth."""
    dy = np.float32(y) - e.v
    return e.xy * dy, e.yy * dy * dy, e.iz + e.slope_y * dy


@kernel(inline=True)
def ellipse_at(e, row, x):
    """Value of the form, 1 on the outline, and inverse depth, ``x`` pixels right of the box's first one."""
    dx = np.float32(x) - e.u
    return (e.xx * dx + row[0]) * dx + row[1], min(max(row[2] + e.slope_x * dx, e.low), e.high)


@kernel(inline=True)
def nearest_pass(record, box, left, top, weights, nearest):
    """Greatest inverse depth per pixel of a tile; ``left`` and ``top`` are those of its buffers, ``PAD`` included.

    Which pixels a point covers cannot be guessed: selecting values is several times as fast as branching.
    """
    one, none = np.float32(1.0), np.float32(0.0)
    xa, xb, ya, yb = covered(box, left, top)
    side = weights.stamps.shape[2]
    iz, mode = record[INVERSE_Z], box[4]
    if mode == SQUARE:
        for y in range(ya, yb + 1):
            for x in range(xa, xb + 1):
                nearest[y - top, x - left] = max(nearest[y - top, x - left], iz)
    elif mode == LOW_PASS:
        stamp = stamp_of(record, weights)
        y0, x0 = box[2] - top, box[0] - left
        if side == 2:
            nearest_stamp(2, y0, x0, iz, stamp, nearest)
        else:
            nearest_stamp(side, y0, x0, iz, stamp, nearest)
    else:
        ellipse = ellipse_of(record)
        for y in range(ya, yb + 1):
            row = ellipse_row(ellipse, y - box[2])
            for x in range(xa, xb + 1):
                q, at = ellipse_at(ellipse, row, x - box[0])
                at = at if q <= one else none
                nearest[y - top, x - left] = max(nearest[y - top, x - left], at)


@kernel(inline=True)
def blend_pass(record, box, left, top, weights, nearest, sums):
    """Add weight and weighted colour and depth where the point lies within its tolerance of the nearest surface.

    z <= depth + tolerance, in inverse depths without a division: iz (1 + tolerance front) >= front.
    """
    one, none = np.float32(1.0), np.float32(0.0)
    xa, xb, ya, yb = covered(box, left, top)
    side = weights.stamps.shape[2]
    iz, mode, tolerance, scale = record[INVERSE_Z], box[4], record[TOLERANCE], record[SCALE]
    red, green, blue = record[RED], record[GREEN], record[BLUE]
    evaluated = 0
    if mode == SQUARE:
        paint = Paint(iz, none, one, red, green, blue, one / iz)
        for y in range(ya - top, yb + 1 - top):
            for x in range(xa - left, xb + 1 - left):
                add(sums, y, x, one if iz >= nearest[y, x] else none, paint)
    elif mode == LOW_PASS:
        paint = Paint(iz, tolerance, scale, red, green, blue, one / iz)
        stamp = stamp_of(record, weights)
        y0, x0 = box[2] - top, box[0] - left
        if side == 2:
            blend_stamp(2, y0, x0, paint, stamp, nearest, sums)
        else:
            blend_stamp(side, y0, x0, paint, stamp, nearest, sums)
    else:
        ellipse = ellipse_of(record)
        for y in range(ya, yb + 1):
            row = ellipse_row(ellipse, y - box[2])
            for x in range(xa, xb + 1):
                q, at = ellipse_at(ellipse, row, x - box[0])
                front = nearest[y - top, x - left]
                seen = (q <= one) & (at * (one + tolerance * front) >= front)
                w = scale * weight_of(min(max(q, none), one), weights.polynomial)
                w = w if seen else none
                add(sums, y - top, x - left, w, Paint(at, tolerance, scale, red, green, blue, one / at))
                evaluated += 1 if seen else 0
    return evaluated


@kernel(parallel=True)
def draw_tiles(binned, weights, across, background, threads, out):
    """Both passes and the normalisation of every tile: :class:`Binned` points into a :class:`Picture`.

    ``weights``: :class:`Weights`; ``across``: tiles side by side; ``background`` (3,) where no point is.
    """
    image, depth, weight, evaluations = out
    start, entries = binned.start, binned.entries
    height, width = weight.shape
    counter = np.zeros(1, np.int64)
    for worker in prange(threads):
        nearest = np.zeros((SIDE, SIDE), np.float32)
        sums = np.zeros((SIDE, SIDE, 8), np.float32)
        z, s, r, b = borrowed(nearest), borrowed(sums), borrowed(binned.records), borrowed(binned.boxes)
        own = borrowed(weights)
        while True:
            tile = fetch_add(counter, 0, 1)
            if tile >= len(start) - 1:
                break
            top, left = (tile // across) * TILE, (tile % across) * TILE
            nearest[:] = 0
            sums[:] = 0
            for entry in range(start[tile], start[tile + 1]):
                point = entries[entry]
                nearest_pass(r[point], b[point], left - PAD, top - PAD, own, z)
            evaluated = 0
            for entry in range(start[tile], start[tile + 1]):
                point = entries[entry]
                evaluated += blend_pass(r[point], b[point], left - PAD, top - PAD, own, z, s)
            evaluations[tile] = evaluated
            for y in range(top, min(top + TILE, height)):
                for x in range(left, min(left + TILE, width)):
                    cell = sums[y - top + PAD, x - left + PAD]
                    w = cell[3]
                    weight[y, x] = w
                    if w > 0:
                        image[y, x, 0], image[y, x, 1], image[y, x, 2] = cell[0] / w, cell[1] / w, cell[2] / w
                        depth[y, x] = cell[4] / w
                    else:
                        image[y, x, 0], image[y, x, 1], image[y, x, 2] = background[0], background[1], background[2]
                        depth[y, x] = np.inf
