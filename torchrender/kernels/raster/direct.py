"""Triangles straight into the tiles of a small picture, cluster by cluster and nearly front to back.

A picture that fits into a core's cache needs no lists of triangles, and what lies hidden is known at once: whole
clusters of it are neither transformed nor looked at.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.binning import (
    MAX_CLIPPED,
    clip_triangles,
    doubled_area,
    is_culled,
    out_of_view,
    pixel_box,
    side_of,
)
from torchrender.kernels.raster.coverage import NO_BITS, ROW, SMALL, WINDOW, move_bits, window_bits, window_start
from torchrender.kernels.raster.lanes.pixels import reaches
from torchrender.kernels.raster.lanes.rows import COLUMN_BITS, ROW_BITS, TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.lanes.vectors import LANES
from torchrender.kernels.raster.project import HALF, SUBPIXEL, greatest_key
from torchrender.kernels.raster.records import Buffers
from torchrender.kernels.raster.samples import CROSSING, LARGE, look_at
from torchrender.kernels.raster.tiles import (
    BLOCK_COLUMN_BITS,
    BLOCK_COLUMNS,
    BLOCK_ROW_BITS,
    BLOCKS,
    draw,
    draw_bits,
    find_low,
    least_low,
)

PIXEL_BITS = COLUMN_BITS + ROW_BITS  # of a tile
SLACK = 2.0**-8  # pixels by which rounding and snapping may move a vertex out of the box of its cluster


class Canvas(NamedTuple):
    """All tiles of a picture or a part of it, one after the other."""

    keys: np.ndarray  # (tiles << PIXEL_BITS,) float64
    ids: np.ndarray  # (tiles << PIXEL_BITS,) int32
    lows: np.ndarray  # (tiles * BLOCKS,) float64 least keys of blocks, as of the last finished cluster
    columns: int  # tiles side by side
    left: int  # first column and row of the image, of tiles, and last ones
    top: int
    right: int
    bottom: int


@kernel(inline=True)
def part_of(canvas):
    """x0, y0, x1, y1 of the image, inclusive."""
    return canvas.left, canvas.top, canvas.right, canvas.bottom


@kernel(inline=True)
def tile_at(canvas, column, row):
    """The number of the tile in this column and row of the image's tiles."""
    return (row - (canvas.top >> ROW_BITS)) * canvas.columns + column - (canvas.left >> COLUMN_BITS)


@kernel(inline=True)
def tile_buffers(canvas, tile, buffers):
    """:class:`Buffers` of a tile."""
    spans, known, planes = buffers.spans, buffers.known, buffers.planes
    return Buffers(tile << PIXEL_BITS, canvas.keys, canvas.ids, canvas.lows, spans, known, planes)


