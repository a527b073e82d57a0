"""Which samples of one depth image another one holds: what a stream need not send again."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(parallel=True)
def find_known(depth, triangle, matrix, other_depth, other_triangle, tolerance, known):
    """Mark samples (H,W) that the other image holds; ``known`` keeps what is marked already.

    A sample is held if one of the four pixels around its place in the other image stores its triangle, or if its
    inverse depth there lies between theirs, give or take the share ``tolerance``. ``matrix`` (3,4): homogeneous pixel
    of the other camera = z M[:, :3] (u, v, 1) + M[:, 3].
    """
    height, width = depth.shape
    rows, columns = other_depth.shape
    for j in prange(height):
        for i in range(width):
            z = depth[j, i]
            if known[j, i] or not z < np.inf:
                continue
            u, v = i + 0.5, j + 0.5
            w = z * (matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]) + matrix[2, 3]
            if w <= 0.0:
                continue
            x = (z * (matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]) + matrix[0, 3]) / w - 0.5
            y = (z * (matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]) + matrix[1, 3]) / w - 0.5
            if not (-0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5):
                continue
            left, top = math.floor(x), math.floor(y)
            low, high, found = np.inf, 0.0, False
            for row in range(max(top, 0), min(top + 2, rows)):
                for column in range(max(left, 0), min(left + 2, columns)):
                    found = found or other_triangle[row, column] == triangle[j, i]
                    inverse = 1.0 / other_depth[row, column]
                    low, high = min(low, inverse), max(high, inverse)
            known[j, i] = found or (low * (1.0 - tolerance) <= 1.0 / w <= high * (1.0 + tolerance))
