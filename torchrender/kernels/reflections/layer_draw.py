"""Depth images with several layers, many small ones at once: what the cameras of clusters see, and what lies behind.

Triangles are drawn in homogeneous coordinates (Olano and Greer 1997): a texel's ray meets a triangle if it lies on one
side of its three edge planes, so nothing is clipped. Every texel keeps the triangles nearest to the camera, sorted by
depth; surfaces that lie together keep one place. Threads share the cameras.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.fragments import is_hole
from torchrender.kernels.raster.records import Holes

TOGETHER = 1e-6  # relative difference in depth of surfaces that count as one
PIXELS_PER_CELL = 4.0
HALF = 0.5


class LayerViews(NamedTuple):
    """C perspective cameras whose images lie one after the other."""

    eye: np.ndarray  # (C,3) float64
    look: np.ndarray  # (C,3,3) float64 right, down and view axis
    box: np.ndarray  # (C,4) float64 low x, low y, high x, high y in tangents
    size: np.ndarray  # (C,2) int64 columns and rows
    near: np.ndarray  # (C,) float64
    first: np.ndarray  # (C,) int64 first texel


class Layers(NamedTuple):
    """Their texels, K layers each, from near to far."""

    depth: np.ndarray  # (T,K) float32, +inf where nothing is left
    triangle: np.ndarray  # (T,K) int32, -1


class Boxes(NamedTuple):
    """Triangles in groups."""

    order: np.ndarray  # (F,) int32 triangle ids, group by group
    runs: np.ndarray  # (G,2) int64 first and end in ``order``
    bounds: np.ndarray  # (G,2,3) float64


class Seen(NamedTuple):
    """What each camera looks from behind: the pixels of its cluster."""

    starts: np.ndarray  # (C+1,) int64
    order: np.ndarray  # (N,) int64
    position: np.ndarray  # (N,3) float64


@kernel(inline=True)
def box_outside(bounds, g, eye, look, box, near, c):
    """A box of triangles cannot be seen by camera ``c``: it lies beyond one plane of its frustum."""
    mx, my, mz = 0.0, 0.0, 0.0
    hx, hy, hz = 0.0, 0.0, 0.0
    for k in range(3):
        middle = (bounds[g, 0, k] + bounds[g, 1, k]) * HALF - eye[c, k]
        half = (bounds[g, 1, k] - bounds[g, 0, k]) * HALF
        mx += look[c, 0, k] * middle
        my += look[c, 1, k] * middle
        mz += look[c, 2, k] * middle
        hx += abs(look[c, 0, k] - box[c, 0] * look[c, 2, k]) * half
        hy += abs(look[c, 1, k] - box[c, 1] * look[c, 2, k]) * half
        hz += abs(look[c, 2, k]) * half
    if mz + hz <= near[c]:
        return True
    if mx - box[c, 0] * mz + hx < 0.0 or my - box[c, 1] * mz + hy < 0.0:
        return True
    hx, hy = 0.0, 0.0
    for k in range(3):
        half = (bounds[g, 1, k] - bounds[g, 0, k]) * HALF
        hx += abs(look[c, 0, k] - box[c, 2] * look[c, 2, k]) * half
        hy += abs(look[c, 1, k] - box[c, 3] * look[c, 2, k]) * half
    return mx - box[c, 2] * mz - hx > 0.0 or my - box[c, 3] * mz - hy > 0.0


@kernel(inline=True)
def unmarked(bounds, g, views, c, marks):
    """No ray passes where a box of triangles may be seen: ``marks`` = (texels a side of a block, first block of each
    image, blocks)."""
    eye, look, box, size, near, _ = views
    texels, places, blocks = marks
    low_u, low_v, high_u, high_v = math.inf, math.inf, -math.inf, -math.inf
    for corner in range(8):
        x = bounds[g, corner & 1, 0] - eye[c, 0]
        y = bounds[g, (corner >> 1) & 1, 1] - eye[c, 1]
        z = bounds[g, corner >> 2, 2] - eye[c, 2]
        depth = look[c, 2, 0] * x + look[c, 2, 1] * y + look[c, 2, 2] * z
        if depth <= near[c]:
            return False
        u = (look[c, 0, 0] * x + look[c, 0, 1] * y + look[c, 0, 2] * z) / depth
        v = (look[c, 1, 0] * x + look[c, 1, 1] * y + look[c, 1, 2] * z) / depth
        low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
    columns, rows = size[c, 0], size[c, 1]
    across, down = (columns + texels - 1) // texels, (rows + texels - 1) // texels
    du, dv = columns / (box[c, 2] - box[c, 0]) / texels, rows / (box[c, 3] - box[c, 1]) / texels
    x0, x1 = np.int64(max((low_u - box[c, 0]) * du, 0.0)), np.int64(min((high_u - box[c, 0]) * du, across - 1.0))
    y0, y1 = np.int64(max((low_v - box[c, 1]) * dv, 0.0)), np.int64(min((high_v - box[c, 1]) * dv, down - 1.0))
    for j in range(y0, y1 + 1):
        for i in range(x0, x1 + 1):
            if blocks[places[c] + j * across + i] != 0:
                return False
    return True


@kernel(inline=True)
def to_camera(vertices, v, eye, look, c):
    """A vertex in the frame of camera ``c``."""
    x, y, z = vertices[v, 0] - eye[c, 0], vertices[v, 1] - eye[c, 1], vertices[v, 2] - eye[c, 2]
    return (
        look[c, 0, 0] * x + look[c, 0, 1] * y + look[c, 0, 2] * z,
        look[c, 1, 0] * x + look[c, 1, 1] * y + look[c, 1, 2] * z,
        look[c, 2, 0] * x + look[c, 2, 1] * y + look[c, 2, 2] * z,
    )


@kernel(inline=True)
def cross(a, b):
    """Cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel(inline=True)
