"""Single pixels within a surface that its samples missed, closed from their neighbours."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel

DOWN, RIGHT = (-1, 0, -1, -1), (0, -1, -1, 1)
"""Steps to one end of the four lines through a pixel; the other end lies opposite."""

MANY = 16
"""Where more than one of so many pixels of a row may be closed, all are looked at together."""


@kernel()
def look_around(y, x, depth, valid, limits):
    """Mean inverse depth of the lines through a pixel that lie on one surface, their number, and their bits.

    ``limits``: relative difference of the depths of both ends, and of the inverse depths of the lines; where these
    differ by more, the number is 0.
    """
    smooth, agree = limits
    low, high, total, count, lines = np.inf, -np.inf, 0.0, 0, 0
    for k in range(4):
        j, i, m, n = y + DOWN[k], x + RIGHT[k], y - DOWN[k], x - RIGHT[k]
        if valid[j, i] and valid[m, n]:
            near, far = np.float64(depth[j, i]), np.float64(depth[m, n])
            if abs(near - far) <= smooth * min(near, far):
                inverse = 0.5 / near + 0.5 / far
                low, high = min(low, inverse), max(high, inverse)
                total, count, lines = total + inverse, count + 1, lines | (1 << k)
    mean = total / max(count, 1)
    if count > 0 and abs(low - mean) <= agree * mean and abs(high - mean) <= agree * mean:
        return mean, count, lines
    return mean, 0, 0


@kernel()
def close_pixel(y, x, found, picture):
    """Write colour, depth and source; ``valid`` stays, for others look at it."""
    color, depth, _, source = picture
    mean, count, lines = found
    weight, first = 1.0 / count, True
    r = g = b = 0.0
    for k in range(4):
        if (lines >> k) & 1:
            j, i, m, n = y + DOWN[k], x + RIGHT[k], y - DOWN[k], x - RIGHT[k]
            r += 0.5 * (np.float64(color[j, i, 0]) + np.float64(color[m, n, 0])) * weight
            g += 0.5 * (np.float64(color[j, i, 1]) + np.float64(color[m, n, 1])) * weight
            b += 0.5 * (np.float64(color[j, i, 2]) + np.float64(color[m, n, 2])) * weight
            if first:
                source[y, x], first = source[j, i], False
    color[y, x, 0], color[y, x, 1], color[y, x, 2], depth[y, x] = r, g, b, 1.0 / mean


@kernel(inline=True)
def find_own(y, picture, limits, own):
    """Pixels (W,) of a row within the image that are valid and not seen through a surface; no branches.

    Those show a sample behind what is on both sides, which its image does not have on both. ``limits``: relative
    difference of the depths of both sides, and how much farther the pixel must be than these.
    """
    depth, valid, source = picture
    up, down, last = y - np.uintp(1), y + np.uintp(1), np.uintp(own.shape[0] - 1)
    apart, behind = limits[0], 1.0 + limits[1]
    own[0], own[last] = valid[y, 0], valid[y, last]
    for x in range(np.uintp(1), last):
        left, right = x - np.uintp(1), x + np.uintp(1)
        image, z = source[y, x], np.float64(depth[y, x])
        a, b = np.float64(depth[up, x]), np.float64(depth[down, x])
        c, d = np.float64(depth[y, left]), np.float64(depth[y, right])
        through = (source[up, x] != image) | (source[down, x] != image)
        through &= valid[up, x] & valid[down, x] & (abs(a - b) <= apart * min(a, b)) & (z > behind * max(a, b))
        across = (source[y, left] != image) | (source[y, right] != image)
        across &= valid[y, left] & valid[y, right] & (abs(c - d) <= apart * min(c, d)) & (z > behind * max(c, d))
        own[x] = valid[y, x] & (not (through | across))


@kernel(inline=True)
def find_gaps(y, own, valid, suspects):
    """Pixels (W,) of a row within the image that are not ``own`` but valid, or on a line whose ends are own."""
    up, down, last = y - np.uintp(1), y + np.uintp(1), np.uintp(suspects.shape[0] - 1)
    suspects[0] = suspects[last] = False
    for x in range(np.uintp(1), last):
        left, right = x - np.uintp(1), x + np.uintp(1)
        lines = np.uint8(own[up, x] & own[down, x]) + np.uint8(own[y, left] & own[y, right])
        lines += np.uint8(own[up, left] & own[down, right]) + np.uint8(own[up, right] & own[down, left])
        suspects[x] = ((lines > np.uint8(0)) | valid[y, x]) & (not own[y, x])


@kernel(inline=True)
def add_line(ends, limit, sums):
    """A line with its ``ends`` = depths, half inverse depths and whether both count, added where it lies on a surface.

    ``sums``: least, greatest and total inverse depth, number of lines.
    """
    near, far, half, other, there = ends
    low, high, total, count = sums
    good = there & (abs(near - far) <= limit * min(near, far))
    inverse = half + other
    low, high = min(low, inverse if good else np.inf), max(high, inverse if good else -np.inf)
    return low, high, total + (inverse if good else 0.0), count + (1.0 if good else 0.0)


@kernel(inline=True)
def count_lines(y, depth, own, limits, room):
    """:func:`look_around` of a row within the image, as far as it says whether lines agree; no branches.

    ``room`` (4,W): half the inverse depths of three rows; the last becomes the number, 0 where lines differ.
    """
    smooth, agree = limits
    one, last = np.uintp(1), np.uintp(depth.shape[1] - 1)
    up, down = y - one, y + one
    above, beside, below, counts = room[0], room[1], room[2], room[3]
    for x in range(np.uintp(depth.shape[1])):
        above[x] = 0.5 / np.float64(depth[up, x])
        beside[x] = 0.5 / np.float64(depth[y, x])
        below[x] = 0.5 / np.float64(depth[down, x])
    for x in range(one, last):
        p, q = x - one, x + one
        sums = (np.inf, -np.inf, 0.0, 0.0)
        a, b = np.float64(depth[up, x]), np.float64(depth[down, x])
        sums = add_line((a, b, above[x], below[x], own[up, x] & own[down, x]), smooth, sums)
        a, b = np.float64(depth[y, p]), np.float64(depth[y, q])
        sums = add_line((a, b, beside[p], beside[q], own[y, p] & own[y, q]), smooth, sums)
        a, b = np.float64(depth[up, p]), np.float64(depth[down, q])
        sums = add_line((a, b, above[p], below[q], own[up, p] & own[down, q]), smooth, sums)
        a, b = np.float64(depth[up, q]), np.float64(depth[down, p])
        sums = add_line((a, b, above[q], below[p], own[up, q] & own[down, p]), smooth, sums)
        mean = sums[2] / max(sums[3], 1.0)
        alike = (abs(sums[0] - mean) <= agree * mean) & (abs(sums[1] - mean) <= agree * mean)
        counts[x] = sums[3] if alike else 0.0


@kernel(inline=True)
def drop_hopeless(y, valid, fewest, suspects, counts):
    """Leave only suspects that can be closed, or must be emptied; ``counts``: of :func:`count_lines`."""
    for x in range(np.uintp(1), np.uintp(suspects.shape[0] - 1)):
        suspects[x] &= valid[y, x] | (counts[x] >= fewest)


@kernel(parallel=True)
def close(color, depth, valid, source, fewest, limits):
    """Close pixels in place: through empty ones at least ``fewest[0]`` lines agree, through others ``fewest[1]``.

    What is seen through a surface and cannot be closed is emptied: it is not what is there.

    Returns:
        (H,W) bool which; (H,W) bool what they were closed from: valid pixels that are not seen through a surface.
    """
    height, width = depth.shape
    smooth, agree, apart = limits
    closed = np.zeros((height, width), np.bool_)
    own = np.empty((height, width), np.bool_)
    for row in prange(height):
        y = np.int64(row)
        picture = borrowed((depth, valid, source))
        if 0 < y < height - 1:
            find_own(np.uintp(y), picture, (apart, agree), borrowed(own[y]))
        else:
            for x in range(width):
                own[y, x] = valid[y, x]
    for row in prange(1, height - 1):
        y = np.int64(row)
        suspects = np.empty(width, np.bool_)
        find_gaps(np.uintp(y), own, valid, suspects)
        picture = borrowed((color, depth, own, source))
        some = np.int64(0)
        for x in range(np.uintp(width)):
            some += np.int64(suspects[x])
        if some * MANY > width:
            room = np.empty((4, width))
            count_lines(np.uintp(y), picture[1], picture[2], (smooth, agree), borrowed(room))
            drop_hopeless(np.uintp(y), valid, fewest[0], suspects, room[3])
        for x in range(1, width - 1):
            if not suspects[x]:
                continue
            found = look_around(y, x, picture[1], picture[2], (smooth, agree))
            if found[1] >= fewest[1 if valid[y, x] else 0]:
                close_pixel(y, x, found, picture)
                closed[y, x] = valid[y, x] = True
            elif valid[y, x]:
                color[y, x, 0] = color[y, x, 1] = color[y, x, 2] = 0.0
                depth[y, x], valid[y, x], source[y, x] = np.inf, False, -1
    return closed, own
