"""What rays need of a geometry before any tree: the scene's frame, and padded float32 boxes of a few triangles each.

Triangles that follow each other share a box where that makes no larger target for rays. What fills little of its box is
cut into slabs along its longest axis, each with a box of its own.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SCALE, LOW, HIGH = 3, 4, 7
"""Places in a frame; the centre comes first."""

WIDE = 4
"""Triangles of a group at most."""
LINE = 10 * WIDE
"""Numbers that describe a group, five cache lines: nine coordinates and the id of each triangle, side by side."""
IDS = 9 * WIDE
"""Where the ids begin, as int64."""
MOST_PIECES = 16

_LANES = 64
_COARSE = 3.0  # padding adds so many times the surface of a box
_JOIN = 1.2  # a shared box has at most so much of the surface of the boxes it replaces


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


@kernel(inline=True)
def _edges(points, faces, i):
    a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    return ux, uy, uz, vx, vy, vz


@kernel(inline=True)
def _half_surface(x0, y0, z0, x1, y1, z1):
    x, y, z = x1 - x0, y1 - y0, z1 - z0
    return x * y + y * z + z * x


@kernel(inline=True)
def _box(points, faces, i):
    a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
    px, py, pz = points[a, 0], points[a, 1], points[a, 2]
    qx, qy, qz = points[b, 0], points[b, 1], points[b, 2]
    rx, ry, rz = points[c, 0], points[c, 1], points[c, 2]
    return (
        min(px, min(qx, rx)),
        min(py, min(qy, ry)),
        min(pz, min(qz, rz)),
        max(px, max(qx, rx)),
        max(py, max(qy, ry)),
        max(pz, max(qz, rz)),
    )


@kernel()
def _group_part(points, faces, begin, end, starts):
    """Starts of groups among the triangles ``begin`` to ``end``; returns their number."""
    groups, members, surface = 0, WIDE, 0.0
    x0 = y0 = z0 = x1 = y1 = z1 = 0.0
    for i in range(begin, end):
        ux, uy, uz, vx, vy, vz = _edges(points, faces, i)
        if not has_area(ux, uy, uz, vx, vy, vz):
            continue
        p0, q0, r0, p1, q1, r1 = _box(points, faces, i)
        own = _half_surface(p0, q0, r0, p1, q1, r1)
        if members < WIDE:
            u0, v0, w0, u1, v1, w1 = min(x0, p0), min(y0, q0), min(z0, r0), max(x1, p1), max(y1, q1), max(z1, r1)
            joint = _half_surface(u0, v0, w0, u1, v1, w1)
            if joint <= _JOIN * (surface + own):
                x0, y0, z0, x1, y1, z1, surface = u0, v0, w0, u1, v1, w1, joint
                members += 1
                continue
        starts[begin + groups] = i
        x0, y0, z0, x1, y1, z1, surface, members = p0, q0, r0, p1, q1, r1, own, 1
        groups += 1
    return groups


@kernel(parallel=True)
def group_triangles(points, faces, starts):
    """Runs of up to ``WIDE`` triangles that share a box; those without area are in none.

    Args:
        points: (V,3) float64, times the frame's scale.
        faces: (F,3) int32.
        starts: (F,) int32, set to the first triangle of each group, from the start of each of 64 parts on.

    Returns:
        (65,) int64 number of the first group of each part.
    """
    count = faces.shape[0]
    part = (count + _LANES - 1) // _LANES
    first = np.zeros(_LANES + 1, np.int64)
    for lane in prange(_LANES):
        k = np.int64(lane)
        first[k + 1] = _group_part(points, faces, min(k * part, count), min(count, (k + 1) * part), starts)
    for part_before in range(_LANES):
        first[part_before + 1] += first[part_before]
    return first


@kernel()
def _pack_part(geometry, begin, end, starts, first, packed, waste, pad):
    """Pack the groups of one part; returns the sums of :func:`pack_groups`."""
    points, faces = geometry
    numbers = packed.view(np.int64)
    surface, coarse, shadows, wasted = 0.0, 0.0, 0.0, 0.0
    for n in range(first[0], first[1]):
        i = starts[begin + n - first[0]]
        stop = starts[begin + n + 1 - first[0]] if n + 1 < first[1] else end
        x0, y0, z0, x1, y1, z1 = _box(points, faces, i)
        shadow, members = 0.0, 0
        for t in range(i, stop):
            ux, uy, uz, vx, vy, vz = _edges(points, faces, t)
            if not has_area(ux, uy, uz, vx, vy, vz):
                continue
            p0, q0, r0, p1, q1, r1 = _box(points, faces, t)
            x0, y0, z0, x1, y1, z1 = min(x0, p0), min(y0, q0), min(z0, r0), max(x1, p1), max(y1, q1), max(z1, r1)
            shadow += abs(uy * vz - uz * vy) + abs(uz * vx - ux * vz) + abs(ux * vy - uy * vx)
            for q in range(members, WIDE):  # places without a triangle repeat the last one
                numbers[n, IDS + q] = t if q == members else -1
                for j in range(3):
                    for k in range(3):
                        packed[n, (3 * j + k) * WIDE + q] = points[faces[t, j], k]
            members += 1
        x, y, z = x1 - x0, y1 - y0, z1 - z0
        box = 2.0 * (x * y + y * z + z * x)
        excess = np.sqrt(max(box - 2.0 * shadow, 0.0))
        waste[n] = excess
        surface += box
        coarse += 8.0 * pad * (x + y + z) + 24.0 * pad * pad > _COARSE * box
        shadows += min(shadow, 0.5 * box)
        wasted += excess
    return surface, coarse, shadows, wasted


@kernel(parallel=True)
def pack_groups(geometry, starts, first, packed, waste, pad):
    """What a hit test wants to know of each group, and how well groups fill their boxes.

    Args:
        geometry: (points, faces) as of :func:`group_triangles`.
        starts, first: as of :func:`group_triangles`.
        packed: (G,LINE) float64, set to the corners, and from column ``IDS`` on to int64 triangles or -1.
        waste: (G,) float32, set to the root of the box's surface beyond twice the shadows along the axes.
        pad: boxes are larger by this on all sides.

    Returns:
        (64,4) of each part: sum of the surfaces of boxes, number of boxes that are mostly padding, sums of shadows and
        of ``waste``. Summed up by whoever calls: four sums cost a second of compiling.
    """
    count = geometry[1].shape[0]
    part = (count + _LANES - 1) // _LANES
    sums = np.zeros((_LANES, 4))
    for lane in prange(_LANES):
        k = np.int64(lane)
        a, b, c, d = _pack_part(
            geometry, min(k * part, count), min(count, (k + 1) * part), starts, first[k : k + 2], packed, waste, pad
        )
        sums[k, 0], sums[k, 1], sums[k, 2], sums[k, 3] = a, b, c, d
    return sums


@kernel()
def count_pieces(waste, pieces_per_waste, first):
    """Numbers of the first piece of each group in ``first`` (G+1,) int32: as many as its waste asks for."""
    total = 0
    for i in range(waste.shape[0]):
        first[i] = total
        total += 1 + int(min(waste[i] * pieces_per_waste, MOST_PIECES - 1.0))
    first[waste.shape[0]] = total


@kernel(inline=True)
def _slab(corners, q, axis, k, start, end):
    """Range of coordinate ``k`` of what of triangle ``q`` lies between ``start`` and ``end`` along ``axis``."""
    low, high = np.inf, -np.inf
    for j in range(3):
        n = (j + 1) % 3
        p, r = corners[(3 * j + axis) * WIDE + q], corners[(3 * n + axis) * WIDE + q]
        v, to = corners[(3 * j + k) * WIDE + q], corners[(3 * n + k) * WIDE + q]
        if start <= p <= end:
            low, high = min(low, v), max(high, v)
        if p < start < r or r < start < p:
            at = v + (to - v) * ((start - p) / (r - p))
            low, high = min(low, at), max(high, at)
        if p < end < r or r < end < p:
            at = v + (to - v) * ((end - p) / (r - p))
            low, high = min(low, at), max(high, at)
    return low, high


@kernel()
def _cut(corners, frame, boxes, owner, n, pad):
    """Boxes of the slabs of one group."""
    count = owner.shape[0]
    axis, size, origin = 0, -1.0, 0.0
    for k in range(3):
        low, high = np.inf, -np.inf
        for j in range(3):
            for q in range(WIDE):
                p = corners[(3 * j + k) * WIDE + q]
                low, high = min(low, p), max(high, p)
        boxes[0, k], boxes[0, 3 + k] = low - frame[k] - pad, high - frame[k] + pad
        if high - low > size:
            axis, size, origin = k, high - low, low
    owner[0] = n
    if count == 1:
        return
    for s in range(count):
        owner[s] = n
        start = origin + size * (s / count) if s > 0 else -np.inf
        end = origin + size * ((s + 1) / count) if s < count - 1 else np.inf
        for k in range(3):
            low, high = np.inf, -np.inf
            for q in range(WIDE):
                least, most = _slab(corners, q, axis, k, start, end)
                low, high = min(low, least), max(high, most)
            boxes[s, k], boxes[s, 3 + k] = low - frame[k] - pad, high - frame[k] + pad


@kernel(parallel=True)
def cut_boxes(packed, frame, first, pad, boxes, owner):
    """Boxes of the equal slabs of each group along its longest axis.

    Args:
        packed: (G,LINE) float64 as of :func:`pack_groups`.
        frame: (10,) as of :func:`frame_of`.
        first: (G+1,) int32 first piece of each group.
        pad: boxes are larger by this on all sides.
        boxes: (M,6) float32, set to low and high corner relative to the frame; an empty slab has NaN or low > high.
        owner: (M,) int32, set to the group.
    """
    for i in prange(packed.shape[0]):
        begin, end = np.int64(first[i]), np.int64(first[i + 1])
        _cut(packed[i], frame, boxes[begin:end], owner[begin:end], np.int64(i), pad)