def keep(depth, triangle, texel, z, number):
    """Put a surface into its place among the layers of a texel; the farthest falls out."""
    count = depth.shape[1]
    place = count
    for k in range(count):
        if z < depth[texel, k] * (1.0 + TOGETHER):
            place = k
            break
    if place == count or z > depth[texel, place] * (1.0 - TOGETHER):
        return
    for k in range(count - 1, place, -1):
        depth[texel, k], triangle[texel, k] = depth[texel, k - 1], triangle[texel, k - 1]
    depth[texel, place], triangle[texel, place] = np.float32(z), np.int32(number)


@kernel(inline=True)
def span(low, high, first, step, count):
    """First and one-past-last of ``count`` texel centres ``first + (i + 0.5) step`` in [low, high]."""
    begin = math.ceil((low - first) / step - HALF - 1e-9)
    end = math.floor((high - first) / step - HALF + 1e-9) + 1.0
    return np.int64(max(begin, 0.0)), np.int64(min(end, np.float64(count)))


@kernel(inline=True)
def draw_triangle(a, b, c, view, near, floor, layers, own):
    """Draw one triangle given in camera coordinates. ``view`` = (low x, low y, step x, step y, columns, rows, first);
    ``own`` = (triangle id, faces, holes)."""
    depth, triangle = layers
    number, faces, holes = own
    holed = holes.mask.shape[0] > 0
    x0, y0, dx, dy, columns, rows, first = view
    if max(a[2], b[2], c[2]) <= near:
        return
    low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
    for p, q in ((a, b), (b, c), (c, a)):
        if p[2] > near:
            low_x, high_x = min(low_x, p[0] / p[2]), max(high_x, p[0] / p[2])
            low_y, high_y = min(low_y, p[1] / p[2]), max(high_y, p[1] / p[2])
        if (p[2] > near) != (q[2] > near):  # where the edge meets the near plane
            share = (near - p[2]) / (q[2] - p[2])
            x, y = (p[0] + share * (q[0] - p[0])) / near, (p[1] + share * (q[1] - p[1])) / near
            low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    i0, i1 = span(low_x, high_x, x0, dx, columns)
    j0, j1 = span(low_y, high_y, y0, dy, rows)
    if i0 >= i1 or j0 >= j1:
        return
    n0, n1, n2 = cross(b, c), cross(c, a), cross(a, b)
    volume = a[0] * n0[0] + a[1] * n0[1] + a[2] * n0[2]
    if volume == 0.0:
        return
    sign = 1.0 if volume > 0.0 else -1.0
    for j in range(j0, j1):
        y = y0 + (j + HALF) * dy
        for i in range(i0, i1):
            x = x0 + (i + HALF) * dx
            e0 = sign * (n0[0] * x + n0[1] * y + n0[2])
            e1 = sign * (n1[0] * x + n1[1] * y + n1[2])
            e2 = sign * (n2[0] * x + n2[1] * y + n2[2])
            if e0 < 0.0 or e1 < 0.0 or e2 < 0.0:
                continue
            total = e0 + e1 + e2
            if total <= 0.0:
                continue
            z = sign * volume / total
            texel = first + j * columns + i
            if z > near and z > floor[texel]:
                if holed and is_hole(number, np.float32(e1 / total), np.float32(e2 / total), faces, holes):
                    continue
                keep(depth, triangle, texel, z, number)


