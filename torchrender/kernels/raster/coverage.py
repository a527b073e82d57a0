"""Which pixels a triangle covers, and the depth test there: exact integer edges, float64 depth.

Edge functions on snapped positions with a tie rule give a pixel centre on a shared edge or vertex to exactly one
triangle. Tiles are flat arrays of TILE_WIDTH x TILE_HEIGHT pixels."""

from __future__ import annotations

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.fragments import has_surface, has_triangle, is_hole, only_identity
from torchrender.kernels.raster.lanes.pixels import covered_window, keep_nearest, reaches, unseen_lanes
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH, find_rows
from torchrender.kernels.raster.lanes.vectors import LANES
from torchrender.kernels.raster.project import SUBPIXEL, barycentric_planes, snapped_x, snapped_y
from torchrender.kernels.raster.samples import SAMPLES

WINDOW = LANES  # boxes of at most so many columns and rows are tested as a whole
SMALL = 24
"""Boxes of at most this many pixels count columns from the start of their rows, larger ones from that of the tile. The
keys round differently, which decides between coplanar triangles."""
NO_BITS, ROW = np.uint64(0), np.uint64((1 << WINDOW) - 1)


@kernel(inline=True)
def edge(a, b, sign, px, py):
    """Edge a-b at a snapped point, its steps per pixel in x and y, and the tie rule folded into the value."""
    ax, ay = snapped_x(a), snapped_y(a)
    dx = (snapped_x(b) - ax) * sign
    dy = (snapped_y(b) - ay) * sign
    owns = dy > 0 or (dy == 0 and dx < 0)
    value = dx * (py - ay) - dy * (px - ax) - (0 if owns else 1)
    return value, -dy * SUBPIXEL, dx * SUBPIXEL


@kernel(inline=True)
def misses(value, step_x, step_y, width, rows):
    """True if an edge has every pixel of a box on its outer side; it is given at the first pixel."""
    return value + max(step_x * (width - 1), 0) + max(step_y * (rows - 1), 0) < 0


@kernel(inline=True)
def row_ends(corners, area, pixel, size, first, last):
    """Number of pixels of a box that a triangle covers, and where it is not zero, the spans of them in each row.

    ``pixel``: the first one's centre, snapped; ``size``: columns and rows. The spans are those of
    :func:`~.lanes.rows.find_rows`.
    """
    a, b, c = corners
    px, py = pixel
    width, rows = size
    sign = 1 if area > 0 else -1
    e0, dx0, dy0 = edge(a, b, sign, px, py)
    e1, dx1, dy1 = edge(b, c, sign, px, py)
    e2, dx2, dy2 = edge(c, a, sign, px, py)
    if misses(e0, dx0, dy0, width, rows) or misses(e1, dx1, dy1, width, rows) or misses(e2, dx2, dy2, width, rows):
        return np.int64(0)
    return find_rows(first, last, (e0, e1, e2, dx0, dx1, dx2, dy0, dy1, dy2), rows, width)


