"""The rasteriser's main loop: one tile at a time, triangles nearly front to back.

Depth and barycentrics come from the unsnapped plane, so snapping never moves a depth."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.coverage import (
    TILE_HEIGHT,
    TILE_WIDTH,
    covered_bits,
    edge,
    fill,
    fill_small,
    fill_tested,
    spans,
)
from torchrender.kernels.raster.planes import key_plane
from torchrender.kernels.raster.project import SUBPIXEL, snapped_x, snapped_y
from torchrender.kernels.raster.resolve import resolve

HALF = SUBPIXEL >> 1
SMALL = 24  # boxes of at most this many pixels are tested pixel by pixel


@kernel(inline=True)
def fetch(entry, packed, faces, clipped, owners):
    """Triangle id and three snapped corners of a tile entry."""
    count = faces.shape[0]
    if entry < count:
        t = np.int64(entry)
        return t, packed[faces[t, 0], 3], packed[faces[t, 1], 3], packed[faces[t, 2], 3]
    m = np.int64(entry) - count
    return np.int64(owners[m]), clipped[m, 0], clipped[m, 1], clipped[m, 2]


@kernel(inline=True)
def tile_corner_box(a, b, c, bounds, half_w, half_h):
    """Pixels of the tile ``bounds`` (x0,y0,x1,y1 inclusive) inside the bounding box of three snapped corners."""
    ax, bx, cx = snapped_x(a), snapped_x(b), snapped_x(c)
    ay, by, cy = snapped_y(a), snapped_y(b), snapped_y(c)
    x0 = ((min(ax, min(bx, cx)) - HALF + SUBPIXEL - 1) // SUBPIXEL) + half_w
    y0 = ((min(ay, min(by, cy)) - HALF + SUBPIXEL - 1) // SUBPIXEL) + half_h
    x1 = ((max(ax, max(bx, cx)) - HALF) // SUBPIXEL) + half_w
    y1 = ((max(ay, max(by, cy)) - HALF) // SUBPIXEL) + half_h
    return max(x0, bounds[0]), max(y0, bounds[1]), min(x1, bounds[2]), min(y1, bounds[3])


@kernel(inline=True)
def farthest_depth(keys, orthographic):
    """Camera depth beyond which nothing in this tile can be seen any more."""
    a = b = c = d = np.inf
    for x in range(0, keys.shape[0], 4):
        i = np.uintp(x)
        a = min(a, keys[i])
        b = min(b, keys[i + np.uintp(1)])
        c = min(c, keys[i + np.uintp(2)])
        d = min(d, keys[i + np.uintp(3)])
    low = min(min(a, b), min(c, d))
    if orthographic:
        return -low
    return 1.0 / low if low > 0.0 else np.inf


@kernel(inline=True)
def draw(t, corners, box, scene, view, tests, buffers):
    """Draw one triangle into a tile; returns the number of pixels tried.

    ``corners``: three snapped positions; ``box``: x0, y0, x1, y1 in the tile and the tile's left and top in the image.
    """
    a, b, c = corners
    x0, y0, x1, y1, left, top = box
    keys, ids, spare = buffers[:3]
    first, last = spare[0], spare[1]
    origin = (left - (np.int64(view[0]) >> 1), top - (np.int64(view[1]) >> 1))
    tested = tests[0][0].shape[0] > 0 or tests[1][0].shape[0] > 0
    if tests[2][0].shape[0] > 0:
        tested = tested or tests[2][0][t] >= 0
    px = (origin[0] + x0) * SUBPIXEL + HALF
    py = (origin[1] + y0) * SUBPIXEL + HALF
    ax, ay = snapped_x(a), snapped_y(a)
    area = (snapped_x(b) - ax) * (snapped_y(c) - ay) - (snapped_y(b) - ay) * (snapped_x(c) - ax)
    sign = 1 if area > 0 else -1
    e0, dx0, dy0 = edge(a, b, sign, px, py)
    e1, dx1, dy1 = edge(b, c, sign, px, py)
    e2, dx2, dy2 = edge(c, a, sign, px, py)
    width, rows = x1 - x0 + 1, y1 - y0 + 1
    small = width * rows <= SMALL and not tested
    bits = np.int64(0)
    if small:
        bits = covered_bits((e0, dx0, dy0, e1, dx1, dy1, e2, dx2, dy2), width, rows)
        if bits == 0:
            return 0
    else:
        for y in range(np.uintp(rows)):
            first[y] = 0
            last[y] = width - 1
        spans(e0, dx0, dy0, rows, width, first, last)
        spans(e1, dx1, dy1, rows, width, first, last)
        spans(e2, dx2, dy2, rows, width, first, last)
    kx, ky, kc, low, high = key_plane(scene[0], scene[2], t, view)
    plane = (kx, ky, kc + kx * (origin[0] + 0.5) + ky * (origin[1] + 0.5), low, high)
    if small:
        fill_small(t, plane, (x0, y0, x1, y1), bits, keys, ids)
        return 1
    if tested:
        return fill_tested(t, plane, (x0, y0, y1, left, top), (first, last), scene, view, tests, keys, ids)
    return fill(t, plane, (x0, y0, y1), first, last, keys, ids)


@kernel(inline=True)
def is_open(limits, left, top, width, height, empty):
    """False if the peeling limits let nothing through anywhere in the tile."""
    if limits.shape[0] == 0:
        return True
    for y in range(np.uintp(top), np.uintp(top + height)):
        for x in range(np.uintp(left), np.uintp(left + width)):
            if limits[y, x] > empty:
                return True
    return False


@kernel(inline=True)
def borrowed_tests(tests):
    (limit_keys, limit_ids), (ids, pixels, near, depth, planes, settings), (mask, table, texels, uv) = tests
    earlier = (borrowed(ids), borrowed(pixels), borrowed(near), borrowed(depth), borrowed(planes), borrowed(settings))
    holes = (borrowed(mask), borrowed(table), borrowed(texels), borrowed(uv))
    return (borrowed(limit_keys), borrowed(limit_ids)), earlier, holes


@kernel(inline=True)
def borrowed_five(arrays):
    a, b, c, d, e = arrays
    return borrowed(a), borrowed(b), borrowed(c), borrowed(d), borrowed(e)


@kernel()
def render_tile(scene, bins, view, tests, k, buffers, outputs):
    """Rasterise and resolve tile ``k``."""
    # Counting references in the loops below would cost a fifth of the time: two threads, the same counters.
    points, packed, faces = borrowed(scene[0]), borrowed(scene[1]), borrowed(scene[2])
    objects, corners, owners = borrowed(scene[3]), borrowed(scene[4]), borrowed(scene[5])
    scene = (points, packed, faces, objects, corners, owners)
    starts, entries, view = borrowed(bins[1]), borrowed(bins[2]), borrowed(view)
    tests = borrowed_tests(tests)
    buffers = borrowed_five(buffers)
    keys, ids = buffers[0], buffers[1]
    outputs = (borrowed(outputs[0]), borrowed(outputs[1]), borrowed(outputs[2]), borrowed(outputs[3]))
    width, height = int(view[0]), int(view[1])
    far, orthographic = view[3], view[4] != 0.0
    centre_x, centre_y = width >> 1, height >> 1
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    left, top = (k % columns) * TILE_WIDTH, (k // columns) * TILE_HEIGHT
    tile_width, tile_height = min(TILE_WIDTH, width - left), min(TILE_HEIGHT, height - top)
    empty = np.nextafter(-far if orthographic else 1.0 / far, -np.inf)
    for y in range(TILE_HEIGHT):
        for x in range(TILE_WIDTH):
            keys[y * TILE_WIDTH + x] = empty if x < tile_width and y < tile_height else np.inf
            ids[y * TILE_WIDTH + x] = -1
    limit = np.inf
    tried = 0
    first, end = starts[k], starts[k + 1]
    if not is_open(tests[0][0], left, top, tile_width, tile_height, empty):
        end = first
    for n in range(first, end):
        t, a, b, c = fetch(entries[n], packed, faces, corners, owners)
        if points[faces[t, 0], 2] > limit and points[faces[t, 1], 2] > limit and points[faces[t, 2], 2] > limit:
            continue
        bounds = (left, top, left + tile_width - 1, top + tile_height - 1)
        x0, y0, x1, y1 = tile_corner_box(a, b, c, bounds, centre_x, centre_y)
        if x0 > x1 or y0 > y1:
            continue
        box = (x0 - left, y0 - top, x1 - left, y1 - top, left, top)
        tried += draw(t, (a, b, c), box, scene, view, tests, buffers)
        if tried > TILE_WIDTH * TILE_HEIGHT:
            limit = farthest_depth(keys, orthographic)
            tried = 0
    place = (left, top, tile_width, tile_height, centre_x, centre_y)
    resolve(scene, view, place, keys, ids, buffers[3:], outputs)


@kernel(parallel=True)
def render_tiles(scene, bins, view, limits, earlier, holes, scratch, outputs):
    """Rasterise and resolve every tile.

    ``scene`` = (points, packed, faces, objects, clipped corners, their owners), ``bins`` = (order, starts, entries);
    ``limits``, ``earlier``, ``holes``: see ``fragments``; ``scratch`` = (keys, ids, spans, cached
    triangles, their planes, counter), a row per thread.
    """
    order = bins[0]
    keys, ids, spare, known, planes, counter = scratch
    for thread in prange(keys.shape[0]):
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= order.shape[0]:
                break
            buffers = (keys[thread], ids[thread], spare[thread], known[thread], planes[thread])
            render_tile(scene, bins, view, (limits, earlier, holes), order[turn], buffers, outputs)
