"""The rasteriser's main loop: one tile at a time, triangles nearly front to back.

Depth and barycentrics come from the unsnapped plane, so snapping never moves a depth."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.binning import HALF, pixel_box
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
from torchrender.kernels.raster.records import Buffers, Refusals
from torchrender.kernels.raster.resolve import resolve

SMALL = 24  # boxes of at most this many pixels are tested pixel by pixel


@kernel(inline=True)
def fetch(entry, scene):
    """Triangle id and three snapped corners of a tile entry."""
    packed, faces, clipped, owners = scene.packed, scene.faces, scene.corners, scene.owners
    count = faces.shape[0]
    if entry < count:
        t = np.int64(entry)
        return t, packed[faces[t, 0], 3], packed[faces[t, 1], 3], packed[faces[t, 2], 3]
    m = np.int64(entry) - count
    return np.int64(owners[m]), clipped[m, 0], clipped[m, 1], clipped[m, 2]


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
def draw(t, corners, box, scene, frame, tests, buffers):
    """Draw one triangle into a tile; returns the number of pixels tried.

    ``corners``: three snapped positions; ``box``: x0, y0, x1, y1 in the tile and the tile's left and top in the image.
    """
    a, b, c = corners
    x0, y0, x1, y1, left, top = box
    keys, ids, spare, _, _ = buffers
    first, last = spare[0], spare[1]
    origin = (left - (np.int64(frame.width) >> 1), top - (np.int64(frame.height) >> 1))
    tested = tests.limits.keys.shape[0] > 0 or tests.earlier.ids.shape[0] > 0
    if tests.holes.mask.shape[0] > 0:
        tested = tested or tests.holes.mask[t] >= 0
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
    kx, ky, kc, low, high = key_plane(scene.points, scene.faces, t, frame)
    plane = (kx, ky, kc + kx * (origin[0] + 0.5) + ky * (origin[1] + 0.5), low, high)
    if small:
        fill_small(t, plane, (x0, y0, x1, y1), bits, keys, ids)
        return 1
    if tested:
        return fill_tested(t, plane, (x0, y0, y1, left, top), scene, frame, tests, buffers)
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


@kernel()
def render_tile(scene, bins, frame, tests, k, buffers, outputs):
    """Rasterise and resolve tile ``k``."""
    # Counting references in the loops below would cost a fifth of the time: two threads, the same counters.
    scene, tests, buffers, outputs = borrowed(scene), borrowed(tests), borrowed(buffers), borrowed(outputs)
    points, faces = scene.points, scene.faces
    starts, entries = borrowed(bins.starts), borrowed(bins.entries)
    keys, ids = buffers.keys, buffers.ids
    width, height, _, far, orthographic = frame
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
    if not is_open(tests.limits.keys, left, top, tile_width, tile_height, empty):
        end = first
    for n in range(first, end):
        t, a, b, c = fetch(entries[n], scene)
        if points[faces[t, 0], 2] > limit and points[faces[t, 1], 2] > limit and points[faces[t, 2], 2] > limit:
            continue
        bounds = (left, top, left + tile_width - 1, top + tile_height - 1)
        x0, y0, x1, y1 = pixel_box(a, b, c, bounds, centre_x, centre_y)
        if x0 > x1 or y0 > y1:
            continue
        box = (x0 - left, y0 - top, x1 - left, y1 - top, left, top)
        tried += draw(t, (a, b, c), box, scene, frame, tests, buffers)
        if tried > TILE_WIDTH * TILE_HEIGHT:
            limit = farthest_depth(keys, orthographic)
            tried = 0
    resolve(scene, frame, (left, top, tile_width, tile_height), buffers, outputs)


@kernel(parallel=True)
def render_tiles(scene, bins, frame, limits, earlier, holes, buffers, outputs):
    """Rasterise and resolve every tile; see ``records``.

    The tests come one by one because a parallel loop takes no records within records.
    """
    order, counter = bins.order, bins.turn
    keys, ids, spans_of, known, planes = buffers
    for thread in prange(keys.shape[0]):
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= order.shape[0]:
                break
            own = Buffers(keys[thread], ids[thread], spans_of[thread], known[thread], planes[thread])
            render_tile(scene, bins, frame, Refusals(limits, earlier, holes), order[turn], own, outputs)
