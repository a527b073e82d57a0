"""Gaussians on the picture plane, blended from the front: sorted into tiles, then pixel by pixel.

Source: Kerbl, Kopanas, Leimkuehler, Drettakis 2023, "3D Gaussian splatting", section 6.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

TILE = 16
U, V, A, B, C, DEPTH, OPACITY, RED, GREEN, BLUE = range(10)
"""Columns of a record: centre in pixels, inverse covariance (a, b; b, c), camera z, opacity, colour."""
LEAST = 1.0 / 255.0
MOST = 0.99
ENOUGH = 1e-4


@kernel()
def count_tiles(boxes: np.ndarray, across: int, counts: np.ndarray) -> None:
    """How many Gaussians each tile (T,) has; ``boxes`` (N,4) int32 first and last tile in x and y."""
    for n in range(len(boxes)):
        for ty in range(boxes[n, 2], boxes[n, 3] + 1):
            for tx in range(boxes[n, 0], boxes[n, 1] + 1):
                counts[ty * across + tx] += 1


@kernel()
def fill_tiles(boxes: np.ndarray, across: int, next_place: np.ndarray, entries: np.ndarray) -> None:
    """Numbers of the Gaussians of each tile, in the order that they come in; ``next_place`` (T,) is used up."""
    for n in range(len(boxes)):
        for ty in range(boxes[n, 2], boxes[n, 3] + 1):
            for tx in range(boxes[n, 0], boxes[n, 1] + 1):
                tile = ty * across + tx
                entries[next_place[tile]] = n
                next_place[tile] += 1


@kernel(parallel=True)
def blend_tiles(
    records: np.ndarray, entries: np.ndarray, start: np.ndarray, image: np.ndarray, depth: np.ndarray, cover: np.ndarray
) -> None:
    """Blend each pixel from the front.

    Args:
        records: (N,10) float32, nearest first.
        entries: (E,) int32 records of all tiles; ``start`` (T+1,) the first one of each.
        image: (H,W,3) float32 colours times what covers them.
        depth: (H,W) float32 mean depth of what was blended; +inf where nothing is.
        cover: (H,W) float32 share of the pixel that is covered.
    """
    height, width = cover.shape
    across = (width + TILE - 1) // TILE
    for tile in prange(len(start) - 1):
        y0, x0 = tile // across * TILE, tile % across * TILE
        for y in range(y0, min(y0 + TILE, height)):
            for x in range(x0, min(x0 + TILE, width)):
                through, far, weight = 1.0, 0.0, 0.0
                red, green, blue = 0.0, 0.0, 0.0
                for place in range(start[tile], start[tile + 1]):
                    n = entries[place]
                    dx, dy = x + 0.5 - records[n, U], y + 0.5 - records[n, V]
                    power = 0.5 * (records[n, A] * dx * dx + records[n, C] * dy * dy) + records[n, B] * dx * dy
                    if power < 0.0:
                        continue
                    alpha = min(MOST, records[n, OPACITY] * math.exp(-power))
                    if alpha < LEAST:
                        continue
                    share = alpha * through
                    red += share * records[n, RED]
                    green += share * records[n, GREEN]
                    blue += share * records[n, BLUE]
                    far += share * records[n, DEPTH]
                    weight += share
                    through *= 1.0 - alpha
                    if through < ENOUGH:
                        break
                image[y, x, 0], image[y, x, 1], image[y, x, 2] = red, green, blue
                cover[y, x] = weight
                depth[y, x] = far / weight if weight > 0.0 else math.inf
