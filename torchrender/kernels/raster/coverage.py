"""Which pixels a triangle covers, and the depth test there: exact integer edges, float64 depth.

Edge functions on snapped positions with a tie rule give a pixel centre on a shared edge or vertex to exactly one
triangle. Tiles are flat arrays of TILE_WIDTH x TILE_HEIGHT pixels."""

from __future__ import annotations

import math

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.fragments import has_surface, has_triangle, is_hole, only_identity
from torchrender.kernels.raster.planes import barycentric_planes
from torchrender.kernels.raster.project import SUBPIXEL, snapped_x, snapped_y

HAIR = 1e-6  # pixels by which a span's ends are guessed too wide before the exact test
COLUMN_BITS, ROW_BITS = 6, 5
TILE_WIDTH, TILE_HEIGHT = 1 << COLUMN_BITS, 1 << ROW_BITS
SMALL = 24  # boxes of at most this many pixels are tested pixel by pixel
TINY = 4  # boxes of at most so many columns and rows are tested when triangles are listed


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
def spans(value, step_x, step_y, rows, width, first, last):
    """Narrow ``first[y]..last[y]`` (inclusive) to the pixels where ``value + step_x x + step_y y >= 0``; exact.

    The division only guesses, a hair too wide; one exact integer test decides. Counters are unsigned because signed
    ones bring numba's test for negative indices into the loop, which then does not vectorise.
    """
    if step_x == 0:
        for y in range(np.uintp(rows)):
            last[y] = last[y] if value + step_y * np.int64(y) >= 0 else -1
        return
    inverse = -1.0 / float(step_x)
    limit = float(width)
    if step_x > 0:
        for y in range(np.uintp(rows)):
            e = value + step_y * np.int64(y)
            guess = float(e) * inverse
            guess = 0.0 if guess < 0.0 else guess
            guess = limit if guess > limit else guess
            x = np.int64(math.ceil(guess - HAIR))
            x += np.int64(e + step_x * x < 0)
            first[y] = max(first[y], x)
    else:
        for y in range(np.uintp(rows)):
            e = value + step_y * np.int64(y)
            guess = float(e) * inverse
            guess = -1.0 if guess < -1.0 else guess
            guess = limit if guess > limit else guess
            x = np.int64(math.floor(guess + HAIR))
            x -= np.int64(e + step_x * x < 0)
            last[y] = min(last[y], x)


@kernel(inline=True)
def covered_bits(edges, width, rows):
    """One bit for each covered pixel of a small box, rows of ``width`` bits; edges are given at its first pixel."""
    e0, dx0, dy0, e1, dx1, dy1, e2, dx2, dy2 = edges
    bits = np.int64(0)
    place = np.int64(0)
    for _ in range(rows):
        f0, f1, f2 = e0, e1, e2
        for _ in range(width):
            bits |= np.int64((f0 | f1 | f2) >= 0) << place
            place += 1
            f0 += dx0
            f1 += dx1
            f2 += dx2
        e0 += dy0
        e1 += dy1
        e2 += dy2
    return bits


@kernel(inline=True)
def small_bits(a, b, c, area, pixel, width, rows):
    """:func:`covered_bits` of a triangle of snapped corners; ``pixel``: the first one's centre, snapped."""
    sign = 1 if area > 0 else -1
    px, py = pixel
    e0, dx0, dy0 = edge(a, b, sign, px, py)
    e1, dx1, dy1 = edge(b, c, sign, px, py)
    e2, dx2, dy2 = edge(c, a, sign, px, py)
    return covered_bits((e0, dx0, dy0, e1, dx1, dy1, e2, dx2, dy2), width, rows)


