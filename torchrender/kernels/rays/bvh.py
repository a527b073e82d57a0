"""Rays through the bounding volume hierarchy: float32 boxes, float64 watertight triangle test. Needs no Embree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.fragments import is_hole
from torchrender.kernels.rays.boxes import SCALE
from torchrender.kernels.rays.bvh_build import STACK
from torchrender.kernels.rays.watertight import BLOCK, LANES, TIE, hit_triangle, shear_of


class _Line(NamedTuple):
    """Origin of a ray relative to the frame, and its inverse direction."""

    ox: float
    oy: float
    oz: float
    ix: float
    iy: float
    iz: float


class _Limits(NamedTuple):
    """Which hits count: those strictly between ``low`` and ``high``."""

    low: float
    high: float
    ignore: int
    cull: bool


class _Best(NamedTuple):
    """The nearest hit so far; slot -1: none."""

    t: float
    slot: np.int64
    b: float
    c: float


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
def _try(scene, slot, shear, limits, best):
    """The better of a slot's hit and ``best``."""
    points, order, faces, holes = scene
    low, high, ignore, cull = limits
    det, t, b, c = hit_triangle(points, 9 * slot, 9 * slot + 3, 9 * slot + 6, shear)
    if det == 0 or (cull and det < 0) or not (low < t < high):
        return best
    own = order[slot]
    tie = TIE * abs(t)
    if own == ignore or t > best.t + tie:
        return best
    if best.slot >= 0 and t >= best.t - tie and own > order[best.slot]:
        return best
    if holes.mask.shape[0] > 0 and is_hole(own, np.float32(b), np.float32(c), faces, holes):
        return best
    return _Best(t, np.int64(slot), b, c)


@kernel(inline=True)
def _search(tree, scene, line, shear, limits, stacks):
    """Walk the tree, near child first."""
    boxes, links = tree.boxes, tree.links
    stack, entry, any_hit = stacks
    best = _Best(np.inf, np.int64(-1), 0.0, 0.0)
    first, limit = limits.low, limits.high
    size, node = 0, np.int64(1)
    if not first <= limit or _enter(boxes, node, line, first, limit) == np.inf:
        return best
    while True:
        left, right = np.int64(links[node, 0]), np.int64(links[node, 1])
        if left < 0:
            for slot in range(-left - 1, -left - 1 + right):
                best = _try(scene, slot, shear, limits, best)
            if best.slot >= 0:
                if any_hit:
                    return best
                limit = min(limit, best.t + TIE * abs(best.t))
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


@kernel()
def _trace_lane(bvh, rays, faces, holes, lane, lanes, out):
    """Every ``lanes``-th block of rays: those next to each other cost about the same, and threads get equal runs."""
    origins, directions, span, ignore, cull, any_hit = rays
    t, triangle, weights = out
    n, order, frame = origins.shape[0], bvh.order, bvh.frame
    stacks = (np.zeros(STACK, np.int32), np.zeros(STACK), any_hit)
    scene = (bvh.corners.reshape(-1), order, faces, holes)
    for block in range(lane * BLOCK, n, lanes * BLOCK):
        for r in range(block, min(n, block + BLOCK)):
            shear = shear_of(origins, directions, r, frame[SCALE])
            limits = _Limits(span[r, 0], span[r, 1], ignore[r], cull)
            line = _line(origins, directions, r, frame)
            best = _search(bvh, scene, line, shear, limits, stacks)
            t[r], triangle[r], weights[r, 0], weights[r, 1] = np.inf, -1, 0.0, 0.0
            if best.slot >= 0:
                t[r], triangle[r], weights[r, 0], weights[r, 1] = best.t, order[best.slot], best.b, best.c


@kernel(parallel=True)
def trace(bvh, rays, faces, holes):
    """Nearest (or any) hit of each ray that is not in a hole.

    Args:
        bvh: :class:`~torchrender.kernels.rays.bvh_build.Bvh`.
        rays: :class:`~torchrender.kernels.rays.watertight.Rays`.
        faces: (F,3) int32; only holes look at them.
        holes: :class:`~torchrender.kernels.raster.records.Holes`.

    Returns:
        ``t`` (N,) float64 (+inf for a miss), ``triangle`` (N,) int64 (-1) and ``weights`` (N,2) float32 of the second
        and third vertex.
    """
    n = rays.origins.shape[0]
    out = (np.empty(n), np.empty(n, np.int64), np.empty((n, 2), np.float32))
    lanes = np.int64(min((n + BLOCK - 1) // BLOCK, LANES))
    for lane in prange(lanes):
        _trace_lane(bvh, rays, faces, holes, np.int64(lane), lanes, out)
    return out
