"""What few points know, for all pixels around them, along surfaces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel

REACH = 2.5
"""Points of a row that count, to either side: wholly but for the last unit, where they fade. Two points that are four
apart count as one, so that each number of the pattern has the same share in every pixel, and leaves no dots."""
MOST = 25
"""Points that count in a pixel."""


class Few(NamedTuple):
    """Points on a grid over the picture, one for every ``step`` pixels and side."""

    position: np.ndarray  # (h,w,3) float32 in the camera's frame
    normal: np.ndarray  # (h,w,3) in the camera's frame; 0: nothing is seen there
    values: np.ndarray  # (h,w,C)
    step: int


class Many(NamedTuple):
    """The pixels of the picture."""

    depth: np.ndarray  # (H,W) float32; +inf: nothing
    normal: np.ndarray  # (H,W,3) in the frame of ``turn``
    turn: np.ndarray  # (3,3) float32 camera from that frame
    lens: np.ndarray  # (4,) float32 fx, fy, cx, cy


@kernel(parallel=True)
def spread_points(few, many, out):
    """``out`` (H,W,C): means over the points around each pixel that lie in its plane; empty pixels are left alone."""
    height, width = many.depth.shape
    rows, columns = few.normal.shape[:2]
    count = few.values.shape[2]
    all_values = few.values.reshape(rows * columns, count)
    all_places, all_normals = few.position.reshape(rows * columns, 3), few.normal.reshape(rows * columns, 3)
    turn, lens, step = many.turn, many.lens, few.step
    zero, one, least, reach = np.float32(0.0), np.float32(1.0), np.float32(1e-6), np.float32(REACH)
    for j in prange(height):
        held = (np.zeros(MOST, np.float32), np.zeros(MOST, np.uint32))
        share, place = borrowed(held)
        image, room = borrowed(many), borrowed(out)
        places, normals, values = borrowed(all_places), borrowed(all_normals), borrowed(all_values)
        y = (np.float32(j) - np.float32(step // 2)) / np.float32(step)
        for i in range(width):
            z = image.depth[j, i]
            if z == np.inf:
                continue
            px = (np.float32(i) + np.float32(0.5) - lens[2]) / lens[0] * z
            py = (np.float32(j) + np.float32(0.5) - lens[3]) / lens[1] * z
            n0, n1, n2 = image.normal[j, i, 0], image.normal[j, i, 1], image.normal[j, i, 2]
            nx = turn[0, 0] * n0 + turn[0, 1] * n1 + turn[0, 2] * n2
            ny = turn[1, 0] * n0 + turn[1, 1] * n1 + turn[1, 2] * n2
            nz = turn[2, 0] * n0 + turn[2, 1] * n1 + turn[2, 2] * n2
            # A point off the pixel's plane by more than the points lie apart is of another surface.
            near = np.float32(1.0) / (z * np.float32(1.5 * step) / lens[0])
            x = (np.float32(i) - np.float32(step // 2)) / np.float32(step)
            top, left = np.int64(np.ceil(y - reach)), np.int64(np.ceil(x - reach))
            here = px * nx + py * ny + z * nz
            weights, taken = np.float32(0.0), np.uintp(0)
            for r in range(top if top > 0 else 0, top + 5 if top + 5 < rows else rows):
                beside = min(reach - abs(y - np.float32(r)), one)
                for c in range(left if left > 0 else 0, left + 5 if left + 5 < columns else columns):
                    at = np.uintp(r * columns + c)
                    m0, m1, m2 = normals[at, 0], normals[at, 1], normals[at, 2]
                    there = m0 != zero or m1 != zero or m2 != zero
                    like = max(m0 * nx + m1 * ny + m2 * nz, zero)
                    p0, p1, p2 = places[at, 0], places[at, 1], places[at, 2]
                    off = (p0 * nx + p1 * ny + p2 * nz - here) * near
                    like *= max(one - off * off, zero)
                    like *= like
                    weight = beside * min(reach - abs(x - np.float32(c)), one) * (like * like + least)
                    weight = weight if there else zero
                    weights += weight
                    share[taken], place[taken] = weight, at
                    taken = taken + np.uintp(1)
            if weights > zero:
                for k in range(count):
                    total = zero
                    for n in range(taken):
                        total += share[n] * values[place[n], np.uintp(k)]
                    room[j, i, k] = total / weights
        keep(held)
