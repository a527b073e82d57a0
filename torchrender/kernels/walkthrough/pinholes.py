"""Pinholes between points: single pixels through which something behind shows."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.walkthrough.splat import POINT

AROUND = 6
"""Neighbours of eight that must be nearer points: a straight edge has three, a corner five."""

NEARER = 0.98
"""Share of a pixel's depth below which a neighbour lies before it."""

ONE_SURFACE = 1.05
"""Times the depth of the nearest neighbour up to which others belong to its surface."""


@kernel(inline=True)
def around(depth, kind, y, x):
    """How many neighbours of an inner pixel are nearer points of one surface, and how deep that ends."""
    nearest = np.float32(np.inf)
    for b in range(y - 1, y + 2):
        for a in range(x - 1, x + 2):
            if kind[b, a] == POINT and (b != y or a != x):
                nearest = min(nearest, depth[b, a])
    limit = min(nearest * np.float32(ONE_SURFACE), depth[y, x] * np.float32(NEARER))
    count = 0
    if nearest < limit:
        for b in range(y - 1, y + 2):
            for a in range(x - 1, x + 2):
                if kind[b, a] == POINT and depth[b, a] <= limit and (b != y or a != x):
                    count += 1
    return count, limit


@kernel(parallel=True)
def close_pinholes(image, depth, kind, holes):
    """Give pixels that nearer points surround the mean of these; ``holes`` (H,W) float32 is room, not cleared.

    Pixels are found in one pass and filled in another, so that the result does not depend on the order.
    """
    height, width = depth.shape
    for y in prange(height):
        for x in range(width):
            holes[y, x] = 0.0
            if 0 < y < height - 1 and 0 < x < width - 1:
                # Six of eight leave no two opposite sides open.
                if kind[y - 1, x] != POINT and kind[y + 1, x] != POINT:
                    continue
                if kind[y, x - 1] != POINT and kind[y, x + 1] != POINT:
                    continue
                count, limit = around(depth, kind, np.int64(y), x)
                if count >= AROUND:
                    holes[y, x] = limit
    for y in prange(height):
        for x in range(width):
            limit = holes[y, x]
            if limit <= 0.0:
                continue
            total, red, green, blue, far = 0, np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for b in range(np.int64(y) - 1, np.int64(y) + 2):
                for a in range(x - 1, x + 2):
                    if kind[b, a] == POINT and holes[b, a] <= 0.0 and depth[b, a] <= limit:
                        total += 1
                        red, green, blue = red + image[b, a, 0], green + image[b, a, 1], blue + image[b, a, 2]
                        far += depth[b, a]
            if total > 0:
                scale = np.float32(1.0) / np.float32(total)
                image[y, x, 0], image[y, x, 1], image[y, x, 2] = red * scale, green * scale, blue * scale
                # Only pixels that are no holes are read here, so what is written is read by nobody.
                depth[y, x] = far * scale
                kind[y, x] = POINT
