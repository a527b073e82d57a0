"""What of a picture a light can reach at all, cast shadows apart: by tile, by light, and where it stands in its image.

Nothing here decides visibility. A point counts if it may take light and the light lies before its surface, in range and
inside the cone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

PARALLEL, POINT, SPOT, RECTANGLE = 0, 1, 2, 3
"""Kinds of lights."""

LOW_A, HIGH_A, LOW_B, HIGH_B, LOW_Z, HIGH_Z, COUNT = 0, 1, 2, 3, 4, 5, 6
"""Places in a row of :func:`bound_receivers`."""

_ROUNDING = 1e-9  # of lengths
_PARTS = 16
_BLOCK = 1024


class Points(NamedTuple):
    """The surfaces of one picture."""

    position: np.ndarray  # (H,W,3) float64
    normal: np.ndarray  # (H,W,3) float32, towards the viewer; zero: no surface
    depth: np.ndarray  # (H,W) float32 camera z
    takes: np.ndarray  # (H,W) bool: the material is not black


class Lamps(NamedTuple):
    """L lights."""

    kind: np.ndarray  # (L,) int64
    place: np.ndarray  # (L,3) float64 position; of parallel light the direction it comes from; a rectangle's corner
    axis: np.ndarray  # (L,3) float64 a spot's direction, a rectangle's normal
    reach: np.ndarray  # (L,) float64 range, scene units; +inf
    cosine: np.ndarray  # (L,) float64 of a spot's half angle
    edges: np.ndarray  # (L,2,3) float64 of a rectangle


@kernel(inline=True)
def _before(lamps, i, x, y, z, nx, ny, nz):
    """A light, or a corner of it, lies before the surface at (x, y, z)."""
    place, edges = lamps.place, lamps.edges
    if lamps.kind[i] == PARALLEL:
        return nx * place[i, 0] + ny * place[i, 1] + nz * place[i, 2] > 0.0
    height = nx * (place[i, 0] - x) + ny * (place[i, 1] - y) + nz * (place[i, 2] - z)
    if lamps.kind[i] == RECTANGLE:
        u = nx * edges[i, 0, 0] + ny * edges[i, 0, 1] + nz * edges[i, 0, 2]
        v = nx * edges[i, 1, 0] + ny * edges[i, 1, 1] + nz * edges[i, 1, 2]
        height += max(u, 0.0) + max(v, 0.0)
    return height > 0.0


@kernel(inline=True)
def _sends(lamps, i, x, y, z):
    """A light sends something towards a point: range, cone, side of a rectangle."""
    kind = lamps.kind[i]
    if kind == PARALLEL:
        return True
    dx, dy, dz = x - lamps.place[i, 0], y - lamps.place[i, 1], z - lamps.place[i, 2]
    square = dx * dx + dy * dy + dz * dz
    if kind != RECTANGLE and square > lamps.reach[i] * lamps.reach[i]:
        return False
    if kind == POINT:
        return True
    along = dx * lamps.axis[i, 0] + dy * lamps.axis[i, 1] + dz * lamps.axis[i, 2]
    if kind == RECTANGLE:
        return along > 0.0
    return along >= lamps.cosine[i] * math.sqrt(square)


@kernel(inline=True)
def _takes(points, row, column, lamps, i):
    """The surface of a pixel may take light of a lamp."""
    if not points.takes[row, column]:
        return False
    nx = np.float64(points.normal[row, column, 0])
    ny = np.float64(points.normal[row, column, 1])
    nz = np.float64(points.normal[row, column, 2])
    x, y, z = points.position[row, column, 0], points.position[row, column, 1], points.position[row, column, 2]
    if nx == 0.0 and ny == 0.0 and nz == 0.0:
        return False
    return _before(lamps, i, x, y, z, nx, ny, nz) and _sends(lamps, i, x, y, z)


@kernel(inline=True)
def _box_takes(box, lamps, i):
    """A light may send something into a box (6,): smallest and largest corner. Errs on the side of yes."""
    kind = lamps.kind[i]
    if kind == PARALLEL:
        return True
    square = radius2 = along = 0.0
    for k in range(3):
        near = max(box[k] - lamps.place[i, k], lamps.place[i, k] - box[3 + k], 0.0)
        square += near * near
        half = 0.5 * (box[3 + k] - box[k])
        radius2 += half * half
        along += (0.5 * (box[k] + box[3 + k]) - lamps.place[i, k]) * lamps.axis[i, k]
    if kind == RECTANGLE:
        return along + math.sqrt(radius2) > 0.0
    if square > lamps.reach[i] * lamps.reach[i]:
        return False
    if kind == POINT:
        return True
    # The sphere around the box against the cone: distance of its centre from the cone's surface.
    away2 = 0.0
    for k in range(3):
        d = 0.5 * (box[k] + box[3 + k]) - lamps.place[i, k]
        away2 += d * d
    across = math.sqrt(max(away2 - along * along, 0.0))
    sine = math.sqrt(max(1.0 - lamps.cosine[i] * lamps.cosine[i], 0.0))
    return across * lamps.cosine[i] - along * sine <= math.sqrt(radius2) * (1.0 + 1e-9)


@kernel(inline=True)
def _box_faces(box, lamps, i):
    """Some surface of a box, with normals in another (smallest and largest corner each), may face a light."""
    top = size = 0.0
    for k in range(3):
        low = high = lamps.place[i, k]
        if lamps.kind[i] == RECTANGLE:
            for e in range(2):
                low += min(lamps.edges[i, e, k], 0.0)
                high += max(lamps.edges[i, e, k], 0.0)
        if lamps.kind[i] != PARALLEL:
            low, high = low - box[3 + k], high - box[k]
        a, b = box[6 + k], box[9 + k]
        top += max(max(a * low, a * high), max(b * low, b * high))
        size += max(abs(low), abs(high))
    return top > -_ROUNDING * size


@kernel(inline=True)
def _tile_box(points, tile, side, box):
    """The box around the surfaces of a tile, in ``box`` (12,), then that of their normals.

    False if there are none that take light.
    """
    height, width = points.takes.shape
    columns = (width + side - 1) // side
    top, left = (tile // columns) * side, (tile % columns) * side
    any_point = False
    for k in range(3):
        box[k], box[3 + k], box[6 + k], box[9 + k] = np.inf, -np.inf, np.inf, -np.inf
    for row in range(top, min(top + side, height)):
        for column in range(left, min(left + side, width)):
            if points.takes[row, column]:
                any_point = True
                for k in range(3):
                    box[k] = min(box[k], points.position[row, column, k])
                    box[3 + k] = max(box[3 + k], points.position[row, column, k])
                    box[6 + k] = min(box[6 + k], np.float64(points.normal[row, column, k]))
                    box[9 + k] = max(box[9 + k], np.float64(points.normal[row, column, k]))
    return any_point


@kernel(parallel=True)
def mark_tiles(points, lamps, side, threads, marks):
    """Which lights reach which tiles of ``side`` x ``side`` pixels.

    Args:
        points: :class:`Points` of one picture.
        lamps: :class:`Lamps`.
        threads: workers.
        marks: (T,L) bool, written: some pixel of the tile may take light of the lamp; tiles row by row.
    """
    tiles, count = marks.shape
    height, width = points.takes.shape
    columns = (width + side - 1) // side
    for worker in prange(threads):
        box = np.zeros(12)
        for tile in range(np.int64(worker), tiles, threads):
            filled = _tile_box(points, tile, side, box)
            top, left = (tile // columns) * side, (tile % columns) * side
            for i in range(count):
                found = False
                if filled and _box_faces(box, lamps, i) and _box_takes(box, lamps, i):
                    for row in range(top, min(top + side, height)):
                        for column in range(left, min(left + side, width)):
                            if _takes(points, row, column, lamps, i):
                                found = True
                                break
                        if found:
                            break
                marks[tile, i] = found


@kernel(parallel=True)
def bound_receivers(points, lamps, i, frames, orthographic, first, table):
    """Where the receivers of one light stand in its images, by their distance from the eye.

    Args:
        points: :class:`Points` of one picture.
        lamps, i: the lights and the number of one.
        frames: (F,12) float64 world-to-view matrices; a point belongs to the view that it lies in front of most.
        orthographic: image coordinates a, b are x, y; else x/z, y/z.
        first: number of the first step of the eye's depth; steps are factors of sqrt(2).
        table: (16,F,N,7) written: LOW_A to COUNT of each part of the work, view and step. The last step is open.
    """
    height, width = points.takes.shape
    parts, views, steps = table.shape[0], table.shape[1], table.shape[2]
    total = height * width
    block = np.int64(min(max(total // (4 * parts), 1), _BLOCK))
    for part in prange(parts):
        for f in range(views):
            for n in range(steps):
                for k in range(3):
                    table[part, f, n, 2 * k], table[part, f, n, 2 * k + 1] = np.inf, -np.inf
                table[part, f, n, COUNT] = 0.0
        for start in range(np.int64(part) * block, total, parts * block):
            for at in range(start, min(start + block, total)):
                row, column = at // width, at % width
                if not _takes(points, row, column, lamps, i):
                    continue
                x, y, z = (
                    points.position[row, column, 0],
                    points.position[row, column, 1],
                    points.position[row, column, 2],
                )
                view, deepest, a, b = 0, -np.inf, 0.0, 0.0
                for f in range(views):
                    depth = frames[f, 8] * x + frames[f, 9] * y + frames[f, 10] * z + frames[f, 11]
                    if depth > deepest:
                        view, deepest = f, depth
                a = frames[view, 0] * x + frames[view, 1] * y + frames[view, 2] * z + frames[view, 3]
                b = frames[view, 4] * x + frames[view, 5] * y + frames[view, 6] * z + frames[view, 7]
                if not orthographic:
                    if deepest <= 0.0:
                        continue
                    a, b = a / deepest, b / deepest
                step = 0
                distance = np.float64(points.depth[row, column])
                if distance > 0.0:
                    step = min(max(np.int64(math.floor(2.0 * math.log2(distance))) - first, 0), steps - 1)
                cell = table[part, view, step]
                cell[LOW_A], cell[HIGH_A] = min(cell[LOW_A], a), max(cell[HIGH_A], a)
                cell[LOW_B], cell[HIGH_B] = min(cell[LOW_B], b), max(cell[HIGH_B], b)
                cell[LOW_Z], cell[HIGH_Z] = min(cell[LOW_Z], deepest), max(cell[HIGH_Z], deepest)
                cell[COUNT] += 1.0
