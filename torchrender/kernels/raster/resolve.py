"""Finished tiles into images: depth, ids and barycentrics."""

from __future__ import annotations

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from torchrender.kernels.atomics import borrowed, foresee
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.coverage import NO_BITS, ROW
from torchrender.kernels.raster.lanes.pixels import same_lanes
from torchrender.kernels.raster.lanes.rows import TILE_WIDTH
from torchrender.kernels.raster.lanes.seen import write_mixed, write_seen
from torchrender.kernels.raster.lanes.vectors import LANES
from torchrender.kernels.raster.project import barycentric_planes

AHEAD = 16  # pixels
CACHED = 1024  # triangles whose barycentric planes are kept from row to row; a power of two


@kernel(inline=True)
def write_depth(orthographic, row, left, count, source, keys, ids, depth):
    """One row of depth, which keys other than orthographic ones become in place.

    Indices are unsigned, and there are no slices: those count references.
    """
    if orthographic:
        for x in range(count):
            depth[row, left + x] = -keys[source + x] if ids[source + x] >= 0 else np.inf
    else:
        for x in range(count):
            inverse = 1.0 / keys[source + x]
            keys[source + x] = inverse
            depth[row, left + x] = inverse if ids[source + x] >= 0 else np.inf


@kernel(inline=True)
def write_blank(row, left, count, keys, outputs):
    """A row of pixels without a surface; ``keys``: LANES or more, of which none counts."""
    depth, triangle, object_id, barycentric = outputs
    for x in range(count):
        depth[row, left + x] = np.inf
    if triangle.shape[0] == 0:
        return
    for x in range(count):
        triangle[row, left + x] = -1
    for start in range(np.uintp(0), count, np.uintp(LANES)):
        past = start + np.uintp(LANES)
        lanes = (ROW >> np.uint64(max(past, count) - count), past <= count)
        spot, none = (row, left + start), (0.0, 0.0, 0.0, 0.0, 0.0)
        write_seen((object_id, barycentric), spot, lanes, -1, none, keys, (np.uintp(0), False))


@kernel()
def resolve_blank(place, keys, outputs):
    """Write a tile without a surface."""
    keys, outputs = borrowed(keys), borrowed(outputs)
    left, top, width, height = place
    for y in range(np.uintp(height)):
        write_blank(np.uintp(top) + y, np.uintp(left), np.uintp(width), keys, outputs)


@kernel(inline=True)
def is_blank(ids, source, count):
    """True if none of the pixels holds a triangle."""
    most = np.int32(-1)
    for x in range(count):
        most = max(most, ids[source + x])
    return most < 0


@kernel(inline=True)
def plane_of(scene, t, orthographic, known, planes):
    """Where the planes of triangle ``t`` are kept."""
    slot = np.uintp(t & (CACHED - 1))
    if known[slot] != t:
        known[slot] = t
        a, b, c, d, e, f = barycentric_planes(scene.points, scene.faces, t, orthographic)
        planes[slot, 0] = a
        planes[slot, 1] = b
        planes[slot, 2] = c
        planes[slot, 3] = d
        planes[slot, 4] = e
        planes[slot, 5] = f
    return slot


@kernel(inline=True)
def know_planes(scene, orthographic, ids, here, known, planes):
    """Find the planes of LANES pixels' triangles; False where two of these share a place."""
    fresh = False
    for k in range(np.uintp(LANES)):
        t = np.int64(ids[here + k])
        if t >= 0 and known[np.uintp(t & (CACHED - 1))] != t:
            plane_of(scene, t, orthographic, known, planes)
            fresh = True
    if not fresh:
        return True
    every = True
    for k in range(np.uintp(LANES)):
        t = np.int64(ids[here + k])
        every &= (t < 0) | (known[np.uintp(t & (CACHED - 1))] == t)
    return every


@kernel(inline=True)
def look_ahead(scene, ids, here):
    """What LANES pixels of different triangles read is on its way, from memory in no order."""
    if same_lanes(ids, here, ids[here]) == ROW:
        return
    for k in range(np.uintp(LANES)):
        t = np.uintp(max(ids[here + k], np.int32(0)))
        foresee(scene.faces, t)
        foresee(scene.objects, t)


@kernel()
def resolve(scene, frame, place, buffers, outputs):
    """Write a finished tile; planes are kept while one view is drawn, because most triangles span several rows."""
    # Counting references would cost more than the rest.
    scene, buffers, outputs = borrowed(scene), borrowed(buffers), borrowed(outputs)
    objects = scene.objects
    orthographic = frame.orthographic
    left, top, width, height = place
    centre_x, centre_y = frame.width >> 1, frame.height >> 1
    depth, triangle, object_id, barycentric = outputs
    first, keys, ids, _, _, known, planes = buffers
    wants_ids = triangle.shape[0] > 0
    last = np.uintp(first + height * TILE_WIDTH - LANES)
    for y in range(height):
        row = np.uintp(top + y)
        source = np.uintp(first + y * TILE_WIDTH)
        target = np.uintp(left)
        count = np.uintp(width)
        if is_blank(ids, source, count):
            write_blank(row, target, count, keys, outputs)
            continue
        write_depth(orthographic, row, target, count, source, keys, ids, depth)
        if not wants_ids:
            continue
        for x in range(count):
            triangle[row, target + x] = ids[source + x]
        py = top + y + 0.5 - centre_y
        shift = left + 0.5 - centre_x
        for start in range(np.uintp(0), count, np.uintp(LANES)):
            here, spot = source + start, (row, target + start)
            look_ahead(scene, ids, min(here + np.uintp(AHEAD), last))
            whole = start + np.uintp(LANES) <= count
            rest = ROW >> np.uint64(max(start + np.uintp(LANES), count) - count)
            column = np.float64(start) + shift
            if same_lanes(ids, here, ids[here]) & rest != rest and know_planes(
                scene, orthographic, ids, here, known, planes
            ):
                write_mixed(
                    (object_id, barycentric), spot, (rest, whole), (ids, here, np.int32(CACHED - 1)), (planes, objects),
                    keys, (column, py, not orthographic),
                )  # fmt: skip
                continue
            while rest != NO_BITS:
                t = ids[here + np.uintp(trailing_zeros(rest))]
                mask = same_lanes(ids, here, t) & rest
                rest ^= mask
                ux = uc = vx = vc = 0.0
                owner = np.int64(-1)
                if t >= 0:
                    slot = plane_of(scene, np.int64(t), orthographic, known, planes)
                    ux, uc = planes[slot, 0], planes[slot, 1] * py + planes[slot, 2]
                    vx, vc = planes[slot, 3], planes[slot, 4] * py + planes[slot, 5]
                    owner = objects[t]
                weighted = t >= 0 and not orthographic
                write_seen(
                    (object_id, barycentric), spot, (mask, whole), owner, (ux, uc, vx, vc, column), keys,
                    (here, weighted),
                )  # fmt: skip
