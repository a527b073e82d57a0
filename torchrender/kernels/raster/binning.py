"""Which triangles meet which tile: culling, clipping and a stable counting sort."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.project import GUARD, NEEDS_CLIP, SUBPIXEL, SUBPIXEL_BITS, snap, snapped_x, snapped_y

HALF = SUBPIXEL >> 1
CULL_NONE, CULL_BACK, CULL_FRONT = 0, 1, 2
MAX_CLIPPED = 9  # vertices of a triangle after five planes


class Clusters(NamedTuple):
    """Clusters of triangles and which of them are drawn."""

    runs: np.ndarray  # (C,2) int64 places in ``order``
    order: np.ndarray  # (F,) int32 triangle ids
    chosen: np.ndarray  # (N,) int64
    single_sided: np.ndarray  # (F,) bool triangles whose backs are culled; (0,): none


class Lists(NamedTuple):
    """Triangles that each chunk of clusters keeps."""

    starts: np.ndarray  # (chunks+1,) int64 first place of each chunk
    ids: np.ndarray  # (N,) int32
    boxes: np.ndarray  # (N,4) int16 first and last column and row of tiles
    to_clip: np.ndarray  # (N,) int32 ids


@kernel(inline=True)
def pixel_box(a, b, c, bounds, left, top):
    """Pixels within ``bounds`` whose centres lie in the bounding box of three snapped positions.

    ``bounds`` and result: x0, y0, x1, y1 inclusive; ``left``, ``top``: the pixel from which positions count.
    """
    ax, bx, cx = snapped_x(a), snapped_x(b), snapped_x(c)
    ay, by, cy = snapped_y(a), snapped_y(b), snapped_y(c)
    x0 = ((min(ax, min(bx, cx)) - HALF + SUBPIXEL - 1) >> SUBPIXEL_BITS) + left
    y0 = ((min(ay, min(by, cy)) - HALF + SUBPIXEL - 1) >> SUBPIXEL_BITS) + top
    x1 = ((max(ax, max(bx, cx)) - HALF) >> SUBPIXEL_BITS) + left
    y1 = ((max(ay, max(by, cy)) - HALF) >> SUBPIXEL_BITS) + top
    return max(x0, bounds[0]), max(y0, bounds[1]), min(x1, bounds[2]), min(y1, bounds[3])


@kernel()
def doubled_area(a, b, c):
    """Twice the signed area in snapped units; negative where the right-hand normal faces the camera."""
    ax, ay = snapped_x(a), snapped_y(a)
    return (snapped_x(b) - ax) * (snapped_y(c) - ay) - (snapped_y(b) - ay) * (snapped_x(c) - ax)


@kernel()
def is_culled(area, cull):
    return area == 0 or (cull == CULL_BACK and area > 0) or (cull == CULL_FRONT and area < 0)


@kernel()
def out_of_view(points, faces, t, near, far, orthographic, half_width, half_height):
    """True if all three vertices lie beyond one side of the frustum."""
    before = True
    behind = True
    left = True
    right = True
    above = True
    below = True
    for k in range(3):
        v = faces[t, k]
        z = points[v, 2]
        w = 1.0 if orthographic else z
        before &= z < near
        behind &= z > far
        left &= points[v, 0] < -half_width * w
        right &= points[v, 0] > half_width * w
        above &= points[v, 1] < -half_height * w
        below &= points[v, 1] > half_height * w
    return before or behind or left or right or above or below


@kernel()
def side_of(t, cull, single_sided):
    """What is culled of triangle ``t``: its back if it is ``single_sided`` (F,), or (0,) for none."""
    return CULL_BACK if single_sided.shape[0] > 0 and single_sided[t] else cull


@kernel(parallel=True)
def classify(points, packed, faces, clusters, frame, cull, tile, lists):
    """Cull triangles and count tiles, in chunks of the chosen clusters.

    ``clusters``: :class:`Clusters`; ``tile`` (2,): tile width and height; ``lists``: :class:`Lists`, filled. Returns
    the number kept and the number to clip for each chunk and the tile counts (chunks, tiles).
    """
    width, height, near, far, orthographic = frame
    image = (0, 0, width - 1, height - 1)
    columns = (width + tile[0] - 1) // tile[0]
    rows = (height + tile[1] - 1) // tile[1]
    starts, ids, boxes, to_clip = lists
    runs, order, chosen, single_sided = clusters
    chunks = starts.shape[0] - 1
    counts = np.zeros((chunks, columns * rows), np.int32)
    kept = np.zeros((chunks, 2), np.int64)
    per = (chosen.shape[0] + chunks - 1) // chunks
    for chunk in prange(chunks):
        n = starts[chunk]
        m = starts[chunk]
        first_cluster = np.int64(chunk) * per
        for k in range(first_cluster, min(first_cluster + per, chosen.shape[0])):
            for place in range(runs[chosen[k], 0], runs[chosen[k], 1]):
                t = order[place]
                a = packed[faces[t, 0], 3]
                b = packed[faces[t, 1], 3]
                c = packed[faces[t, 2], 3]
                if a == NEEDS_CLIP or b == NEEDS_CLIP or c == NEEDS_CLIP:
                    if not out_of_view(points, faces, t, near, far, orthographic, width * 0.5 + 1, height * 0.5 + 1):
                        to_clip[m] = t
                        m += 1
                    continue
                x0, y0, x1, y1 = pixel_box(a, b, c, image, width >> 1, height >> 1)
                if x0 > x1 or y0 > y1 or is_culled(doubled_area(a, b, c), side_of(t, cull, single_sided)):
                    continue
                i0, j0, i1, j1 = x0 // tile[0], y0 // tile[1], x1 // tile[0], y1 // tile[1]
                ids[n] = t
                boxes[n, 0] = i0
                boxes[n, 1] = j0
                boxes[n, 2] = i1
                boxes[n, 3] = j1
                n += 1
                for j in range(j0, j1 + 1):
                    for i in range(i0, i1 + 1):
                        counts[chunk, j * columns + i] += 1
        kept[chunk, 0] = n - starts[chunk]
        kept[chunk, 1] = m - starts[chunk]
    return kept, counts


@kernel(parallel=True)
def scatter(lists, kept, offsets, columns, entries):
    """Write each kept triangle into the lists of its tiles; ``offsets`` (chunks, tiles) is advanced."""
    starts, ids, boxes, _ = lists
    for chunk in prange(kept.shape[0]):
        for n in range(starts[chunk], starts[chunk] + kept[chunk, 0]):
            for j in range(boxes[n, 1], boxes[n, 3] + 1):
                for i in range(boxes[n, 0], boxes[n, 2] + 1):
                    place = offsets[chunk, j * columns + i]
                    entries[place] = ids[n]
                    offsets[chunk, j * columns + i] = place + 1


@kernel()
def plane_distance(plane, x, y, z, near, orthographic):
    """Positive inside: plane 0 is the near plane, 1 to 4 the sides of the guard band."""
    w = 1.0 if orthographic else z
    if plane == 0:
        return z - near
    if plane == 1:
        return x + GUARD * w
    if plane == 2:
        return GUARD * w - x
    if plane == 3:
        return y + GUARD * w
    return GUARD * w - y


@kernel()
def clip_polygon(polygon, count, near, orthographic):
    """Clip ``count`` vertices (n,3) in place against the five planes; returns the new count.

    A crossing is always computed from the inner to the outer end, so two triangles that share an edge get the same
    vertex bit for bit.
    """
    other = np.zeros((MAX_CLIPPED, 3))
    for plane in range(5):
        n = 0
        for k in range(count):
            j = (k + 1) % count
            here = plane_distance(plane, polygon[k, 0], polygon[k, 1], polygon[k, 2], near, orthographic)
            there = plane_distance(plane, polygon[j, 0], polygon[j, 1], polygon[j, 2], near, orthographic)
            if here >= 0.0:
                for i in range(3):
                    other[n, i] = polygon[k, i]
                n += 1
            if (here >= 0.0) != (there >= 0.0):
                if here >= 0.0:
                    inner, outer, share = k, j, here / (here - there)
                else:
                    inner, outer, share = j, k, there / (there - here)
                for i in range(3):
                    other[n, i] = polygon[inner, i] + share * (polygon[outer, i] - polygon[inner, i])
                if plane == 0:
                    other[n, 2] = near
                n += 1
        count = n
        for k in range(count):
            for i in range(3):
                polygon[k, i] = other[k, i]
        if count == 0:
            break
    return count


@kernel()
def clip_triangles(points, faces, ids, frame, sides, positions, owners):
    """Clip the triangles ``ids`` and fan them: snapped corners (M,3) and triangle ids (M,); returns M.

    ``sides``: what to cull of all triangles, which ones are single-sided (F,) or (0,).
    """
    cull, single_sided = sides
    near, orthographic = frame.near, frame.orthographic
    limit = float(GUARD)
    polygon = np.zeros((MAX_CLIPPED, 3))
    corner = np.zeros(MAX_CLIPPED, np.int64)
    total = 0
    for t in ids:
        for k in range(3):
            for i in range(3):
                polygon[k, i] = points[faces[t, k], i]
        count = clip_polygon(polygon, 3, near, orthographic)
        for k in range(count):
            w = 1.0 if orthographic else polygon[k, 2]
            x = min(max(polygon[k, 0] / w, -limit), limit)
            y = min(max(polygon[k, 1] / w, -limit), limit)
            corner[k] = snap(x, y)
        for k in range(1, count - 1):
            area = doubled_area(corner[0], corner[k], corner[k + 1])
            if not is_culled(area, side_of(t, cull, single_sided)):
                positions[total, 0] = corner[0]
                positions[total, 1] = corner[k]
                positions[total, 2] = corner[k + 1]
                owners[total] = t
                total += 1
    return total


@kernel()
def bin_clipped(positions, first_entry, frame, tile, counts, entries, offsets):
    """Count (``entries`` empty) or write the clipped triangles into the tiles they meet, as ``first_entry`` + row."""
    width, height = frame.width, frame.height
    image = (0, 0, width - 1, height - 1)
    columns = (width + tile[0] - 1) // tile[0]
    writing = entries.shape[0] > 0
    for m in range(positions.shape[0]):
        x0, y0, x1, y1 = pixel_box(positions[m, 0], positions[m, 1], positions[m, 2], image, width >> 1, height >> 1)
        if x0 > x1 or y0 > y1:
            continue
        for j in range(y0 // tile[1], y1 // tile[1] + 1):
            for i in range(x0 // tile[0], x1 // tile[0] + 1):
                if writing:
                    entries[offsets[j * columns + i]] = first_entry + m
                    offsets[j * columns + i] += 1
                else:
                    counts[j * columns + i] += 1