@kernel(inline=True)
def window_start(x, y, last):
    """The first pixel moved so that a window from there stays within its tile.

    Where that leaves the ``last`` column in it, to one that is a multiple of half a window: what one triangle stores,
    the next one loads in the same parts, which processors hand over at once.
    """
    column, row = x & (TILE_WIDTH - 1), y & (TILE_HEIGHT - 1)
    even = x & -(WINDOW // 2)
    x, column = (even, column & -(WINDOW // 2)) if last - even < WINDOW else (x, column)
    return x - max(column - (TILE_WIDTH - WINDOW), 0), y - max(row - (TILE_HEIGHT - WINDOW), 0)


@kernel(inline=True)
def move_bits(bits, x):
    """Bits of a window of few columns from ``x`` on as those of one that :func:`window_start` allows, and its start.

    In the first two columns and rows, which are drawn one by one, they stay.
    """
    column = x & (TILE_WIDTH - 1)
    moved = 0 if bits & ~np.uint64(SAMPLES) == NO_BITS else column - min(column & -(WINDOW // 2), TILE_WIDTH - WINDOW)
    return bits << np.uint64(moved), x - moved


@kernel(inline=True)
def window_bits(a, b, c, area, pixel, rows):
    """One bit for each covered pixel of a window of WINDOW x WINDOW: bit ``WINDOW y + x``.

    ``pixel``: the first one's centre, snapped; ``rows``: of the window, in which all of the triangle lies. At least
    half of the window is tested, wherever the triangle ends: mispredicted branches would cost more.
    """
    sign = 1 if area > 0 else -1
    px, py = pixel
    e0, dx0, dy0 = edge(a, b, sign, px, py)
    e1, dx1, dy1 = edge(b, c, sign, px, py)
    e2, dx2, dy2 = edge(c, a, sign, px, py)
    return covered_window((e0, e1, e2, dx0, dx1, dx2, dy0, dy1, dy2), rows > WINDOW // 2)


@kernel(inline=True)
def is_hidden(high, spot, bits, keys):
    """True if every pixel of :func:`window_bits` holds something nearer than the key ``high``.

    ``spot``: as of :func:`fill_window`.
    """
    x0, y0, first = spot
    place = np.uintp(first + y0 * TILE_WIDTH + x0)
    while bits != NO_BITS:
        if reaches(keys, place, bits & ROW, high):
            return False
        bits >>= np.uint64(WINDOW)
        place += np.uintp(TILE_WIDTH)
    return True


@kernel(inline=True)
def fill_window(t, plane, spot, bits, small, keys, ids):
    """Keep the triangle where it is nearer, at the pixels of :func:`window_bits`; ``small``: see :data:`SMALL`.

    ``spot``: first column and row of the window in its tile, and where the tile's pixels begin.
    """
    x0, y0, first = spot
    kx, ky, kc, low, high = plane
    y, owner = y0, np.int32(t)
    while bits != NO_BITS:
        row = y * TILE_WIDTH
        start = 0 if small else row
        base = kc + ky * y - kx * start
        keep_nearest(
            keys, ids, np.uintp(first + row + x0), bits & ROW, (base, kx, np.float64(start + x0), low, high), owner
        )
        bits >>= np.uint64(WINDOW)
        y += 1


@kernel(inline=True)
def are_hidden(high, spot, bits, keys):
    """As :func:`is_hidden`, for a few pixels, which need not lie in one window of the tile."""
    x0, y0, first = spot
    place = np.uintp(first + y0 * TILE_WIDTH + x0)
    hidden = True
    while bits != NO_BITS:
        k = np.uintp(trailing_zeros(bits))
        bits &= bits - np.uint64(1)
        hidden &= high < keys[place + (k & np.uintp(WINDOW - 1)) + (k // np.uintp(WINDOW)) * np.uintp(TILE_WIDTH)]
    return hidden


@kernel(inline=True)
def fill_samples(t, plane, spot, bits, keys, ids):
    """As :func:`fill_window` of a small box, one pixel after the other."""
    x0, y0, first = spot
    kx, ky, kc, low, high = plane
    owner = np.int32(t)
    while bits != NO_BITS:
        k = np.int64(trailing_zeros(bits))
        bits &= bits - np.uint64(1)
        x, y = x0 + (k & (WINDOW - 1)), y0 + k // WINDOW
        key = kc + ky * np.float64(y) + kx * np.float64(x)
        key = key if key > low else low
        key = key if key < high else high
        at = np.uintp(first + y * TILE_WIDTH + x)
        if key > keys[at] or (key == keys[at] and owner < ids[at]):
            keys[at] = key
            ids[at] = owner


@kernel(inline=True)
def lanes_start(begin, end):
    """First of the LANES pixels by which a row's span is drawn: one step of them where it fits between half steps."""
    even = min(begin & -(LANES // 2), TILE_WIDTH - LANES)
    return even if end - even < LANES else begin & -LANES


@kernel(inline=True)
def fill_unseen(t, plane, box, frame, first, last, earlier, buffers):
    """Rows of fragments whose triangle no earlier image has there: pixel redundancy and no other test.

    ``box`` = x0, y0, y1 in the tile, tile left, tile top in the image.
    """
    kx, ky, kc, low, high = plane
    x0, y0, y1, left, top = box
    keys, ids, owner = buffers.keys, buffers.ids, np.int32(t)
    seen = (earlier.ids, earlier.pixels, earlier.near)
    shift_x = left + 0.5 - (np.int64(frame.width) >> 1)
    shift_y = top + 0.5 - (np.int64(frame.height) >> 1)
    count = 0
    for y in range(y0, y1 + 1):
        begin, end = x0 + first[y - y0], x0 + last[y - y0]
        if begin > end:
            continue
        count += end - begin + 1
        base = kc + ky * y
        start = lanes_start(begin, end)
        for x in range(start, end + 1, LANES):
            place = np.uintp(buffers.first + y * TILE_WIDTH + x)
            mask = ROW << np.uint64(max(begin - x, 0)) & ROW >> np.uint64(max(x + LANES - 1 - end, 0))
            row, spot = (base, kx, np.float64(x), low, high), (np.float64(x) + shift_x, np.float64(y) + shift_y)
            new = unseen_lanes(keys, ids, place, mask, row + spot, owner, seen)
            if new != NO_BITS:
                keep_nearest(keys, ids, place, new, row, owner)
    return count


@kernel(inline=True)
def fill_unseen_window(t, plane, spot, bits, centre, earlier, keys, ids):
    """As :func:`fill_window` of a small box, but only what :func:`fill_unseen` keeps.

    ``centre``: that of the tile's first pixel, from the image centre.
    """
    kx, ky, kc, low, high = plane
    x0, y0, first = spot
    seen, owner = (earlier.ids, earlier.pixels, earlier.near), np.int32(t)
    column, y = np.float64(x0), y0
    while bits != NO_BITS:
        place = np.uintp(first + y * TILE_WIDTH + x0)
        row = (kc + ky * y, kx, column, low, high)
        at = (column + centre[0], np.float64(y) + centre[1])
        new = unseen_lanes(keys, ids, place, bits & ROW, row + at, owner, seen)
        if new != NO_BITS:
            keep_nearest(keys, ids, place, new, row, owner)
        bits >>= np.uint64(WINDOW)
        y += 1


@kernel()
def fill_tested(t, plane, spot, scene, frame, tests, buffers):
    """As :func:`~.lanes.rows.fill_rows`, but a fragment that would win must also pass the tests.

    ``spot`` = (x0, y0, y1 in the tile, tile left, tile top in the image).
    """
    scene, tests, buffers = borrowed(scene), borrowed(tests), borrowed(buffers)
    kx, ky, kc, low, high = plane
    x0, y0, y1, left, top = spot
    keys, ids, first, last = buffers.keys, buffers.ids, buffers.spans[0], buffers.spans[1]
    faces, orthographic = scene.faces, frame.orthographic
    limits, earlier, holes = tests
    known, pixels, near = earlier.ids, earlier.pixels, earlier.near
    limited, compared = limits.keys.shape[0] > 0, known.shape[0] > 0
    plain = compared and only_identity(earlier)
    holed = holes.mask.shape[0] > 0 and holes.mask[t] >= 0
    shift_x = left + 0.5 - (np.int64(frame.width) >> 1)
    shift_y = top + 0.5 - (np.int64(frame.height) >> 1)
    ux, uy, uc, vx, vy, vc = barycentric_planes(scene.points, faces, t, orthographic)
    count = 0
    for y in range(y0, y1 + 1):
        begin, end = first[y - y0], last[y - y0]
        if begin > end:
            continue
        count += end - begin + 1
        base = kc + ky * y
        py = y + shift_y
        for x in range(np.uintp(x0 + begin), np.uintp(x0 + end + 1)):
            key = min(max(base + kx * np.float64(x), low), high)
            place = np.uintp(buffers.first + y * TILE_WIDTH) + x
            here = keys[place]
            if key < here or (key == here and t > ids[place]):
                continue
            if limited:
                row, column = np.uintp(top + y), np.uintp(left) + x
                if not key < limits.keys[row, column] or limits.ids[row, column] == t:
                    continue
            px = np.float64(x) + shift_x
            if holed:
                weight = 1.0 if orthographic else 1.0 / key
                if is_hole(t, (ux * px + uy * py + uc) * weight, (vx * px + vy * py + vc) * weight, faces, holes):
                    continue
            if plain:
                if has_triangle(t, px, py, key, known, pixels, near):
                    continue
            elif compared and has_surface(t, px, py, key, (kx, ky), earlier):
                continue
            keys[place] = key
            ids[place] = t
    return count