@kernel()
def clear_canvas(canvas, frame):
    """Nothing yet; pixels of the tiles that lie outside of the part hold what nothing exceeds."""
    keys, ids = borrowed(canvas.keys), borrowed(canvas.ids)
    empty = np.nextafter(-frame.far if frame.orthographic else 1.0 / frame.far, -np.inf)
    rows = (canvas.bottom - canvas.top + TILE_HEIGHT) >> ROW_BITS
    for n in range(np.uintp(canvas.columns * rows << PIXEL_BITS)):
        keys[n] = empty
        ids[n] = -1
    for n in range(np.uintp(canvas.columns * rows * BLOCKS)):
        canvas.lows[n] = empty
    for tile in range(canvas.columns * rows):
        across = canvas.right + 1 - canvas.left - ((tile % canvas.columns) << COLUMN_BITS)
        down = canvas.bottom + 1 - canvas.top - ((tile // canvas.columns) << ROW_BITS)
        if across >= TILE_WIDTH and down >= TILE_HEIGHT:
            continue
        for y in range(TILE_HEIGHT):
            for x in range(TILE_WIDTH):
                if x >= across or y >= down:
                    keys[(tile << PIXEL_BITS) + (y << COLUMN_BITS) + x] = np.inf


@kernel(inline=True)
def block_at(canvas, column, row):
    """Number of the block in this column and row of the image's blocks, and the place of its first pixel."""
    across, down = COLUMN_BITS - BLOCK_COLUMN_BITS, ROW_BITS - BLOCK_ROW_BITS
    tile = tile_at(canvas, column >> across, row >> down)
    x, y = column & ((1 << across) - 1), row & ((1 << down) - 1)
    place = (tile << PIXEL_BITS) + (y << (BLOCK_ROW_BITS + COLUMN_BITS)) + (x << BLOCK_COLUMN_BITS)
    return np.uintp(tile * BLOCKS + y * BLOCK_COLUMNS + x), np.uintp(place)


@kernel(inline=True)
def refresh_lows(canvas, box):
    """Find the least keys of the blocks that a box of the image meets."""
    x0, y0, x1, y1 = box
    for j in range(y0 >> BLOCK_ROW_BITS, (y1 >> BLOCK_ROW_BITS) + 1):
        for i in range(x0 >> BLOCK_COLUMN_BITS, (x1 >> BLOCK_COLUMN_BITS) + 1):
            block, place = block_at(canvas, i, j)
            canvas.lows[block] = find_low(canvas.keys, place)


@kernel(inline=True)
def is_block_hidden(keys, place, part, high):
    """As :func:`is_box_hidden`, of a part of a block: first column and row, last column and row in it."""
    x0, y0, x1, y1 = part
    for x in range(0, 1 << BLOCK_COLUMN_BITS, LANES):
        begin, end = max(x0 - x, 0), min(x1 - x, LANES - 1)
        if begin > end:
            continue
        mask = ROW << np.uint64(begin) & ROW >> np.uint64(LANES - 1 - end)
        for y in range(y0, y1 + 1):
            if reaches(keys, place + np.uintp((y << COLUMN_BITS) + x), mask, high):
                return False
    return True


@kernel(inline=True)
def is_box_hidden(canvas, box, high):
    """True if every pixel of a box of the image holds something nearer than the key ``high``.

    Pixels are compared only in blocks whose least key does not tell.
    """
    x0, y0, x1, y1 = box
    for j in range(y0 >> BLOCK_ROW_BITS, (y1 >> BLOCK_ROW_BITS) + 1):
        top = j << BLOCK_ROW_BITS
        for i in range(x0 >> BLOCK_COLUMN_BITS, (x1 >> BLOCK_COLUMN_BITS) + 1):
            block, place = block_at(canvas, i, j)
            if high < canvas.lows[block]:
                continue
            left = i << BLOCK_COLUMN_BITS
            last_x, last_y = (1 << BLOCK_COLUMN_BITS) - 1, (1 << BLOCK_ROW_BITS) - 1
            part = (max(x0 - left, 0), max(y0 - top, 0), min(x1 - left, last_x), min(y1 - top, last_y))
            if not is_block_hidden(canvas.keys, place, part, high):
                return False
    return True


@kernel()
def cluster_reach(bounds, c, matrix, eye, frame):
    """Pixels x0, y0, x1, y1 that cluster ``c`` may touch, and a key that none of its fragments exceeds.

    All of the image, and infinity, where it reaches the near plane.
    """
    width, height, near, _, orthographic = frame
    least_x = least_y = least_w = np.inf
    most_x = most_y = -np.inf
    size = 0.0
    for k in range(3):
        size += abs(matrix[2, k]) * max(abs(bounds[c, 0, k] - eye[k]), abs(bounds[c, 1, k] - eye[k]))
    for corner in range(8):
        x = bounds[c, corner & 1, 0] - eye[0]
        y = bounds[c, (corner >> 1) & 1, 1] - eye[1]
        z = bounds[c, corner >> 2, 2] - eye[2]
        px = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z
        py = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z
        w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z
        inverse = 1.0 if orthographic else 1.0 / w
        least_w = min(least_w, w)
        least_x, most_x = min(least_x, px * inverse), max(most_x, px * inverse)
        least_y, most_y = min(least_y, py * inverse), max(most_y, py * inverse)
    least_w -= 1e-12 * size
    if not least_w > near:
        return 0, 0, width - 1, height - 1, np.inf
    middle_x, middle_y = np.float64(width >> 1), np.float64(height >> 1)
    x0 = np.int64(np.ceil(min(max(least_x + middle_x - 0.5 - SLACK, 0.0), np.float64(width))))
    y0 = np.int64(np.ceil(min(max(least_y + middle_y - 0.5 - SLACK, 0.0), np.float64(height))))
    x1 = np.int64(np.floor(min(max(most_x + middle_x - 0.5 + SLACK, -1.0), width - 1.0)))
    y1 = np.int64(np.floor(min(max(most_y + middle_y - 0.5 + SLACK, -1.0), height - 1.0)))
    return x0, y0, x1, y1, -least_w if orthographic else 1.0 / least_w


@kernel()
def cluster_reaches(bounds, chosen, pose, frame, boxes, highs):
    """:func:`cluster_reach` of the chosen clusters: ``boxes`` (N,4) int64 and ``highs`` (N,) float64."""
    bounds, (matrix, eye) = borrowed(bounds), borrowed(pose)
    for n in range(chosen.shape[0]):
        boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3], highs[n] = cluster_reach(
            bounds, chosen[n], matrix, eye, frame
        )


@kernel(inline=True)
def box_within(canvas, box):
    """What the canvas holds of a box of the image."""
    x0, y0, x1, y1 = box
    return max(x0, canvas.left), max(y0, canvas.top), min(x1, canvas.right), min(y1, canvas.bottom)


@kernel(inline=True)
def draw_box(place, corners, high, scene, frame, tests, canvas, buffers):
    """One triangle into the tiles that its box of pixels meets; returns the number of pixels tried."""
    a, b, c = corners
    x0, y0, x1, y1 = pixel_box(a, b, c, part_of(canvas), frame.width >> 1, frame.height >> 1)
    tried = np.int64(0)
    if x0 > x1 or y0 > y1:
        return tried
    for j in range(y0 >> ROW_BITS, (y1 >> ROW_BITS) + 1):
        for i in range(x0 >> COLUMN_BITS, (x1 >> COLUMN_BITS) + 1):
            left, top = i << COLUMN_BITS, j << ROW_BITS
            own = (max(x0, left), max(y0, top), min(x1, left + TILE_WIDTH - 1), min(y1, top + TILE_HEIGHT - 1))
            part = (own[0] - left, own[1] - top, own[2] - left, own[3] - top, left, top)
            tile = tile_at(canvas, i, j)
            if high < least_low(canvas.lows, tile * BLOCKS, part[0], part[1], part[2], part[3]):
                continue
            tried += draw(place, corners, part, high, scene, frame, tests, tile_buffers(canvas, tile, buffers))
    return tried


@kernel()
def draw_clipped(scene, places, frame, sides, tests, tiles):
    """The triangles at these places, which cross the near plane or leave the guard band; as :func:`draw_box`."""
    corners = np.empty(((MAX_CLIPPED - 2) * places.shape[0], 3), np.int64)
    owners = np.empty(corners.shape[0], np.int32)
    canvas, buffers = tiles
    cull, single_sided = sides
    made = clip_triangles(scene.points, scene.listed, places, frame, (cull, single_sided, scene.order), corners, owners)
    tried = np.int64(0)
    for n in range(made):
        triangle = (corners[n, 0], corners[n, 1], corners[n, 2])
        tried += draw_box(np.uintp(owners[n]), triangle, np.inf, scene, frame, tests, canvas, buffers)
    return tried


@kernel(inline=True)
def draw_whole(place, corners, code, box, scene, frame, earlier, tiles):
    """A triangle whose box is a part of one tile and no larger than a window; returns the number of pixels tried."""
    a, b, c = corners
    canvas, buffers = tiles
    x0, y0, x1, y1 = box
    column, row = x0 >> COLUMN_BITS, y0 >> ROW_BITS
    left, top = column << COLUMN_BITS, row << ROW_BITS
    small = (x1 - x0 + 1) * (y1 - y0 + 1) <= SMALL
    tile = tile_at(canvas, column, row)
    high = greatest_key(scene.points, scene.listed, place, frame)
    bits = np.uint64(code)
    if code == LARGE:
        if high < least_low(canvas.lows, tile * BLOCKS, x0 - left, y0 - top, x1 - left, y1 - top):
            return np.int64(0)
        x0, y0 = window_start(x0, y0, x1)
        px, py = x0 - (frame.width >> 1), y0 - (frame.height >> 1)
        pixel = (px * SUBPIXEL + HALF, py * SUBPIXEL + HALF)
        bits = window_bits(a, b, c, doubled_area(a, b, c), pixel, y1 - y0 + 1)
        if bits == NO_BITS:
            return np.int64(0)
    else:
        bits, x0 = move_bits(bits, x0)
    spot, own = (x0 - left, y0 - top, left, top, small), tile_buffers(canvas, tile, buffers)
    return np.int64(draw_bits(place, bits, spot, high, scene, frame, earlier, own))


@kernel(inline=True)
def draw_chunk(scene, part, frame, sides, tests, canvas, buffers, room):
    """The triangles of :func:`~.samples.look_at`; ``part``: the place of the first one, and how many were found.

    ``room``: a :class:`~.samples.Chunk` and places of triangles to clip; returns how many these are, and the number of
    pixels tried.
    """
    scene, tests = borrowed(scene), borrowed(tests)
    canvas, buffers = borrowed(canvas), borrowed(buffers)
    chunk, to_clip = borrowed(room)
    begin, found = part
    cull, single_sided = sides
    single_sided = borrowed(single_sided)
    image = part_of(canvas)
    left, top = frame.width >> 1, frame.height >> 1
    holed = tests.holes.mask.shape[0] > 0
    m, tried = np.uintp(0), np.int64(0)
    for number in range(found):
        n = np.uintp(chunk.found[number])
        code = chunk.codes[n]
        place = np.uintp(begin) + n
        if code == CROSSING:
            if not out_of_view(
                scene.points, scene.listed, place, frame.near, frame.far, frame.orthographic,
                frame.width * 0.5 + 1, frame.height * 0.5 + 1,
            ):  # fmt: skip
                to_clip[m] = place
                m += np.uintp(1)
            continue
        a, b, c = chunk.a[n], chunk.b[n], chunk.c[n]
        t = np.uintp(scene.order[place])
        if single_sided.shape[0] > 0 and is_culled(doubled_area(a, b, c), side_of(t, cull, single_sided)):
            continue
        box = pixel_box(a, b, c, image, left, top)
        whole = box[0] >> COLUMN_BITS == box[2] >> COLUMN_BITS and box[1] >> ROW_BITS == box[3] >> ROW_BITS
        whole = whole and max(box[2] - box[0], box[3] - box[1]) < WINDOW
        if whole and not (holed and tests.holes.mask[t] >= 0):
            tried += draw_whole(place, (a, b, c), code, box, scene, frame, tests.earlier, (canvas, buffers))
            continue
        high = greatest_key(scene.points, scene.listed, place, frame)
        tried += draw_box(place, (a, b, c), high, scene, frame, tests, canvas, buffers)
    return np.int64(m), tried


@kernel(inline=True)
def draw_cluster(scene, packed, run, frame, sides, tests, tiles, room):
    """The triangles at the places ``run[0]`` to ``run[1] - 1``; returns the number of pixels tried.

    ``packed``: the memory of the scene's points as integers; ``sides``: what to cull of all triangles, and which ones
    are single-sided (F,) or (0,); ``tiles``: :class:`Canvas` and :class:`Buffers`; ``room``: as of :func:`draw_chunk`.
    """
    canvas, buffers = tiles
    found = look_at(packed, scene.listed, run, frame, part_of(canvas), sides[0], room[0])
    crossing, tried = draw_chunk(scene, (run[0], found), frame, sides, tests, canvas, buffers, room)
    if crossing > 0:
        tried += draw_clipped(scene, room[1][:crossing], frame, sides, tests, tiles)
    return tried
