"""Means over the pixels around, of the same reflector, by how much their lobes overlap."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


class Lobes(NamedTuple):
    """What the pixels of a picture mirror, and how wide."""

    color: np.ndarray  # (H,W,3) float32
    direction: np.ndarray  # (H,W,3) float32 unit, mirrored
    width: np.ndarray  # (H,W) float32 deviation by which directions may differ that share
    reflector: np.ndarray  # (H,W) int64, -1: none


@kernel(parallel=True)
def share_around(lobes, apart, least, out):
    """Write to ``out`` (H,W,3) the weighted means of each pixel's colour and those of the eight so many pixels apart.

    Args:
        lobes: :class:`Lobes`.
        apart: rows and columns.
        least: two widths: pixels that are not wider than the first keep their colour, those not wider than the second
            share theirs with none.
    """
    color, direction, width, reflector = lobes
    height, columns = reflector.shape
    for y in prange(height):
        for x in range(columns):
            own, wide = reflector[y, x], width[y, x]
            r, g, b, total = color[y, x, 0], color[y, x, 1], color[y, x, 2], np.float32(1.0)
            if own >= 0 and wide > least[0]:
                scale = np.float32(-0.5) / (wide * wide)
                for dy in range(-apart, apart + 1, apart):
                    for dx in range(-apart, apart + 1, apart):
                        j, i = y + dy, x + dx
                        if (dy == 0 and dx == 0) or j < 0 or i < 0 or j >= height or i >= columns:
                            continue
                        if reflector[j, i] != own or not width[j, i] > least[1]:
                            continue
                        u = direction[y, x, 0] - direction[j, i, 0]
                        v = direction[y, x, 1] - direction[j, i, 1]
                        w = direction[y, x, 2] - direction[j, i, 2]
                        weight = np.float32(math.exp((u * u + v * v + w * w) * scale))
                        r += weight * color[j, i, 0]
                        g += weight * color[j, i, 1]
                        b += weight * color[j, i, 2]
                        total += weight
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = r / total, g / total, b / total
