"""Bounding volume hierarchy over triangles: Morton-ordered subtrees, each split by a binned surface area heuristic.

Source: Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007. No recursion, and a bounded depth
whatever the geometry.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.boxes import HIGH, LOW, SCALE, frame_of, has_area

STACK = 128
"""Entries that a walk through the tree needs at most."""

_LEAF = 4
_BINS = 12
_SUBTREES = 16
_SAH_DEPTH = 64  # below it splits are medians, so that depth stays under STACK
_PAD = 3e-7  # of the scene's half extent: covers rounding boxes to float32 and a ray's origin far outside


class Bvh(NamedTuple):
    """A tree over the T triangles with an area; node 1 is the root."""

    boxes: np.ndarray  # (M,6) float32 low and high corner, relative to the frame
    links: np.ndarray  # (M,2) int32 children; leaf: -(first slot + 1), number of slots
    order: np.ndarray  # (T,) int32 triangle id of each slot
    corners: np.ndarray  # (T,9) float64 vertices of each slot, times the frame's scale
    frame: np.ndarray  # (10,) float64 centre times scale, scale (a power of two), low and high corner of the scene


def build_bvh(vertices: np.ndarray, faces: np.ndarray) -> Bvh:
    """Tree over triangles; those without area are left out. ``vertices`` (V,3) float64, ``faces`` (F,3) int32."""
    frame = frame_of(vertices, faces)
    corners, keep = np.empty((len(faces), 9)), np.empty(len(faces), np.bool_)
    _gather(vertices, faces, frame[SCALE], corners, keep)
    order = np.flatnonzero(keep).astype(np.int32)
    boxes, codes = _triangle_boxes(corners, order, frame)
    slots = _sorted_order(codes)
    subtrees = _SUBTREES if len(order) >= 256 * _SUBTREES else 1
    nodes, links = _build(boxes, slots, subtrees)
    ordered = np.empty((len(order), 9))
    order = _reorder(corners, order, slots, ordered)
    return Bvh(nodes, links, order, ordered, frame)


@kernel(parallel=True)
def _gather(vertices, faces, scale, corners, keep):
    """Corners (F,9) of each triangle times ``scale``, and whether it has an area."""
    for i in prange(faces.shape[0]):
        for j in range(3):
            v = faces[i, j]
            for k in range(3):
                corners[i, 3 * j + k] = vertices[v, k] * scale
        c = corners[i]
        keep[i] = has_area(c[3] - c[0], c[4] - c[1], c[5] - c[2], c[6] - c[0], c[7] - c[1], c[8] - c[2])


@kernel(parallel=True)
def _reorder(corners, order, slots, out):
    """Corners in the order of the slots; returns the triangle of each slot."""
    triangles = np.empty(slots.size, np.int32)
    for i in prange(slots.size):
        t = order[slots[i]]
        triangles[i] = t
        for k in range(9):
            out[i, k] = corners[t, k]
    return triangles


@kernel()
def _spread(x):
    """Ten bits with two zeros between each."""
    x = (x | (x << 16)) & 0x030000FF
    x = (x | (x << 8)) & 0x0300F00F
    x = (x | (x << 4)) & 0x030C30C3
    return (x | (x << 2)) & 0x09249249


@kernel(parallel=True)
def _triangle_boxes(corners, order, frame):
    boxes = np.zeros((order.size, 6), np.float32)
    codes = np.zeros(order.size, np.int64)
    for i in prange(order.size):
        c = corners[order[i]]
        code = np.int64(0)
        for k in range(3):
            low = min(c[k], c[k + 3], c[k + 6]) - frame[k]
            high = max(c[k], c[k + 3], c[k + 6]) - frame[k]
            boxes[i, k] = low - _PAD
            boxes[i, k + 3] = high + _PAD
            size = max(frame[HIGH + k] - frame[LOW + k], 1e-30)
            cell = np.int64((0.5 * (low + high) - frame[LOW + k]) / size * 1023.999)
            code |= _spread(min(max(cell, 0), 1023)) << (2 - k)
        codes[i] = code
    return boxes, codes


@kernel()
def _sorted_order(codes):
    """Stable order of 30-bit codes: three passes of a radix sort."""
    n = codes.size
    order = np.arange(n).astype(np.int32)
    other = np.zeros(n, np.int32)
    for shift in range(0, 30, 10):
        start = np.zeros(1025, np.int64)
        for i in range(n):
            start[((codes[i] >> shift) & 1023) + 1] += 1
        for i in range(1024):
            start[i + 1] += start[i]
        for i in range(n):
            k = (codes[order[i]] >> shift) & 1023
            other[start[k]] = order[i]
            start[k] += 1
        order, other = other, order
    return order


@kernel()
def _bounds(boxes, slots, first, end, bound):
    """Box of a run of triangles in ``bound[:6]`` and of their doubled centres in ``bound[6:]``."""
    for k in range(3):
        bound[k] = bound[k + 6] = np.inf
        bound[k + 3] = bound[k + 9] = -np.inf
    for i in range(first, end):
        b = boxes[slots[i]]
        for k in range(3):
            bound[k] = min(bound[k], b[k])
            bound[k + 3] = max(bound[k + 3], b[k + 3])
            c = b[k] + b[k + 3]
            bound[k + 6] = min(bound[k + 6], c)
            bound[k + 9] = max(bound[k + 9], c)


@kernel()
def _bin_of(boxes, i, axis, low, scale):
    return min(int((np.float64(boxes[i, axis] + boxes[i, axis + 3]) - low) * scale), _BINS - 1)


@kernel()
def _grow(box, other):
    for k in range(3):
        box[k] = min(box[k], other[k])
        box[k + 3] = max(box[k + 3], other[k + 3])
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x


@kernel()
def _best_bin(bins, count):
    """Last bin of the left side with the smallest expected cost, or -1."""
    right = np.zeros(_BINS)
    box = np.array([np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf])
    n = 0
    for i in range(_BINS - 1, 0, -1):
        n += count[i]
        if count[i] > 0:
            area = _grow(box, bins[i])
        right[i] = area * n if n > 0 else -1.0
    box[:3], box[3:] = np.inf, -np.inf
    n, best, cost = 0, -1, np.inf
    for i in range(_BINS - 1):
        n += count[i]
        if count[i] > 0:
            area = _grow(box, bins[i])
        if n > 0 and right[i + 1] >= 0 and area * n + right[i + 1] < cost:
            cost = area * n + right[i + 1]
            best = i
    return best


@kernel()
def _split(boxes, slots, first, end, bound):
    """Partition a run in place by the surface area heuristic; the middle where centres coincide."""
    axis = 0
    for k in range(1, 3):
        if bound[9 + k] - bound[6 + k] > bound[9 + axis] - bound[6 + axis]:
            axis = k
    low = np.float64(bound[6 + axis])
    size = bound[9 + axis] - low
    middle = (first + end) // 2
    if not size > 0:
        return middle
    scale = _BINS / size
    bins = np.zeros((_BINS, 6))
    bins[:, :3], bins[:, 3:] = np.inf, -np.inf
    count = np.zeros(_BINS, np.int64)
    for i in range(first, end):
        k = _bin_of(boxes, slots[i], axis, low, scale)
        count[k] += 1
        for j in range(3):
            bins[k, j] = min(bins[k, j], boxes[slots[i], j])
            bins[k, j + 3] = max(bins[k, j + 3], boxes[slots[i], j + 3])
    best = _best_bin(bins, count)
    if best < 0:
        return middle
    i, j = first, end - 1
    while i <= j:
        s = slots[i]
        if _bin_of(boxes, s, axis, low, scale) <= best:
            i += 1
        else:
            slots[i], slots[j] = slots[j], s
            j -= 1
    return i


@kernel()
def _build_range(boxes, slots, first, end, nodes, links, base):
    """Subtree over ``slots[first:end]`` in nodes from ``base`` on; a left child follows its parent."""
    stack = np.zeros((STACK, 4), np.int64)
    stack[0] = (first, end, -1, 0)
    size, node = 1, base
    bound = np.zeros(12)
    while size > 0:
        size -= 1
        a, b, parent, depth = stack[size]
        _bounds(boxes, slots, a, b, bound)
        nodes[node] = bound[:6]
        if parent >= 0:
            links[parent, 1] = node
        if b - a <= _LEAF:
            links[node] = (-(a + 1), b - a)
        else:
            middle = _split(boxes, slots, a, b, bound) if depth < _SAH_DEPTH else (a + b) // 2
            links[node, 0] = node + 1
            stack[size] = (middle, b, node, depth + 1)
            stack[size + 1] = (a, middle, -1, depth + 1)
            size += 2
        node += 1


@kernel(parallel=True)
def _build(boxes, slots, subtrees):
    """Subtrees over equal parts of the Morton order, side by side, under a balanced tree; reorders ``slots``."""
    part = (slots.size + subtrees - 1) // subtrees
    room = 2 * part + 1
    nodes = np.zeros((subtrees + subtrees * room, 6), np.float32)
    links = np.zeros((subtrees + subtrees * room, 2), np.int32)
    for s in prange(subtrees):
        k = np.int64(s)
        end = min(slots.size, (k + 1) * part)
        _build_range(boxes, slots, min(k * part, end), end, nodes, links, subtrees + k * room)
    at = np.zeros(2 * subtrees, np.int32)
    for i in range(subtrees):
        at[subtrees + i] = subtrees + i * room
    for i in range(subtrees - 1, 0, -1):
        at[i] = i
        left, right = at[2 * i], at[2 * i + 1]
        links[i] = (left, right)
        for j in range(3):
            nodes[i, j] = min(nodes[left, j], nodes[right, j])
            nodes[i, j + 3] = max(nodes[left, j + 3], nodes[right, j + 3])
    return nodes, links
