"""What few points know, for all pixels around them, along surfaces."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel

REACH = 2.5
"""Points of a row that count, to either side: wholly but for the last unit, where they fade. Two points that are four
apart count as one, so that each number of the pattern has the same share in every pixel, and leaves no dots."""

LEAST = 0.02
"""Share of a point of another surface: all around a pixel together count as half a point of its own, so that faces of a
pixel or two, which have one or none, are not black where few rays found that one hidden."""


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


PARTS = 64
_X, _Y, _Z, _HERE, _NEAR, _SHARE, _TOTAL = range(7)
"""Rows of a thread's room: normals of a row of pixels, their planes' distances from the eye, one by the points'
distance there, the share of one point, the sum of all; the sums of values follow."""


@kernel(counted=False)
def look_at_row(many, j, step, room):
    """Fill what the pixels of row ``j`` are compared by."""
    turn, lens, zero, one, half = many.turn, many.lens, np.float32(0.0), np.float32(1.0), np.float32(0.5)
    across = np.float32(1.5 * step) / lens[0]
    y = (np.float32(j) + half - lens[3]) / lens[1]
    for i in range(many.depth.shape[1]):
        z = many.depth[j, i]
        z = z if z < np.inf else one
        n0, n1, n2 = many.normal[j, i, 0], many.normal[j, i, 1], many.normal[j, i, 2]
        nx = turn[0, 0] * n0 + turn[0, 1] * n1 + turn[0, 2] * n2
        ny = turn[1, 0] * n0 + turn[1, 1] * n1 + turn[1, 2] * n2
        nz = turn[2, 0] * n0 + turn[2, 1] * n1 + turn[2, 2] * n2
        room[_X, i], room[_Y, i], room[_Z, i] = nx, ny, nz
        room[_HERE, i] = ((np.float32(i) + half - lens[2]) / lens[0] * nx + y * ny + nz) * z
        # A point off the pixel's plane by more than the points lie apart is of another surface.
        room[_NEAR, i] = one / (z * across)
    for k in range(_TOTAL, room.shape[0]):
        for i in range(room.shape[1]):
            room[k, i] = zero


@kernel(counted=False)
def add_point(point, beside, values, place, room):
    """Add what one point tells the pixels of a row about it; ``place``: its column among points, their step."""
    m0, m1, m2, p0, p1, p2 = point
    column, step = place
    zero, one, least, reach = np.float32(0.0), np.float32(1.0), np.float32(LEAST), np.float32(REACH)
    middle, apart = np.float32(column * step + step // 2), one / np.float32(step)
    first = np.int64(math.ceil(middle - reach * np.float32(step)))
    end = np.int64(math.floor(middle + reach * np.float32(step))) + 1
    first = first if first > 0 else np.int64(0)
    end = end if end < room.shape[1] else np.int64(room.shape[1])
    nx, ny, nz = room[_X, first:end], room[_Y, first:end], room[_Z, first:end]
    here, near = room[_HERE, first:end], room[_NEAR, first:end]
    share, total = room[_SHARE, first:end], room[_TOTAL, first:end]
    start = (np.float32(first) - middle) * apart
    for i in range(end - first):
        like = max(m0 * nx[i] + m1 * ny[i] + m2 * nz[i], zero)
        off = (p0 * nx[i] + p1 * ny[i] + p2 * nz[i] - here[i]) * near[i]
        like *= max(one - off * off, zero)
        like *= like
        fade = max(min(reach - abs(start + np.float32(i) * apart), one), zero)
        share[i] = beside * fade * (like * like + least)
    for i in range(end - first):
        total[i] += share[i]
    for k in range(values.shape[0]):
        value, told = values[k], room[_TOTAL + 1 + k, first:end]
        for i in range(end - first):
            told[i] += share[i] * value


@kernel(parallel=True)
def spread_points(few, many, out):
    """``out`` (H,W,C): means over the points around each pixel that lie in its plane; empty pixels are left alone."""
    height, width = many.depth.shape
    rows, columns, count = few.values.shape
    for part in prange(PARTS):
        held = np.empty((_TOTAL + 1 + count, width), np.float32)
        room, asked, image, made = borrowed(held), borrowed(few), borrowed(many), borrowed(out)
        step, reach, zero, one = asked.step, np.float32(REACH), np.float32(0.0), np.float32(1.0)
        for j in range(np.int64(part), height, PARTS):
            look_at_row(image, j, step, room)
            y = (np.float32(j) - np.float32(step // 2)) / np.float32(step)
            top = np.int64(math.ceil(y - reach))
            for r in range(top if top > 0 else 0, top + 5 if top + 5 < rows else rows):
                beside = min(reach - abs(y - np.float32(r)), one)
                for c in range(columns):
                    m0, m1, m2 = asked.normal[r, c, 0], asked.normal[r, c, 1], asked.normal[r, c, 2]
                    if beside > zero and (m0 != zero or m1 != zero or m2 != zero):
                        p0, p1, p2 = asked.position[r, c, 0], asked.position[r, c, 1], asked.position[r, c, 2]
                        add_point((m0, m1, m2, p0, p1, p2), beside, asked.values[r, c], (c, step), room)
            for i in range(width):
                if image.depth[j, i] < np.inf and room[_TOTAL, i] > zero:
                    for k in range(count):
                        made[j, i, k] = room[_TOTAL + 1 + k, i] / room[_TOTAL, i]
        keep(held)
