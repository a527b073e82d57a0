"""Counting the surfaces in front of what each pixel stores: the rasteriser's loop over tiles without a depth buffer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add, keep
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.binning import doubled_area, pixel_box
from torchrender.kernels.raster.coverage import ROW, lanes_start, row_ends
from torchrender.kernels.raster.fragments import is_hole
from torchrender.kernels.raster.lanes.counted import count_lanes
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.lanes.vectors import LANES
from torchrender.kernels.raster.project import HALF, SUBPIXEL, barycentric_planes, greatest_key, key_plane
from torchrender.kernels.raster.tiles import (
    AHEAD,
    BLOCK_COLUMN_BITS,
    BLOCK_COLUMNS,
    BLOCK_ROW_BITS,
    BLOCKS,
    fetch,
    look_ahead,
    look_at_place,
)


class Covered(NamedTuple):
    """Where a triangle covers a tile."""

    x0: int  # first column and first and last row in the tile
    y0: int
    y1: int
    left: int  # of the tile
    top: int
    origin: tuple[int, int]  # of the tile, from the image centre
    first: np.ndarray  # (rows,) first and last covered column, from x0
    last: np.ndarray


@kernel(inline=True)
def count_row(t, keys, limits, row, part, stored, outputs):
    """Add one triangle to the columns ``part[0]`` to ``part[1] - 1`` of a row.

    ``keys`` = (first key, step, least, greatest), ``limits`` = (eps, eps, far). No slices: those count references.
    """
    depth, triangle = stored
    count, touching, worth = outputs
    own = worth[t] if worth.shape[0] > 0 else np.int32(1)
    base, step, low, high = keys
    relative, absolute, far = limits
    first = np.uintp(part[0])
    for n in range(np.uintp(part[1]) - first):
        x = first + n
        key = min(max(base + step * np.float64(n), low), high)
        z = np.float32(1.0 / key)
        here = depth[row, x]
        # As the depth test decides: equal depths go to the lower id.
        nearer = ((z < here) | ((z == here) & (t < triangle[row, x]))) & (z <= far)
        count[row, x] += np.int32(nearer) * own
        touching[row, x] |= nearer & (np.float64(z) * (1.0 + relative) + absolute >= np.float64(here))


@kernel()
def count_holed(t, keys, limits, spot, part, scene, holes, images):
    """As :func:`count_row` for a triangle with holes.

    ``spot``: first pixel from the image centre; ``part``: row, first column and the one past the last; ``images``:
    :class:`Stored` and :class:`Nearer`.
    """
    faces = scene.faces
    stored, outputs = images
    base, step, low, high = keys
    px, py = spot
    row, begin, end = part
    ux, uy, uc, vx, vy, vc = barycentric_planes(scene.points, faces, t, False)
    for x in range(end - begin):
        key = min(max(base + step * x, low), high)
        u, v = (ux * (px + x) + uy * py + uc) / key, (vx * (px + x) + vy * py + vc) / key
        if not is_hole(t, u, v, faces, holes):
            one = (begin + x, begin + x + 1)
            count_row(t, (base + step * x, step, low, high), limits, np.uintp(row), one, stored, outputs)


@kernel(inline=True)
def count_span(t, plane, span, scene, holes, stored, limits, outputs):
    """Add triangle ``t`` to some columns of a row of a tile.

    ``span``: the row and the first and last column in the tile, and where the tile begins in the image and from its
    centre.
    """
    kx, ky, kc, low, high = plane
    y, begin, end, left, top, column, row = span
    px, py = column + begin + 0.5, row + y + 0.5
    base = kc + ky * py + kx * px
    part = (left + begin, left + end + 1)
    if holes.mask.shape[0] > 0 and holes.mask[t] >= 0:
        row_span = (top + y, part[0], part[1])
        count_holed(t, (base, kx, low, high), limits, (px, py), row_span, scene, holes, (stored, outputs))
        return
    start = lanes_start(begin, end)
    if left + start + (end - start) // LANES * LANES + LANES > stored.depth.shape[1]:
        count_row(t, (base, kx, low, high), limits, np.uintp(top + y), part, stored, outputs)
        return
    relative, absolute, far = limits
    least = np.float64(np.float32(1.0 / high))
    images = (stored.depth, stored.triangle, outputs.number, outputs.touching)
    own = outputs.worth[t] if outputs.worth.shape[0] > 0 else np.int32(1)
    for x in range(start, end + 1, LANES):
        mask = ROW << np.uint64(max(begin - x, 0)) & ROW >> np.uint64(max(x + LANES - 1 - end, 0))
        spot = (np.uintp(top + y), np.uintp(left + x))
        plane = (base, kx, np.float64(x - begin), low, high)
        count_lanes(images, spot, mask, plane, (1.0 + relative, absolute, far, least), (t, own))


@kernel(inline=True)
def count_triangle(place, pixels, scene, frame, holes, stored, limits, outputs):
    """Add the triangle at a place in the order to the pixels of a tile that it covers: :class:`Covered`."""
    x0, y0, y1, left, top, origin, first, last = pixels
    t = np.int64(scene.order[place])
    plane = key_plane(scene.points, scene.listed, place, frame)
    for y in range(y0, y1 + 1):
        begin, end = x0 + first[y - y0], x0 + last[y - y0]
        if begin > end:
            continue
        span = (y, begin, end, left, top, origin[0], origin[1])
        count_span(t, plane, span, scene, holes, stored, limits, outputs)


@kernel(inline=True)
def find_farthest(depth, left, top, right, bottom, farthest):
    """Greatest depth stored in each block of a tile, 0 outside of it; returns that of all."""
    # As integers, of which LLVM finds the greatest of many at once: depths are not negative.
    whole, found = depth.view(np.int32), farthest.view(np.int32)
    found[:] = 0
    for y in range(np.uintp(top), np.uintp(bottom + 1)):
        row = ((y - np.uintp(top)) >> np.uintp(BLOCK_ROW_BITS)) * np.uintp(BLOCK_COLUMNS)
        for i in range(np.uintp((right - left) >> BLOCK_COLUMN_BITS) + np.uintp(1)):
            first = np.uintp(left) + (i << np.uintp(BLOCK_COLUMN_BITS))
            greatest = np.int32(0)
            for x in range(first, min(first + np.uintp(1 << BLOCK_COLUMN_BITS), np.uintp(right + 1))):
                greatest = max(greatest, whole[y, x])
            found[row + i] = max(found[row + i], greatest)
    return farthest.max()


@kernel(inline=True)
def lies_behind(nearest, box, farthest):
    """True if a triangle whose fragments are no nearer than this lies behind all that is stored in its box."""
    for j in range(box[1] >> BLOCK_ROW_BITS, (box[3] >> BLOCK_ROW_BITS) + 1):
        for i in range(box[0] >> BLOCK_COLUMN_BITS, (box[2] >> BLOCK_COLUMN_BITS) + 1):
            if nearest <= farthest[np.uintp(j * BLOCK_COLUMNS + i)]:
                return False
    return True


@kernel()
def count_tile(scene, bins, frame, holes, stored, work, k, outputs):
    """Count in tile ``k``; ``work`` = (distance of touching surfaces, relative and absolute; row ends)."""
    scene, holes, stored, outputs = borrowed(scene), borrowed(holes), borrowed(stored), borrowed(outputs)
    eps, ends = borrowed(work)
    starts, entries = borrowed(bins.starts), borrowed(bins.entries)
    width, height = frame.width, frame.height
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    left, top = (k % columns) * TILE_WIDTH, (k // columns) * TILE_HEIGHT
    right, bottom = min(left + TILE_WIDTH, width) - 1, min(top + TILE_HEIGHT, height) - 1
    room = np.empty(BLOCKS, np.float32)
    farthest = borrowed(room)
    most = find_farthest(stored.depth, left, top, right, bottom, farthest)
    if not most > 0.0:
        return  # nothing is asked for
    origin = (left - (width >> 1), top - (height >> 1))
    limits = (eps[0], eps[1], frame.far)
    first, past = starts[k], starts[k + 1]
    for n in range(first, past):
        entry = np.uintp(entries[np.uintp(n)])
        look_ahead(scene, np.uintp(entries[np.uintp(min(n + AHEAD, past - 1))]))
        look_at_place(scene, np.uintp(entries[np.uintp(min(n + AHEAD // 2, past - 1))]))
        listed = entry < np.uintp(scene.places.shape[0])
        if listed:
            nearest = np.float32(1.0 / scene.highs[entry])
            if nearest > most:
                continue
        place, a, b, c = fetch(entry, scene)
        x0, y0, x1, y1 = pixel_box(a, b, c, (left, top, right, bottom), width >> 1, height >> 1)
        if x0 > x1 or y0 > y1:
            continue
        box = (x0 - left, y0 - top, x1 - left, y1 - top)
        if not listed:
            nearest = np.float32(1.0 / greatest_key(scene.points, scene.listed, place, frame))
        if lies_behind(nearest, box, farthest):
            continue
        pixel = ((origin[0] + box[0]) * SUBPIXEL + HALF, (origin[1] + box[1]) * SUBPIXEL + HALF)
        size = (box[2] - box[0] + 1, box[3] - box[1] + 1)
        if row_ends((a, b, c), doubled_area(a, b, c), pixel, size, ends[0], ends[1]) == 0:
            continue
        pixels = Covered(box[0], box[1], box[3], left, top, origin, ends[0], ends[1])
        count_triangle(place, pixels, scene, frame, holes, stored, limits, outputs)
    keep(room)


@kernel(parallel=True)
def count_tiles(scene, bins, frame, holes, stored, eps, ends, outputs):
    """Count nearer surfaces in every tile.

    ``stored``: :class:`Stored`; ``eps`` = (relative, absolute) distance of touching surfaces; ``ends``
    (threads,2,rows): scratch; ``outputs``: :class:`Nearer`, all zero; perspective views only.
    """
    order, counter = bins.order, bins.turn
    for thread in prange(ends.shape[0]):
        own = (ends[thread, 0], ends[thread, 1])
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= order.shape[0]:
                break
            count_tile(scene, bins, frame, holes, stored, (eps, own), order[turn], outputs)
