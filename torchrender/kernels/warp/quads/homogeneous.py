"""Triangles of homogeneous target pixels (X, Y, Z), which need no division: any of their corners may lie behind."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.quads.small_quads import SUBPIXEL


@kernel()
def point(i, row, across, down, z, matrix):
    """Homogeneous target pixel (X, Y, Z) of a corner."""
    u, v = np.float64(i) + across, row + down
    x = z * (matrix[0, 0] * u + (matrix[0, 1] * v + matrix[0, 2])) + matrix[0, 3]
    y = z * (matrix[1, 0] * u + (matrix[1, 1] * v + matrix[1, 2])) + matrix[1, 3]
    w = z * (matrix[2, 0] * u + (matrix[2, 1] * v + matrix[2, 2])) + matrix[2, 3]
    return x, y, w


@kernel()
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel()
def visible_box(a, b, c, near, width, height):
    """First and last pixel that the part of a triangle with depth >= near can cover; homogeneous corners."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    corners = (a, b, c)
    for k in range(3):
        p, n = corners[k], corners[(k + 1) % 3]
        if p[2] >= near:
            x, y = p[0] / p[2], p[1] / p[2]
            low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
        if (p[2] >= near) != (n[2] >= near):
            t = (near - p[2]) / (n[2] - p[2])
            x, y = (p[0] + t * (n[0] - p[0])) / near, (p[1] + t * (n[1] - p[1])) / near
            low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    x0 = math.ceil(max(low_x - 0.5 - 1.0 / SUBPIXEL, 0.0))
    y0 = math.ceil(max(low_y - 0.5 - 1.0 / SUBPIXEL, 0.0))
    x1 = math.floor(min(high_x - 0.5 + 1.0 / SUBPIXEL, width - 1.0))
    y1 = math.floor(min(high_y - 0.5 + 1.0 / SUBPIXEL, height - 1.0))
    return np.int64(x0), np.int64(y0), np.int64(x1), np.int64(y1)