@kernel(inline=True)
def tiny_bits(a, b, c, area, pixel, width, rows):
    """One bit for each covered pixel of a box of at most TINY x TINY: bit ``TINY y + x``.

    Without loops of varying length: mispredicted branches would cost more than the pixels outside.
    """
    sign = 1 if area > 0 else -1
    px, py = pixel
    e0, dx0, dy0 = edge(a, b, sign, px, py)
    e1, dx1, dy1 = edge(b, c, sign, px, py)
    e2, dx2, dy2 = edge(c, a, sign, px, py)
    f0, f1, f2 = e0 + dx0, e1 + dx1, e2 + dx2
    bits = np.int64((e0 | e1 | e2) >= 0) | np.int64((f0 | f1 | f2) >= 0) << 1
    bits |= np.int64((e0 + dy0 | e1 + dy1 | e2 + dy2) >= 0) << 4
    bits |= np.int64((f0 + dy0 | f1 + dy1 | f2 + dy2) >= 0) << 5
    if max(width, rows) > 2:
        bits = np.int64(0)
        for y in range(4):
            for x in range(4):
                f0, f1, f2 = e0 + dx0 * x + dy0 * y, e1 + dx1 * x + dy1 * y, e2 + dx2 * x + dy2 * y
                bits |= np.int64((f0 | f1 | f2) >= 0) << (4 * y + x)
    # The box may be cut by the image, beyond which the triangle goes on.
    return bits & (np.int64(0x1111) * ((1 << width) - 1)) & ((1 << (4 * rows)) - 1)


@kernel(inline=True)
def is_hidden(high, x0, y0, bits, keys):
    """True if every pixel of :func:`tiny_bits` holds something nearer than the key ``high``."""
    first = np.uintp(y0 * TILE_WIDTH + x0)
    while bits != 0:
        place = np.uintp(trailing_zeros(bits))
        if keys[first + (place >> np.uintp(2)) * np.uintp(TILE_WIDTH) + (place & np.uintp(3))] <= high:
            return False
        bits &= bits - 1
    return True


@kernel(inline=True)
def fill_tiny(t, plane, x0, y0, bits, keys, ids):
    """Keep the triangle where it is nearer, at the pixels of :func:`tiny_bits`."""
    kx, ky, kc, low, high = plane
    while bits != 0:
        place = np.int64(trailing_zeros(bits))
        x, y = x0 + (place & 3), y0 + (place >> 2)
        base = kc + ky * y
        key = min(max(base + kx * x, low), high)
        spot = np.uintp(y * TILE_WIDTH + x)
        here = keys[spot]
        if key > here or (key == here and t < ids[spot]):
            keys[spot] = key
            ids[spot] = t
        bits &= bits - 1


@kernel(inline=True)
def fill(t, plane, box, first, last, keys, ids):
    """Keep the triangle where it is nearer, in the spans of its rows."""
    kx, ky, kc, low, high = plane
    x0, y0, y1 = box
    owner = np.int32(t)
    count = 0
    for y in range(y1 - y0 + 1):
        begin, end = first[y], last[y]
        if begin > end:
            continue
        count += end - begin + 1
        base = kc + ky * (y0 + y)
        row = (y0 + y) * TILE_WIDTH
        base -= kx * row
        for x in range(np.uintp(row + x0 + begin), np.uintp(row + x0 + end + 1)):
            key = min(max(base + kx * np.float64(x), low), high)
            here = keys[x]
            nearer = (key > here) | ((key == here) & (owner < ids[x]))
            keys[x] = key if nearer else here
            ids[x] = owner if nearer else ids[x]
    return count


@kernel(inline=True)
def fill_small(t, plane, box, bits, keys, ids):
    """Keep the triangle where it is nearer, at the set bits of a small box x0, y0, x1, y1 in the tile."""
    kx, ky, kc, low, high = plane
    x0, y0, x1, y1 = box
    for y in range(y0, y1 + 1):
        base = kc + ky * y
        for x in range(x0, x1 + 1):
            if bits & 1:
                key = min(max(base + kx * x, low), high)
                place = np.uintp(y * TILE_WIDTH + x)
                here = keys[place]
                if key > here or (key == here and t < ids[place]):
                    keys[place] = key
                    ids[place] = t
            bits >>= 1


@kernel()
def fill_tested(t, plane, spot, scene, frame, tests, buffers):
    """As :func:`fill`, but a fragment that would win must also pass the tests.

    ``spot`` = (x0, y0, y1 in the tile, tile left, tile top in the image).
    """
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
            place = np.uintp(y * TILE_WIDTH) + x
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
