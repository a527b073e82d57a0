"""Which triangles meet which tile: culling, clipping and a stable counting sort."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster import coverage
from torchrender.kernels.raster.lanes.rows import COLUMN_BITS, ROW_BITS, TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.project import (
    CULL_BACK,
    CULL_FRONT,
    GUARD,
    HALF,
    SUBPIXEL,
    SUBPIXEL_BITS,
    greatest_key,
    snap,
    snapped_x,
    snapped_y,
)
from torchrender.kernels.raster.samples import CROSSING, LARGE, look_at, room_for

MAX_CLIPPED = 9  # vertices of a triangle after five planes


class Clusters(NamedTuple):
    """Clusters of triangles and which of them are drawn."""

    runs: np.ndarray  # (C,2) int64 places in ``order``
    order: np.ndarray  # (F,) int32 triangle ids
    chosen: np.ndarray  # (N,) int64
    single_sided: np.ndarray  # (F,) bool triangles whose backs are culled; (0,): none


class Lists(NamedTuple):
    """Triangles that each chunk of clusters keeps."""

    corners: np.ndarray  # (N,3) int64 snapped
    bits: np.ndarray  # (N,) uint64 covered pixels of a window within one tile, or 0: then the corners count
    highs: np.ndarray  # (N,) float64 keys that no fragment exceeds
    places: np.ndarray  # (N,) int32 in the order of the clusters
    boxes: np.ndarray  # (N,4) int32 first column and row of the box or window, last column and row of the box
    to_clip: np.ndarray  # (N,) int32 places in the order of those to clip


class Listing(NamedTuple):
    """What is listed, and how."""

    cull: int  # CULL_NONE, CULL_BACK or CULL_FRONT
    plain: bool  # of tiny triangles, which are listed by their pixels, nobody asks for the corners
    mask: np.ndarray  # (F,) triangles with a row of missing texels here are no tiny ones; (0,): none


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


@kernel(inline=True)
def doubled_area(a, b, c):
    """Twice the signed area in snapped units; negative where the right-hand normal faces the camera."""
    ax, ay = snapped_x(a), snapped_y(a)
    return (snapped_x(b) - ax) * (snapped_y(c) - ay) - (snapped_y(b) - ay) * (snapped_x(c) - ax)


@kernel(inline=True)
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


@kernel(inline=True)
def side_of(t, cull, single_sided):
    """What is culled of triangle ``t``: its back if it is ``single_sided`` (F,), or (0,) for none."""
    return CULL_BACK if single_sided.shape[0] > 0 and single_sided[t] else cull


@kernel()
def classify_clusters(projected, listed, clusters, frame, how, part, lists, counts):
    """Cull the triangles of some chosen clusters, list the others and count their tiles.

    ``projected``: vertices and the same memory as integers; ``listed`` (F,3): faces in the order of the clusters;
    ``how``: a :class:`Listing`.
    ``part``: first and one-past-last of ``chosen``, and first place in ``lists``. Small triangles that hit no pixel
    centre end here. Returns the numbers kept and to clip.
    """
    points, packed = borrowed(projected)
    listed = borrowed(listed)
    lists, counts = borrowed(lists), borrowed(counts)
    runs, order, chosen, single_sided = borrowed(clusters)
    width, height, near, far, orthographic = frame
    image = (0, 0, width - 1, height - 1)
    left, top = width >> 1, height >> 1
    columns = (width + TILE_WIDTH - 1) >> COLUMN_BITS
    corners, bits_of, highs, places, boxes, to_clip = (
        lists.corners, lists.bits, lists.highs, lists.places, lists.boxes, lists.to_clip
    )  # fmt: skip
    first, end, start = part
    n = m = np.uintp(start)  # unsigned, as all indices here: signed ones may count from the end, which takes a test
    cull, plain, mask = borrowed(how)
    room = room_for(runs, chosen[first:end])
    chunk = borrowed(room)
    for cluster in range(first, end):
        begin, past = runs[chosen[cluster], 0], runs[chosen[cluster], 1]
        found = look_at(packed, listed, (begin, past), frame, image, cull, chunk)
        for number in range(found):
            k = np.uintp(chunk.found[number])
            code = chunk.codes[k]
            place = np.uintp(begin) + k
            if code == CROSSING:
                if not out_of_view(points, listed, place, near, far, orthographic, width * 0.5 + 1, height * 0.5 + 1):
                    to_clip[m] = place
                    m += np.uintp(1)
                continue
            a, b, c, t = chunk.a[k], chunk.b[k], chunk.c[k], np.uintp(order[place])
            area = doubled_area(a, b, c)
            if single_sided.shape[0] > 0 and is_culled(area, side_of(t, cull, single_sided)):
                continue
            x0, y0, x1, y1 = pixel_box(a, b, c, image, left, top)
            i0, j0, i1, j1 = x0 >> COLUMN_BITS, y0 >> ROW_BITS, x1 >> COLUMN_BITS, y1 >> ROW_BITS
            bits, x0 = (coverage.NO_BITS, x0) if code == LARGE else coverage.move_bits(np.uint64(code), x0)
            whole = i0 == i1 and j0 == j1
            if code == LARGE and max(x1 - x0, y1 - y0) < coverage.WINDOW:
                whole = whole and (x1 - x0 + 1) * (y1 - y0 + 1) <= coverage.SMALL
                if whole:
                    x0, y0 = coverage.window_start(x0, y0, x1)
                pixel = ((x0 - left) * SUBPIXEL + HALF, (y0 - top) * SUBPIXEL + HALF)
                bits = coverage.window_bits(a, b, c, area, pixel, y1 - y0 + 1)
                if bits == coverage.NO_BITS:
                    continue
            if not whole or (mask.shape[0] > 0 and mask[t] >= 0):
                bits = coverage.NO_BITS  # of two tiles each has its own part of the box
            places[n] = place
            if bits == coverage.NO_BITS or not plain:
                corners[n, 0], corners[n, 1], corners[n, 2] = a, b, c
            bits_of[n] = bits
            highs[n] = greatest_key(points, listed, place, frame)
            boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3] = x0, y0, x1, y1
            n += np.uintp(1)
            for j in range(j0, j1 + 1):
                for i in range(i0, i1 + 1):
                    counts[np.uintp(j * columns + i)] += 1
    keep(room)
    return np.int64(n) - start, np.int64(m) - start


@kernel(parallel=True)
def classify(projected, listed, clusters, frame, how, starts, lists):
    """Cull triangles and count tiles, in chunks of the chosen clusters.

    Arguments as above; ``starts`` (chunks+1,): first place of each chunk in ``lists``, :class:`Lists`,
    which are filled. Returns the number kept and the number to clip for each chunk and the tile counts (chunks, tiles).
    """
    columns = (frame.width + TILE_WIDTH - 1) >> COLUMN_BITS
    rows = (frame.height + TILE_HEIGHT - 1) >> ROW_BITS
    chunks = starts.shape[0] - 1
    count = clusters.chosen.shape[0]
    counts = np.zeros((chunks, columns * rows), np.int32)
    kept = np.zeros((chunks, 2), np.int64)
    per = (count + chunks - 1) // chunks
    for chunk in prange(chunks):
        first = min(np.int64(chunk) * per, count)
        part = (first, min(first + per, count), starts[chunk])
        n, m = classify_clusters(projected, listed, clusters, frame, how, part, lists, counts[chunk])
        kept[chunk, 0] = n
        kept[chunk, 1] = m
    return kept, counts


@kernel()
def scatter_list(boxes, first, end, columns, offsets, entries):
    """Write the places ``first`` to ``end`` - 1 of the lists into the tiles of their boxes."""
    boxes, offsets, entries = borrowed(boxes), borrowed(offsets), borrowed(entries)
    for n in range(first, end):
        for j in range(boxes[n, 1] >> ROW_BITS, (boxes[n, 3] >> ROW_BITS) + 1):
            for i in range(boxes[n, 0] >> COLUMN_BITS, (boxes[n, 2] >> COLUMN_BITS) + 1):
                tile = np.uintp(j * columns + i)
                place = offsets[tile]
                entries[place] = n
                offsets[tile] = place + 1


@kernel(parallel=True)
def scatter(boxes, starts, kept, offsets, columns, entries):
    """Write each kept triangle into the lists of its tiles; ``offsets`` (chunks, tiles) is advanced."""
    for chunk in prange(kept.shape[0]):
        scatter_list(boxes, starts[chunk], starts[chunk] + kept[chunk, 0], columns, offsets[chunk], entries)


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
def clip_triangles(points, listed, places, frame, sides, positions, owners):
    """Clip the triangles at ``places`` in the order and fan them: snapped corners (M,3) and places (M,); returns M.

    ``listed`` (F,3): faces in this order; ``sides``: what to cull of all triangles, which ones are single-sided (F,)
    or (0,), and the order (F,).
    """
    cull, single_sided, order = sides
    near, orthographic = frame.near, frame.orthographic
    limit = float(GUARD)
    polygon = np.zeros((MAX_CLIPPED, 3))
    corner = np.zeros(MAX_CLIPPED, np.int64)
    total = 0
    for place in places:
        for k in range(3):
            for i in range(3):
                polygon[k, i] = points[listed[place, k], i]
        count = clip_polygon(polygon, 3, near, orthographic)
        for k in range(count):
            w = 1.0 if orthographic else polygon[k, 2]
            x = min(max(polygon[k, 0] / w, -limit), limit)
            y = min(max(polygon[k, 1] / w, -limit), limit)
            corner[k] = snap(x, y)
        for k in range(1, count - 1):
            area = doubled_area(corner[0], corner[k], corner[k + 1])
            if not is_culled(area, side_of(order[place], cull, single_sided)):
                positions[total, 0] = corner[0]
                positions[total, 1] = corner[k]
                positions[total, 2] = corner[k + 1]
                owners[total] = place
                total += 1
    return total


@kernel()
def bin_clipped(positions, first_entry, frame, counts, entries, offsets):
    """Count (``entries`` empty) or write the clipped triangles into the tiles they meet, as ``first_entry`` + row."""
    width, height = frame.width, frame.height
    image = (0, 0, width - 1, height - 1)
    columns = (width + TILE_WIDTH - 1) >> COLUMN_BITS
    writing = entries.shape[0] > 0
    for m in range(positions.shape[0]):
        x0, y0, x1, y1 = pixel_box(positions[m, 0], positions[m, 1], positions[m, 2], image, width >> 1, height >> 1)
        if x0 > x1 or y0 > y1:
            continue
        for j in range(y0 >> ROW_BITS, (y1 >> ROW_BITS) + 1):
            for i in range(x0 >> COLUMN_BITS, (x1 >> COLUMN_BITS) + 1):
                if writing:
                    entries[offsets[j * columns + i]] = first_entry + m
                    offsets[j * columns + i] += 1
                else:
                    counts[j * columns + i] += 1
