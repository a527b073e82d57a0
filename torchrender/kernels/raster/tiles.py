"""The rasteriser's main loop: one tile at a time, triangles nearly front to back.

Depth and barycentrics come from the unsnapped plane, so snapping never moves a depth."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add, foresee
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.binning import doubled_area, pixel_box
from torchrender.kernels.raster.coverage import (
    NO_BITS,
    SMALL,
    WINDOW,
    are_hidden,
    fill_samples,
    fill_tested,
    fill_unseen,
    fill_unseen_window,
    fill_window,
    is_hidden,
    row_ends,
    window_bits,
    window_start,
)
from torchrender.kernels.raster.fragments import is_identity_alone, only_identity
from torchrender.kernels.raster.lanes.pixels import least_of
from torchrender.kernels.raster.lanes.rows import (
    COLUMN_BITS,
    ROW_BITS,
    TILE_HEIGHT,
    TILE_WIDTH,
    fill_rows,
    rows_reach,
)
from torchrender.kernels.raster.project import HALF, SUBPIXEL, key_plane
from torchrender.kernels.raster.records import Buffers, Refusals
from torchrender.kernels.raster.resolve import resolve, resolve_blank
from torchrender.kernels.raster.samples import SAMPLES

BLOCK_COLUMN_BITS, BLOCK_ROW_BITS = 4, 3
BLOCK_COLUMNS = TILE_WIDTH >> BLOCK_COLUMN_BITS
BLOCKS = BLOCK_COLUMNS * (TILE_HEIGHT >> BLOCK_ROW_BITS)
"""Blocks of 16 x 8 pixels whose least keys are known: what is farther than these is not set up."""
REFRESH = 1024  # pixels tried before they are found again
AHEAD = 8  # entries


@kernel(inline=True)
def fetch(entry, scene):
    """Place in the order of the clusters and three snapped corners of a tile entry. Unsigned, as all indices here."""
    corners, places, clipped, owners = scene.corners, scene.places, scene.clipped, scene.owners
    count = np.uintp(places.shape[0])
    n = np.uintp(entry)
    if n < count:
        return np.uintp(places[n]), corners[n, 0], corners[n, 1], corners[n, 2]
    n -= count
    return np.uintp(owners[n]), clipped[n, 0], clipped[n, 1], clipped[n, 2]


@kernel(inline=True)
def look_ahead(scene, entry):
    """What drawing a tile entry reads is on its way; of a clipped one, nothing that is there."""
    foresee(scene.highs, entry)
    foresee(scene.bits, entry)
    foresee(scene.boxes, entry)
    foresee(scene.places, entry)
    foresee(scene.corners, entry)


@kernel(inline=True)
def look_at_place(scene, entry):
    """What a tile entry's place tells is on its way; the place itself has come by now."""
    if entry < np.uintp(scene.places.shape[0]):
        place = np.uintp(scene.places[entry])
        foresee(scene.order, place)
        foresee(scene.listed, place)


@kernel(inline=True)
def find_low(keys, place):
    """Least key of the block whose first pixel is at this place."""
    return least_of(keys, place, 1 << BLOCK_ROW_BITS, TILE_WIDTH)


