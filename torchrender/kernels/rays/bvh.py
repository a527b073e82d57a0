"""Rays through the bounding volume hierarchy: float32 boxes, float64 watertight triangle test.

The triangle test is Woop, Benthin and Wald, "Watertight ray/triangle intersection", JCGT 2013: the edge functions of
two neighbouring triangles are exact negatives of each other at their shared edge, and rounding can only turn them into
zero, which counts as a hit; so no ray slips through a shared edge or vertex.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.bvh_build import SCALE, STACK, Bvh, build_bvh

__all__ = ["TIE", "Bvh", "Rays", "build_bvh", "trace"]

TIE = 1e-12
"""Hits whose ray parameters differ by less than this, relatively, are one surface; the lowest triangle id wins."""

_BLOCK = 64  # rays handed out at a time


class Rays(NamedTuple):
    """N rays and where to look for hits; ``t`` is in units of the direction's length."""

    origins: np.ndarray  # (N,3) float64
    directions: np.ndarray  # (N,3) float64, not zero
    span: np.ndarray  # (N,2) float64: hits lie strictly between the two
    window: np.ndarray  # (N,2) float64: the part of the span that is searched; whoever asks has excluded hits before it
    ignore: np.ndarray  # (N,) int32 triangle id that is no hit, or -1
    seed: np.ndarray  # (N,) int32 slot that is tried first wherever it is hit in the span, or -1
    cull: bool  # triangles whose right-hand normal points along the ray are no hits
    any_hit: bool  # stop at any hit


class _Shear(NamedTuple):
    """Axes with the direction's largest last, and what turns the ray into that axis, seen from its origin."""

    x: int
    y: int
    z: int
    ox: float
    oy: float
    oz: float
    sx: float
    sy: float
    sz: float


class _Line(NamedTuple):
    """Origin of a ray relative to the frame, and its inverse direction."""

    ox: float
    oy: float
    oz: float
    ix: float
    iy: float
    iz: float


class _Limits(NamedTuple):
    """Which hits count."""

    low: float  # they lie strictly between the two
    high: float
    last: float  # and not beyond this
    ignore: int
    cull: bool


class _Best(NamedTuple):
    """The nearest hit so far; slot -1: none."""

    t: float
    slot: np.int64
    b: float
    c: float


@kernel(inline=True)
def _shear(origins, directions, r, scale):
    """Axes with the direction's largest last, winding kept, and the shear that turns the ray into that axis."""
    # Scalars, not row views: views count references, which two threads fight over.
    dx, dy, dz = abs(directions[r, 0]), abs(directions[r, 1]), abs(directions[r, 2])
    z = 0
    if dy > dx:
        z = 1
    if dz > max(dx, dy):
        z = 2
    x, y = (z + 1) % 3, (z + 2) % 3
    if directions[r, z] < 0:
        x, y = y, x
    step = 1.0 / directions[r, z]
    ox, oy, oz = origins[r, x] * scale, origins[r, y] * scale, origins[r, z] * scale
    return _Shear(x, y, z, ox, oy, oz, directions[r, x] * step, directions[r, y] * step, step / scale)


@kernel(inline=True)
def _triangle(corners, i, shear):
    """Determinant (0: no hit; > 0: front face), ray parameter and weights of the second and third vertex."""
    x, y, z, ox, oy, oz, sx, sy, sz = shear
    az, bz, cz = corners[i, z] - oz, corners[i, 3 + z] - oz, corners[i, 6 + z] - oz
    ax, ay = corners[i, x] - ox - sx * az, corners[i, y] - oy - sy * az
    bx, by = corners[i, 3 + x] - ox - sx * bz, corners[i, 3 + y] - oy - sy * bz
    cx, cy = corners[i, 6 + x] - ox - sx * cz, corners[i, 6 + y] - oy - sy * cz
    u, v, w = cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax
    if (u < 0 or v < 0 or w < 0) and (u > 0 or v > 0 or w > 0):
        return 0.0, 0.0, 0.0, 0.0
    det = u + v + w
    if det == 0:
        return 0.0, 0.0, 0.0, 0.0
    return det, sz * (u * az + v * bz + w * cz) / det, v / det, w / det


@kernel(inline=True)
def _enter(boxes, node, line, first, last):
    """Ray parameter at which the ray enters a node's box within [first, last]; +inf if it does not."""
    ox, oy, oz, ix, iy, iz = line
    a, b = (boxes[node, 0] - ox) * ix, (boxes[node, 3] - ox) * ix
    near, far = max(min(a, b), first), min(max(a, b), last)
    a, b = (boxes[node, 1] - oy) * iy, (boxes[node, 4] - oy) * iy
    near, far = max(near, min(a, b)), min(far, max(a, b))
    a, b = (boxes[node, 2] - oz) * iz, (boxes[node, 5] - oz) * iz
    near, far = max(near, min(a, b)), min(far, max(a, b))
    return near if near <= far else np.inf


