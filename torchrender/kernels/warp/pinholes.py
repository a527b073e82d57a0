"""Single pixels within a surface that its samples missed, closed from their neighbours."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel

DOWN, RIGHT = (-1, 0, -1, -1), (0, -1, -1, 1)
"""Steps to one end of the four lines through a pixel; the other end lies opposite."""


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


@kernel()
def is_seen_through(y, x, depth, valid, source, limits):
    """Whether a pixel shows a sample behind what is on both sides, which its image does not have on both.

    ``limits``: relative difference of the depths of both sides, and how much farther the pixel must be than these.
    """
    apart, behind = limits
    own, z = source[y, x], np.float64(depth[y, x])
    for k in range(2):
        j, i, m, n = y + DOWN[k], x + RIGHT[k], y - DOWN[k], x - RIGHT[k]
        if (source[j, i] != own or source[m, n] != own) and valid[j, i] and valid[m, n]:
            near, far = np.float64(depth[j, i]), np.float64(depth[m, n])
            if abs(near - far) <= apart * min(near, far) and z > (1.0 + behind) * max(near, far):
                return True
    return False


@kernel(inline=True)
def find_seams(y, valid, source, suspects):
    """Pixels (W,) of a row within the image beside which another image is seen; no branches, so that it vectorises."""
    up, down, last = y - np.uintp(1), y + np.uintp(1), np.uintp(suspects.shape[0] - 1)
    suspects[0] = suspects[last] = False
    for x in range(np.uintp(1), last):
        own = source[y, x]
        across = (source[y, x - np.uintp(1)] != own) | (source[y, x + np.uintp(1)] != own)
        suspects[x] = valid[y, x] & (across | (source[up, x] != own) | (source[down, x] != own))


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
        for x in range(width):
            own[y, x] = valid[y, x]
        if not 0 < y < height - 1:
            continue
        suspects = np.empty(width, np.bool_)
        find_seams(np.uintp(y), valid, source, suspects)
        for x in range(width):
            if suspects[x]:
                own[y, x] = not is_seen_through(y, x, picture[0], picture[1], picture[2], (apart, agree))
    for row in prange(1, height - 1):
        y = np.int64(row)
        suspects = np.empty(width, np.bool_)
        find_gaps(np.uintp(y), own, valid, suspects)
        picture = borrowed((color, depth, own, source))
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
