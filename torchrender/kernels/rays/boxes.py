"""What rays need of a geometry before any tree: the scene's frame, and a padded float32 box for each triangle.

A triangle that fills little of its box is cut into slabs along its longest axis, each with a box of its own.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SCALE, LOW, HIGH = 3, 4, 7
"""Places in a frame; the centre comes first."""

MOST_PIECES = 16
_LANES = 64


@kernel(parallel=True)
def _limits(vertices, faces):
    """Smallest and largest corner of the used vertices, one row a part (64,6)."""
    count = faces.shape[0]
    part = (count + _LANES - 1) // _LANES
    out = np.zeros((_LANES, 6))
    for lane in prange(_LANES):
        x0 = y0 = z0 = np.inf
        x1 = y1 = z1 = -np.inf
        for i in range(np.int64(lane) * part, min(count, (np.int64(lane) + 1) * part)):
            for k in range(3):
                v = faces[i, k]
                x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
                x0, y0, z0, x1, y1, z1 = min(x0, x), min(y0, y), min(z0, z), max(x1, x), max(y1, y), max(z1, z)
        out[lane, 0], out[lane, 1], out[lane, 2] = x0, y0, z0
        out[lane, 3], out[lane, 4], out[lane, 5] = x1, y1, z1
    return out


def frame_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Frame (10,) of the used vertices: centre times scale, scale (a power of two), low and high corner in the frame.

    In the frame a scene lies within [-1,1]³ about its centre.
    """
    frame = np.zeros(10)
    frame[SCALE] = 1.0
    if len(faces):
        limits = _limits(vertices, faces)
        low, high = limits[:, :3].min(axis=0), limits[:, 3:].max(axis=0)
        half = float((0.5 * high - 0.5 * low).max())
        # A power of two scales without rounding.
        frame[SCALE] = 2.0 ** -int(np.clip(np.ceil(np.log2(half)), -1000, 1000)) if half > 0 else 1.0
        frame[:3] = (0.5 * low + 0.5 * high) * frame[SCALE]
        frame[LOW:HIGH], frame[HIGH:] = low * frame[SCALE] - frame[:3], high * frame[SCALE] - frame[:3]
    return frame


@kernel(inline=True)
def has_area(ux, uy, uz, vx, vy, vz):
    """Two edges of a triangle are not on one line."""
    # Scaled to one first: the products of very small edges would underflow.
    u = max(abs(ux), abs(uy), abs(uz))
    v = max(abs(vx), abs(vy), abs(vz))
    if u == 0 or v == 0:
        return False
    ux, uy, uz, vx, vy, vz = ux / u, uy / u, uz / u, vx / v, vy / v, vz / v
    # Proportional edges scale to equal numbers, so points on one line give exactly zero; thinner than any tolerance
    # are the needles that keep a mesh with coordinates of all sizes closed.
    return max(abs(uy * vz - uz * vy), abs(uz * vx - ux * vz), abs(ux * vy - uy * vx)) > 0


@kernel(parallel=True)
def measure_boxes(points, faces, pad, waste):
    """How well triangles fill their boxes.

    Args:
        points: (V,3) float64, times the frame's scale.
        faces: (F,3) int32.
        pad: boxes are larger by this on all sides.
        waste: (F,) float32, set to the root of the box's surface beyond twice the triangle's shadows along the axes;
            -1: the triangle has no area.

    Returns:
        Sums of the surfaces of boxes, of padded boxes, of doubled shadows and of ``waste``.
    """
    count = faces.shape[0]
    part = (count + _LANES - 1) // _LANES
    sums = np.zeros((_LANES, 4))
    for lane in prange(_LANES):
        surface, padded, shadows, wasted = 0.0, 0.0, 0.0, 0.0
        for i in range(np.int64(lane) * part, min(count, (np.int64(lane) + 1) * part)):
            a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
            ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
            vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
            if not has_area(ux, uy, uz, vx, vy, vz):
                waste[i] = -1.0
                continue
            x = max(0.0, ux, vx) - min(0.0, ux, vx)
            y = max(0.0, uy, vy) - min(0.0, uy, vy)
            z = max(0.0, uz, vz) - min(0.0, uz, vz)
            box = 2.0 * (x * y + y * z + z * x)
            shadow = abs(uy * vz - uz * vy) + abs(uz * vx - ux * vz) + abs(ux * vy - uy * vx)
            excess = np.sqrt(max(box - 2.0 * shadow, 0.0))
            waste[i] = excess
            surface += box
            padded += box + 8.0 * pad * (x + y + z) + 24.0 * pad * pad
            shadows += shadow
            wasted += excess
        sums[lane, 0], sums[lane, 1], sums[lane, 2], sums[lane, 3] = surface, padded, shadows, wasted
    return sums[:, 0].sum(), sums[:, 1].sum(), sums[:, 2].sum(), sums[:, 3].sum()