@kernel(inline=True)
def _inverse(d):
    """1 / d, finite: 0 times infinity would be NaN for an origin in the plane of a box."""
    return 1.0 / d if abs(d) > 1e-290 else np.copysign(1e290, d)


@kernel(inline=True)
def _try(corners, order, slot, shear, limits, best):
    """The better of a slot's hit and ``best`` (t, slot, weights)."""
    low, high, last, ignore, cull = limits
    det, t, b, c = _triangle(corners, slot, shear)
    if det == 0 or (cull and det < 0) or not (low < t < high) or t > last:
        return best
    own = order[slot]
    tie = TIE * abs(t)
    if own == ignore or t > best.t + tie:
        return best
    if best.slot >= 0 and t >= best.t - tie and own > order[best.slot]:
        return best
    return _Best(t, np.int64(slot), b, c)


@kernel(inline=True)
def _search(tree, line, shear, limits, window, stacks, best):
    """Walk the tree, near child first, through the ray's window."""
    boxes, links, order, corners, _ = tree
    stack, entry, any_hit = stacks
    first, last = window
    low, high, _, ignore, cull = limits
    if best.slot >= 0:
        last = min(last, best.t + TIE * abs(best.t))
        first = min(first, best.t - TIE * abs(best.t))
    limits = _Limits(low, high, last, ignore, cull)
    size, node, limit = 0, np.int64(1), last
    if not first <= last or _enter(boxes, node, line, first, limit) == np.inf:
        return best
    while True:
        left, right = np.int64(links[node, 0]), np.int64(links[node, 1])
        if left < 0:
            for slot in range(-left - 1, -left - 1 + right):
                best = _try(corners, order, slot, shear, limits, best)
            if best.slot >= 0:
                if any_hit:
                    return best
                limit = min(last, best.t + TIE * abs(best.t))
        else:
            a = _enter(boxes, left, line, first, limit)
            b = _enter(boxes, right, line, first, limit)
            if b < a:
                left, right, a, b = right, left, b, a
            if a < np.inf:
                if b < np.inf:
                    stack[size], entry[size] = right, b
                    size += 1
                node = left
                continue
        while size > 0 and entry[size - 1] > limit:
            size -= 1
        if size == 0:
            return best
        size -= 1
        node = np.int64(stack[size])


@kernel(inline=True)
def _line(origins, directions, r, frame):
    """Origin relative to the frame and inverse direction."""
    scale = frame[SCALE]
    ix, iy, iz = (
        _inverse(directions[r, 0] * scale),
        _inverse(directions[r, 1] * scale),
        _inverse(directions[r, 2] * scale),
    )
    ox, oy, oz = origins[r, 0] * scale - frame[0], origins[r, 1] * scale - frame[1], origins[r, 2] * scale - frame[2]
    return _Line(ox, oy, oz, ix, iy, iz)


@kernel(parallel=True)
def trace(bvh, rays):
    """Nearest (or any) hit of each ray.

    Returns:
        ``t`` (N,) float64 (+inf for a miss), ``triangle`` (N,) int64 (-1) and ``weights`` (N,2) float32 of the second
        and third vertex.
    """
    n = rays.origins.shape[0]
    t = np.full(n, np.inf)
    triangle = np.full(n, -1, np.int64)
    weights = np.zeros((n, 2), np.float32)
    blocks = (n + _BLOCK - 1) // _BLOCK
    lanes = min(blocks, 64)
    corners, order = bvh.corners, bvh.order
    origins, directions, span, window, ignore, seed, cull, any_hit = rays
    frame = bvh.frame
    for lane in prange(lanes):
        stacks = (np.zeros(STACK, np.int32), np.zeros(STACK), any_hit)
        # Strided blocks: rays next to each other cost about the same, and threads get equal runs of lanes.
        for block in range(np.int64(lane), blocks, lanes):
            for r in range(block * _BLOCK, min(n, block * _BLOCK + _BLOCK)):
                if seed[r] < 0 and not window[r, 0] < window[r, 1]:
                    continue
                shear = _shear(origins, directions, r, frame[SCALE])
                limits = _Limits(span[r, 0], span[r, 1], np.inf, ignore[r], cull)
                best = _Best(np.inf, np.int64(-1), 0.0, 0.0)
                if seed[r] >= 0:
                    best = _try(corners, order, np.int64(seed[r]), shear, limits, best)
                if best.slot < 0 or not any_hit:
                    line = _line(origins, directions, r, frame)
                    best = _search(bvh, line, shear, limits, (window[r, 0], window[r, 1]), stacks, best)
                if best.slot >= 0:
                    t[r], triangle[r] = best.t, order[best.slot]
                    weights[r, 0], weights[r, 1] = best.b, best.c
    return t, triangle, weights