@kernel(inline=True)
def find_lows(keys, lows):
    """Least key of each block; returns that of all."""
    lowest = np.inf
    for block in range(np.uintp(BLOCKS)):
        place = (block // np.uintp(BLOCK_COLUMNS)) * np.uintp(TILE_WIDTH << BLOCK_ROW_BITS)
        place += (block % np.uintp(BLOCK_COLUMNS)) << np.uintp(BLOCK_COLUMN_BITS)
        low = find_low(keys, place)
        lows[block] = low
        lowest = min(lowest, low)
    return lowest


@kernel(inline=True)
def least_low(lows, first, x0, y0, x1, y1):
    """Of the blocks that a box in the tile meets, whose own begin at ``first``."""
    low = np.inf
    for j in range(y0 >> BLOCK_ROW_BITS, (y1 >> BLOCK_ROW_BITS) + 1):
        for i in range(x0 >> BLOCK_COLUMN_BITS, (x1 >> BLOCK_COLUMN_BITS) + 1):
            low = min(low, lows[np.uintp(first + j * BLOCK_COLUMNS + i)])
    return low


@kernel(inline=True)
def plane_in_tile(place, left, top, scene, frame):
    """The key over the tile's pixels, with its limits."""
    origin_x, origin_y = left - (np.int64(frame.width) >> 1), top - (np.int64(frame.height) >> 1)
    kx, ky, kc, low, high = key_plane(scene.points, scene.listed, place, frame)
    return kx, ky, kc + kx * (origin_x + 0.5) + ky * (origin_y + 0.5), low, high


@kernel(inline=True)
def draw_bits(place, bits, spot, high, scene, frame, earlier, buffers):
    """Draw the pixels that a triangle has in a window of a tile; returns the number of pixels tried.

    ``bits``: of :func:`window_bits` or :func:`~.samples.find_samples`; ``spot``: first column and row of the window in
    the tile, the tile's left and top in the image, and whether the box is SMALL; ``high``: a key that no fragment
    exceeds.
    """
    x0, y0, left, top, small = spot
    keys, ids, first = buffers.keys, buffers.ids, buffers.first
    spot = (x0, y0, first)
    if earlier.ids.shape[0] > 0:
        moved = max(x0 - (TILE_WIDTH - WINDOW), 0)
        spot, bits = (x0 - moved, y0, first), bits << np.uint64(moved)
        if is_hidden(high, spot, bits, keys):
            return 0
        plane = plane_in_tile(place, left, top, scene, frame)
        centre = (left + 0.5 - (np.int64(frame.width) >> 1), top + 0.5 - (np.int64(frame.height) >> 1))
        fill_unseen_window(scene.order[place], plane, spot, bits, centre, earlier, keys, ids)
        return 1
    if bits & ~np.uint64(SAMPLES) == NO_BITS:
        if are_hidden(high, spot, bits, keys):
            return 0
        plane = plane_in_tile(place, left, top, scene, frame)
        fill_samples(scene.order[place], plane, spot, bits, keys, ids)
        return 1
    if is_hidden(high, spot, bits, keys):
        return 0
    plane = plane_in_tile(place, left, top, scene, frame)
    fill_window(scene.order[place], plane, spot, bits, small, keys, ids)
    return 1


@kernel(inline=True)
def draw(place, corners, box, high, scene, frame, tests, buffers):
    """Draw the triangle at a place in the order into a tile; returns the number of pixels tried.

    ``corners``: three snapped positions; ``box``: x0, y0, x1, y1 in the tile and the tile's left and top in the image;
    ``high``: a key that no fragment exceeds.
    """
    a, b, c = corners
    t = np.int64(scene.order[place])
    x0, y0, x1, y1, left, top = box
    keys, ids, first, last = buffers.keys, buffers.ids, buffers.spans[0], buffers.spans[1]
    origin = (left - (np.int64(frame.width) >> 1), top - (np.int64(frame.height) >> 1))
    tested = tests.limits.keys.shape[0] > 0 or tests.earlier.ids.shape[0] > 0
    if tests.holes.mask.shape[0] > 0:
        tested = tested or tests.holes.mask[t] >= 0
    area = doubled_area(a, b, c)
    width, rows = x1 - x0 + 1, y1 - y0 + 1
    if max(width, rows) <= WINDOW and not tested:
        x0, y0 = window_start(x0, y0, x1)
        pixel = ((origin[0] + x0) * SUBPIXEL + HALF, (origin[1] + y0) * SUBPIXEL + HALF)
        bits = window_bits(a, b, c, area, pixel, y1 - y0 + 1)
        if bits == NO_BITS or is_hidden(high, (x0, y0, buffers.first), bits, keys):
            return np.int64(0)
        plane = plane_in_tile(place, left, top, scene, frame)
        fill_window(t, plane, (x0, y0, buffers.first), bits, width * rows <= SMALL, keys, ids)
        return np.int64(1)
    pixel = ((origin[0] + x0) * SUBPIXEL + HALF, (origin[1] + y0) * SUBPIXEL + HALF)
    count = row_ends(corners, area, pixel, (width, rows), first, last)
    if count == 0 or not rows_reach(keys, first, last, (x0, rows, buffers.first + y0 * TILE_WIDTH), high):
        return np.int64(0)
    plane = plane_in_tile(place, left, top, scene, frame)
    if is_identity_alone(t, tests):
        return fill_unseen(t, plane, (x0, y0, y1, left, top), frame, first, last, tests.earlier, buffers)
    if tested:
        return fill_tested(t, plane, (x0, y0, y1, left, top), scene, frame, tests, buffers)
    small = np.int64(width * rows <= SMALL)
    fill_rows(keys, ids, (first, last), (x0, y0, rows, buffers.first, small), plane, np.int32(t))
    return count


@kernel(inline=True)
def is_open(limits, left, top, width, height, closed):
    """False if the peeling limits are ``closed`` or less, which lets nothing through, everywhere in the tile."""
    if limits.shape[0] == 0:
        return True
    for y in range(np.uintp(top), np.uintp(top + height)):
        for x in range(np.uintp(left), np.uintp(left + width)):
            if limits[y, x] > closed:
                return True
    return False


@kernel(inline=True)
def close_pixels(limits, place, closed, keys):
    """Pixels whose limits let nothing in hold what nothing exceeds: what meets only these is not set up.

    Returns the box of the others in the image: x0, y0, x1, y1 inclusive.
    """
    left, top, width, height = place
    x0, y0, x1, y1 = np.int64(width), np.int64(height), np.int64(-1), np.int64(-1)
    for y in range(np.uintp(height)):
        for x in range(np.uintp(width)):
            if limits[np.uintp(top) + y, np.uintp(left) + x] > closed:
                column, row = np.int64(x), np.int64(y)
                x0, y0, x1, y1 = min(x0, column), min(y0, row), max(x1, column), row
            else:
                keys[y * np.uintp(TILE_WIDTH) + x] = np.inf
    return left + x0, top + y0, left + x1, top + y1


@kernel(inline=True)
def render_tile(scene, bins, frame, tests, k, buffers, outputs):
    """Rasterise and resolve tile ``k``."""
    # Counting references in the loops below would cost a fifth of the time: two threads, the same counters.
    scene, tests, buffers, outputs = borrowed(scene), borrowed(tests), borrowed(buffers), borrowed(outputs)
    starts, entries = borrowed(bins.starts), borrowed(bins.entries)
    keys, ids, lows = buffers.keys, buffers.ids, buffers.lows
    bits_of, highs, places, boxes = scene.bits, scene.highs, scene.places, scene.boxes
    width, height, _, far, orthographic = frame
    centre_x, centre_y = width >> 1, height >> 1
    columns = (width + TILE_WIDTH - 1) >> COLUMN_BITS
    left, top = (k % columns) << COLUMN_BITS, (k // columns) << ROW_BITS
    tile_width, tile_height = min(TILE_WIDTH, width - left), min(TILE_HEIGHT, height - top)
    empty = np.nextafter(-far if orthographic else 1.0 / far, -np.inf)
    closed = empty if orthographic else max(empty, 0.0)
    area = (left, top, tile_width, tile_height)
    first, end = starts[k], starts[k + 1]
    by_bits = tests.limits.keys.shape[0] == 0 and only_identity(tests.earlier)
    if first == end or not is_open(tests.limits.keys, left, top, tile_width, tile_height, closed):
        resolve_blank(area, keys, outputs)
        return
    for y in range(TILE_HEIGHT):
        for x in range(TILE_WIDTH):
            keys[y * TILE_WIDTH + x] = empty if x < tile_width and y < tile_height else np.inf
            ids[y * TILE_WIDTH + x] = -1
    for block in range(BLOCKS):
        lows[block] = -np.inf
    lowest = -np.inf
    bounds = (left, top, left + tile_width - 1, top + tile_height - 1)
    if tests.limits.keys.shape[0] > 0:
        bounds = close_pixels(tests.limits.keys, area, closed, keys)
        lowest = find_lows(keys, lows)
    tried = 0
    for n in range(first, end):
        entry = np.uintp(entries[np.uintp(n)])
        look_ahead(scene, np.uintp(entries[np.uintp(min(n + AHEAD, end - 1))]))
        look_at_place(scene, np.uintp(entries[np.uintp(min(n + AHEAD // 2, end - 1))]))
        high = np.inf
        if entry < np.uintp(places.shape[0]):
            high = highs[entry]
            if high < lowest:
                continue
            bits = bits_of[entry]
            if bits != NO_BITS and by_bits:
                x0, y0 = np.int64(boxes[entry, 0]) - left, np.int64(boxes[entry, 1]) - top
                place = np.uintp(places[entry])
                tried += draw_bits(place, bits, (x0, y0, left, top, True), high, scene, frame, tests.earlier, buffers)
                if tried > REFRESH:
                    lowest = find_lows(keys, lows)
                    tried = 0
                continue
        place, a, b, c = fetch(entry, scene)
        x0, y0, x1, y1 = pixel_box(a, b, c, bounds, centre_x, centre_y)
        if x0 > x1 or y0 > y1:
            continue
        box = (x0 - left, y0 - top, x1 - left, y1 - top, left, top)
        if high < least_low(lows, 0, box[0], box[1], box[2], box[3]):
            continue
        tried += draw(place, (a, b, c), box, high, scene, frame, tests, buffers)
        if tried > REFRESH:
            lowest = find_lows(keys, lows)
            tried = 0
    resolve(scene, frame, area, buffers, outputs)


@kernel(parallel=True)
def render_tiles(scene, bins, frame, limits, earlier, holes, buffers, outputs):
    """Rasterise and resolve every tile; see ``records``.

    The tests come one by one because a parallel loop takes no records within records.
    """
    order, counter = bins.order, bins.turn
    first, keys, ids, lows, spans_of, known, planes = buffers
    for thread in prange(keys.shape[0]):
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= order.shape[0]:
                break
            own = Buffers(
                first, keys[thread], ids[thread], lows[thread], spans_of[thread], known[thread], planes[thread]
            )
            render_tile(scene, bins, frame, Refusals(limits, earlier, holes), order[turn], own, outputs)