@kernel()
def count_pieces(waste, pieces_per_waste, first):
    """Numbers of the first piece of each triangle in ``first`` (F+1,) int32: as many as its waste asks for."""
    total = 0
    for i in range(waste.shape[0]):
        first[i] = total
        if waste[i] >= 0:
            total += 1 + int(min(waste[i] * pieces_per_waste, MOST_PIECES - 1.0))
    first[waste.shape[0]] = total


@kernel(inline=True)
def _slab(points, a, b, axis, k, start, end, low, high):
    """``low`` and ``high`` widened by what of the edge from ``a`` to ``b`` lies in the slab, along ``k``."""
    p, q, v, to = points[a, axis], points[b, axis], points[a, k], points[b, k]
    if start <= p <= end:
        low, high = min(low, v), max(high, v)
    if p < start < q or q < start < p:
        at = v + (to - v) * ((start - p) / (q - p))
        low, high = min(low, at), max(high, at)
    if p < end < q or q < end < p:
        at = v + (to - v) * ((end - p) / (q - p))
        low, high = min(low, at), max(high, at)
    return low, high


@kernel(inline=True)
def _keep(points, faces, i, frame, packed, numbers, m):
    """Write piece ``m`` of triangle ``i``: rounded corners in the frame, the triangle, where its corners start."""
    numbers[m, 9] = i
    for j in range(3):
        v = faces[i, j]
        numbers[m, 10 + j] = 3 * v
        for k in range(3):
            packed[m, 3 * j + k] = points[v, k] - frame[k]


@kernel(parallel=True)
def cut_boxes(points, faces, frame, pad, first, boxes, packed):
    """Boxes of equal slabs of each triangle, and what a hit test wants to know of each.

    Args:
        points: (V,3) float64, times the frame's scale.
        faces: (F,3) int32.
        frame: (10,) as of :func:`frame_of`.
        pad: boxes are larger by this on all sides.
        first: (F+1,) int32 first piece of each triangle.
        boxes: (M,6) float32, set to low and high corner relative to the frame.
        packed: (M,16) float32, one cache line a piece, set to the triangle's corners relative to the frame; from
            column 9 on as int32 the triangle and three times each vertex.
    """
    numbers = packed.view(np.int32)
    for i in prange(faces.shape[0]):
        begin, count = np.int64(first[i]), np.int64(first[i + 1]) - np.int64(first[i])
        a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
        if count == 1:
            _keep(points, faces, i, frame, packed, numbers, begin)
            for k in range(3):
                p, q, r = points[a, k], points[b, k], points[c, k]
                boxes[begin, k] = min(p, min(q, r)) - frame[k] - pad
                boxes[begin, 3 + k] = max(p, max(q, r)) - frame[k] + pad
            continue
        axis, size, origin = 0, -1.0, 0.0
        for k in range(3):
            p, q, r = points[a, k], points[b, k], points[c, k]
            low, high = min(p, min(q, r)), max(p, max(q, r))
            if high - low > size:
                axis, size, origin = k, high - low, low
        for s in range(count):
            m = begin + s
            _keep(points, faces, i, frame, packed, numbers, m)
            start = origin + size * (s / count) if s > 0 else -np.inf
            end = origin + size * ((s + 1) / count) if s < count - 1 else np.inf
            for k in range(3):
                low, high = np.inf, -np.inf
                low, high = _slab(points, a, b, axis, k, start, end, low, high)
                low, high = _slab(points, b, c, axis, k, start, end, low, high)
                low, high = _slab(points, c, a, axis, k, start, end, low, high)
                boxes[m, k], boxes[m, 3 + k] = low - frame[k] - pad, high - frame[k] + pad
