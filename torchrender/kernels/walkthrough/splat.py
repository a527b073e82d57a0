"""Points of a walkthrough as squares in the depth buffer that planes are in already."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

RECORD = 4
"""Floats of a projected point: column, row, depth, side of its square (0: not drawn)."""

BLOCK = 2048
STRIP = 16
"""Rows of pixels that one thread owns at a time: no two threads ever write the same pixel."""

POINT = 3
"""What a pixel that shows points is marked with."""


class Points(NamedTuple):
    """M points."""

    position: Any  # (M,3) float32, relative to ``View.origin``
    normal: Any  # (M,3) float32 unit, or 0 where unknown
    color: Any  # (M,3) uint8 sRGB codes
    footprint: Any  # (M,) float32 side of the pixel that it was in its photo, scene units


class View(NamedTuple):
    """One camera."""

    matrix: Any  # (3,4) float64 camera from position
    lens: Any  # (4,) fx, fy, cx, cy
    near: float
    far: float
    cap: float  # greatest side, pixels
    grow: float  # factor of the side


@kernel(parallel=True)
def project(points, view, runs, starts, size, records):
    """Project the points of ``runs`` (R,2); ``records`` (sum,4) begin at ``starts`` (R,) for each run."""
    position, normal, _, footprint = points
    m, lens, near, far, cap, grow = view
    width, height = size
    focal = lens[0] * lens[1]
    count = len(records)
    for block in prange((count + BLOCK - 1) // BLOCK):
        row = int(block) * BLOCK
        end = min(row + BLOCK, count)
        r = int(np.searchsorted(starts, row, side="right")) - 1
        while row < end:
            first = runs[r, 0] + row - starts[r]
            for k in range(first, min(runs[r, 1], first + end - row)):
                records[row, 3] = 0.0
                row += 1
                x, y, z = float(position[k, 0]), float(position[k, 1]), float(position[k, 2])
                c = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                if not (near <= c <= far):
                    continue
                a = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
                b = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
                inverse = 1.0 / c
                u, v = lens[0] * a * inverse + lens[2], lens[1] * b * inverse + lens[3]
                if not (-3.0 < u < width + 3.0 and -3.0 < v < height + 3.0):
                    continue
                nx, ny, nz = float(normal[k, 0]), float(normal[k, 1]), float(normal[k, 2])
                # In the camera's frame: the plane through the point lies h away from the eye.
                h = (
                    (m[0, 0] * nx + m[0, 1] * ny + m[0, 2] * nz) * a
                    + (m[1, 0] * nx + m[1, 1] * ny + m[1, 2] * nz) * b
                    + (m[2, 0] * nx + m[2, 1] * ny + m[2, 2] * nz) * c
                )
                if nx == 0.0 and ny == 0.0 and nz == 0.0:
                    h = c
                ratio = math.sqrt(focal * abs(h) * inverse * inverse * inverse) * footprint[k] * grow
                records[row - 1, 0], records[row - 1, 1], records[row - 1, 2] = u, v, c
                records[row - 1, 3] = min(max(math.ceil(ratio - 0.05), 1.0), cap)
            r += 1


@kernel(inline=True)
def span(centre, side, limit):
    """First and one past last pixel of a square."""
    first = math.floor(centre - 0.5 * (side - 1.0))
    return max(first, 0), min(first + int(side), limit)


class Shares(NamedTuple):
    """How points meet planes and each other."""

    lead: float  # share of a plane's depth that a point must stay below to be seen before it
    tolerance: float  # share of depth within which points are blended
    threads: int


@kernel(parallel=True)
def draw_points(source, runs, starts, records, shares, space, out):
    """Draw projected points over what is in ``out``: image (H,W,3) linear, depth (H,W), kind (H,W) uint8.

    ``source``: colours (M,3) and the table (256,) of their linear light. The nearest points win; those within the
    tolerance behind them are blended by how near their middle is. ``space``, not cleared: (H,W) and (H,W,4) float32.
    """
    colors, table = source
    image, depth, kind = out
    near, sums = space
    height, width = depth.shape
    lead, behind = np.float32(shares.lead), np.float32(1.0 + shares.tolerance)
    one, half, least = np.float32(1.0), np.float32(0.5), np.float32(0.02)
    threads = shares.threads
    owner = (np.arange(height) // STRIP) % threads
    for thread in prange(threads):
        turn = np.int64(thread)
        for y in range(height):
            if owner[y] == turn:
                for x in range(width):
                    near[y, x] = depth[y, x] * lead
                    for c in range(4):
                        sums[y, x, c] = 0.0
        for k in range(len(records)):
            side = records[k, 3]
            if side <= 0.0:
                continue
            z = records[k, 2]
            y0, y1 = span(records[k, 1], side, height)
            x0, x1 = span(records[k, 0], side, width)
            for y in range(y0, y1):
                if owner[y] == turn:
                    for x in range(x0, x1):
                        if z < near[y, x]:
                            near[y, x] = z
        for r in range(len(runs)):
            shift = starts[r] - runs[r, 0]
            for k in range(runs[r, 0], runs[r, 1]):
                side = records[k + shift, 3]
                if side <= 0.0:
                    continue
                u, v, z = records[k + shift, 0], records[k + shift, 1], records[k + shift, 2]
                y0, y1 = span(v, side, height)
                x0, x1 = span(u, side, width)
                rate = one / (half * side + half)
                for y in range(y0, y1):
                    if owner[y] != turn:
                        continue
                    fall = max(one - abs(np.float32(y) + half - v) * rate, least)
                    for x in range(x0, x1):
                        front = near[y, x]
                        if z <= front * behind and front < depth[y, x] * lead:
                            w = fall * max(one - abs(np.float32(x) + half - u) * rate, least)
                            sums[y, x, 0] += w * table[colors[k, 0]]
                            sums[y, x, 1] += w * table[colors[k, 1]]
                            sums[y, x, 2] += w * table[colors[k, 2]]
                            sums[y, x, 3] += w
        for y in range(height):
            if owner[y] == turn:
                for x in range(width):
                    if sums[y, x, 3] > 0.0:
                        scale = one / sums[y, x, 3]
                        for c in range(3):
                            image[y, x, c] = sums[y, x, c] * scale
                        depth[y, x] = near[y, x]
                        kind[y, x] = POINT
