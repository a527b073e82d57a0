"""Points of a walkthrough as squares in the depth buffer that planes are in already."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import fetch_add, store_max
from torchrender.kernels.compile import kernel

RECORD = 4
"""Floats of a projected point: column, row, depth, side of its square (0: not drawn)."""


class Points(NamedTuple):
    """M points."""

    position: Any  # (M,3) float32, relative to ``View.origin``
    normal: Any  # (M,3) int8
    color: Any  # (M,3) uint8 sRGB codes
    log_density: Any  # (M,) float32 of pixels per unit of area, when it was photographed


class View(NamedTuple):
    """One camera."""

    matrix: Any  # (3,4) float64 camera from position
    lens: Any  # (4,) fx, fy, cx, cy
    near: float
    far: float
    cap: float  # greatest side, pixels
    grow: float  # factor of the side
    tolerance: float  # share of depth within which points are blended
    facing: bool  # points seen from behind are not drawn


@kernel(parallel=True)
def project(points, view, runs, starts, size, records):
    """Project the points of ``runs`` (R,2); ``records`` (sum,4) begin at ``starts`` (R,) for each run."""
    width, height = size
    m, lens = view.matrix, view.lens
    focal = lens[0] * lens[1]
    for r in prange(len(runs)):
        for k in range(runs[r, 0], runs[r, 1]):
            row = starts[r] + k - runs[r, 0]
            records[row, 3] = 0.0
            x, y, z = float(points.position[k, 0]), float(points.position[k, 1]), float(points.position[k, 2])
            a = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
            b = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
            c = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            if not (view.near <= c <= view.far):
                continue
            u, v = lens[0] * a / c + lens[2], lens[1] * b / c + lens[3]
            if not (-3.0 < u < width + 3.0 and -3.0 < v < height + 3.0):
                continue
            nx, ny, nz = float(points.normal[k, 0]), float(points.normal[k, 1]), float(points.normal[k, 2])
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            # In the camera's frame, towards the eye: the plane through the point lies h away from the eye.
            h = -(
                (m[0, 0] * nx + m[0, 1] * ny + m[0, 2] * nz) * a
                + (m[1, 0] * nx + m[1, 1] * ny + m[1, 2] * nz) * b
                + (m[2, 0] * nx + m[2, 1] * ny + m[2, 2] * nz) * c
            ) / max(length, 1.0)
            if length < 1.0:
                h = c
            if h <= 0.0 and view.facing:
                continue
            ratio = math.sqrt(focal * abs(h) / (c * c * c) / math.exp(points.log_density[k])) * view.grow
            side = min(max(math.ceil(ratio - 0.05), 1.0), view.cap)
            records[row, 0], records[row, 1], records[row, 2], records[row, 3] = u, v, c, side


@kernel(inline=True)
def span(centre, side, limit):
    """First and one past last pixel of a square."""
    first = math.floor(centre - 0.5 * (side - 1.0))
    return max(first, 0), min(first + int(side), limit)


@kernel(parallel=True)
def nearest(records, front, size, threads, keys):
    """Inverse depths of the nearest points that lie before ``front`` (H*W,) float32, as bits, in ``keys`` uint64."""
    width, height = size
    count = len(records)
    block = (count + threads * 8 - 1) // (threads * 8) if count else 1
    for t in prange(threads * 8):
        bits = np.zeros(1, np.float32)
        for k in range(t * block, min((t + 1) * block, count)):
            side = records[k, 3]
            if side <= 0.0:
                continue
            z = records[k, 2]
            bits[0] = np.float32(1.0) / z
            key = np.uint64(bits.view(np.uint32)[0])
            x0, x1 = span(records[k, 0], side, width)
            y0, y1 = span(records[k, 1], side, height)
            for y in range(y0, y1):
                for x in range(x0, x1):
                    pixel = y * width + x
                    if z < front[pixel] and keys[pixel] < key:
                        store_max(keys, pixel, key)


@kernel(parallel=True)
def blend(points, view, runs, starts, records, near_depth, size, sums):
    """Add up ``sums`` (4*H*W,) int64: red, green, blue in linear light times weight, and the weight, of all points
    within the tolerance behind ``near_depth`` (H*W,). Integers: the result does not depend on who comes first."""
    colors, table = points
    width, height = size
    for r in prange(len(runs)):
        for k in range(runs[r, 0], runs[r, 1]):
            row = starts[r] + k - runs[r, 0]
            side = records[row, 3]
            if side <= 0.0:
                continue
            u, v, z = float(records[row, 0]), float(records[row, 1]), float(records[row, 2])
            x0, x1 = span(records[row, 0], side, width)
            y0, y1 = span(records[row, 1], side, height)
            red, green, blue = table[colors[k, 0]], table[colors[k, 1]], table[colors[k, 2]]
            reach = 0.5 * side + 0.5
            for y in range(y0, y1):
                fall_y = 1.0 - abs(y + 0.5 - v) / reach
                for x in range(x0, x1):
                    pixel = y * width + x
                    if z > near_depth[pixel] * (1.0 + view.tolerance):
                        continue
                    fall = max(fall_y, 0.02) * max(1.0 - abs(x + 0.5 - u) / reach, 0.02)
                    weight = int(fall * 1024.0) + 1
                    fetch_add(sums, 4 * pixel, weight * red)
                    fetch_add(sums, 4 * pixel + 1, weight * green)
                    fetch_add(sums, 4 * pixel + 2, weight * blue)
                    fetch_add(sums, 4 * pixel + 3, np.int64(weight))
