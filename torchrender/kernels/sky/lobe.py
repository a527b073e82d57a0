"""The GGX lobe of a mirror over a tree of cells of the sky: far ones are taken whole, near ones are opened."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


class SkyTree(NamedTuple):
    """Latitude-longitude pictures of cells, each twice as fine as the one before, one after another.

    A cell holds eight numbers: the direction that its light comes from (3), its solid angle, its radiance times solid
    angle (3) and its width as an angle.
    """

    cells: np.ndarray  # (T,8) float32
    starts: np.ndarray  # (L+1,) int64 first cell of each picture
    rows: int  # of the first picture, half its columns


@kernel(inline=True)
def lobe_weight(cosine, alpha):
    """GGX lobe of a mirror seen along its normal, times the light's cosine; not normalised."""
    half = np.float32(0.5)
    below = (half - half * cosine) + (half + half * cosine) * alpha * alpha
    q = alpha / max(below, np.float32(1e-12))
    return q * q * max(cosine, np.float32(0.0))


@kernel(parallel=True)
def lobe_mean(tree, normals, lobe, total):
    """Mean radiance (N,3) over the lobe about each of the normals (N,3).

    ``lobe`` = (alpha, detail): a cell is opened if it is wider than ``detail`` times what the lobe varies over there,
    its width or half the angle to its axis.
    """
    alpha, detail = np.float32(lobe[0]), np.float32(lobe[1])
    cells, starts, rows = tree
    depth = starts.shape[0] - 1
    threads = 64
    for part in prange(threads):
        stack = np.empty((64, 3), np.int64)
        for n in range(np.int64(part), normals.shape[0], threads):
            nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
            r = g = b = weight = np.float32(0.0)
            for root in range(rows * 2 * rows):
                stack[0, 0], stack[0, 1], stack[0, 2] = 0, root // (2 * rows), root % (2 * rows)
                top = 1
                while top > 0:
                    top -= 1
                    level, j, i = stack[top, 0], stack[top, 1], stack[top, 2]
                    at = starts[level] + j * ((2 * rows) << level) + i
                    cosine = cells[at, 0] * nx + cells[at, 1] * ny + cells[at, 2] * nz
                    width = cells[at, 7]
                    if cosine < -width:
                        continue
                    if level + 1 < depth:
                        angle = math.sqrt(max(np.float32(2.0) - np.float32(2.0) * cosine, np.float32(0.0)))
                        if width > detail * max(alpha, np.float32(0.5) * angle):
                            for child in range(4):
                                stack[top, 0] = level + 1
                                stack[top, 1] = 2 * j + (child >> 1)
                                stack[top, 2] = 2 * i + (child & 1)
                                top += 1
                            continue
                    share = lobe_weight(cosine, alpha)
                    r += share * cells[at, 4]
                    g += share * cells[at, 5]
                    b += share * cells[at, 6]
                    weight += share * cells[at, 3]
            total[n, 0], total[n, 1], total[n, 2] = r / weight, g / weight, b / weight
