"""Colours of few rendered pixels for many, along surfaces."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(parallel=True)
def spread_colors(colors, rendered, depth, same, left_over, out):
    """``out`` (H,W,3): means of the four rendered pixels around each pixel, weighted by nearness and by depth.

    ``colors`` (h,w,3) and ``rendered`` (h,w) depth are of the rendered pixels. Weights are bilinear times
    ``exp(-(d / same)^2) + left_over`` for a difference d of inverse depth, as a share of the larger one.
    """
    height, width = depth.shape
    rows, columns = rendered.shape
    for j in prange(height):
        y = (j + 0.5) * (rows / height) - 0.5
        top = math.floor(y)
        for i in range(width):
            x = (i + 0.5) * (columns / width) - 0.5
            left = math.floor(x)
            own = 1.0 / depth[j, i]
            red, green, blue, weights = 0.0, 0.0, 0.0, 0.0
            for row in range(top, top + 2):
                for column in range(left, left + 2):
                    r, c = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
                    other = 1.0 / rendered[r, c]
                    apart = abs(own - other) / max(own, other, 1e-30)
                    weight = (1.0 - abs(y - row)) * (1.0 - abs(x - column))
                    weight *= math.exp(-((apart / same) ** 2)) + left_over
                    red += weight * colors[r, c, 0]
                    green += weight * colors[r, c, 1]
                    blue += weight * colors[r, c, 2]
                    weights += weight
            out[j, i, 0] = np.float32(red / weights)
            out[j, i, 1] = np.float32(green / weights)
            out[j, i, 2] = np.float32(blue / weights)
