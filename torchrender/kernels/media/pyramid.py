"""Pyramids of least and greatest values of a light's depth images."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.records import BIG

F: Any = np.float32
I64: Any = np.int64
BAND = 32  # rows of the finest level that a thread takes at a time


@kernel(parallel=True)
def build_pyramid(depth, parallel, levels, pyramid):
    """Fill ``pyramid`` (V,K,2) from depths (V,H,W), +inf where a light sees nothing.

    Args:
        parallel: values are depths; else -1/depth.
        levels: (L,3) int64 first entry, rows, columns of each level; the rows of the next one are half as many, rounded
            up.
    """
    views, height, width = depth.shape
    for band in prange(views * ((height + BAND - 1) // BAND)):
        view, part = band // ((height + BAND - 1) // BAND), band % ((height + BAND - 1) // BAND)
        for r in range(part * BAND, min(part * BAND + BAND, height)):
            for c in range(width):
                z = depth[view, r, c]
                q = min(z, BIG) if parallel else F(-1.0) / max(z, F(1e-30))
                k = r * width + c
                pyramid[view, k, 0] = q
                pyramid[view, k, 1] = q
    for level in range(1, len(levels)):
        below, own = levels[level - 1], levels[level]
        for row in prange(views * own[1]):
            view, r = I64(row // own[1]), I64(row % own[1])
            for c in range(own[2]):
                low, high = F(BIG), -F(BIG)
                for j in range(2 * r, min(2 * r + 2, below[1])):
                    for i in range(2 * c, min(2 * c + 2, below[2])):
                        b = below[0] + j * below[2] + i
                        low, high = min(low, pyramid[view, b, 0]), max(high, pyramid[view, b, 1])
                at = own[0] + r * own[2] + c
                pyramid[view, at, 0] = low
                pyramid[view, at, 1] = high