@kernel(inline=True)
def find_floor(c, views, seen, cells, floor):
    """Depth of each texel below which nothing can be reflected: the least of the cluster's pixels around it."""
    eye, look, box, size, _, first = views
    starts, order, position = seen
    count = starts[c + 1] - starts[c]
    columns, rows = size[c, 0], size[c, 1]
    cell = int(max(1.0, math.ceil(math.sqrt(PIXELS_PER_CELL * columns * rows / max(count, 1)))))
    across, down = (columns + cell - 1) // cell, (rows + cell - 1) // cell
    for k in range(across * down):
        cells[first[c] + k] = np.inf
    for slot in range(starts[c], starts[c + 1]):
        p = to_camera(position, order[slot], eye, look, c)
        if p[2] <= 0.0:
            continue
        u = (p[0] / p[2] - box[c, 0]) / (box[c, 2] - box[c, 0]) * columns
        v = (p[1] / p[2] - box[c, 1]) / (box[c, 3] - box[c, 1]) * rows
        if u >= 0.0 and v >= 0.0 and u < columns and v < rows:
            at = first[c] + np.int64(v) // cell * across + np.int64(u) // cell
            cells[at] = min(cells[at], np.float32(p[2]))
    for j in range(down):
        for i in range(across):
            least = cells[first[c] + j * across + i]
            if np.isinf(least):  # the rim lies between cells
                for y in range(max(j - 1, 0), min(j + 2, down)):
                    for x in range(max(i - 1, 0), min(i + 2, across)):
                        least = min(least, cells[first[c] + y * across + x])
            value = np.float32(0.0) if np.isinf(least) else least * np.float32(1.0 - 1e-5)
            for y in range(j * cell, min((j + 1) * cell, rows)):
                for x in range(i * cell, min((i + 1) * cell, columns)):
                    floor[first[c] + y * columns + x] = value


@kernel(parallel=True)
def draw_layers(scene, holes, boxes, views, seen, marks, room, layers):
    """Fill ``layers`` with what C cameras see; ``room`` = two arrays (T,) float32 to work in. What no ray can
    meet is left out: ``marks`` as ``layer_march.mark_blocks`` leaves them, (texels a side, first block (C,), blocks).

    ``scene`` = vertices (V,3) float64, faces (F,3) int32; ``holes``:
    :class:`~torchrender.kernels.raster.records.Holes`.
    """
    vertices, faces = scene
    mask, table, texels, uv = holes
    cells, floor = room
    order, runs, bounds = boxes
    eye, look, box, size, near, first = views
    starts, rows_of, position = seen
    depth, triangle = layers
    texels_a_side, places, blocks = marks
    count = eye.shape[0]
    half = (count + 1) // 2
    for n in prange(count):
        m = np.int64(n)
        c = 2 * m if m < half else 2 * (m - half) + 1  # threads take neighbours in turn: large ones stand together
        view = LayerViews(eye, look, box, size, near, first)
        find_floor(c, view, Seen(starts, rows_of, position), cells, floor)
        columns, rows = size[c, 0], size[c, 1]
        step = ((box[c, 2] - box[c, 0]) / columns, (box[c, 3] - box[c, 1]) / rows)
        place = (box[c, 0], box[c, 1], step[0], step[1], columns, rows, first[c])
        for g in range(bounds.shape[0]):
            if box_outside(bounds, g, eye, look, box, near, c):
                continue
            if unmarked(bounds, g, view, c, (texels_a_side, places, blocks)):
                continue
            for slot in range(runs[g, 0], runs[g, 1]):
                k = order[slot]
                a = to_camera(vertices, faces[k, 0], eye, look, c)
                b = to_camera(vertices, faces[k, 1], eye, look, c)
                d = to_camera(vertices, faces[k, 2], eye, look, c)
                draw_triangle(
                    a, b, d, place, near[c], floor, (depth, triangle), (k, faces, Holes(mask, table, texels, uv))
                )
