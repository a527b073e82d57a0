"""Finished tiles into images: depth, ids and barycentrics."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.coverage import TILE_WIDTH
from torchrender.kernels.raster.planes import barycentric_planes

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


@kernel()
def resolve(scene, frame, place, buffers, outputs):
    """Write a finished tile; planes are kept while one view is drawn, because most triangles span several rows."""
    points, faces, objects = scene.points, scene.faces, scene.objects
    orthographic = frame.orthographic
    left, top, width, height = place
    centre_x, centre_y = frame.width >> 1, frame.height >> 1
    depth, triangle, object_id, barycentric = outputs
    keys, ids, _, _, known, planes = buffers
    wants_ids = triangle.shape[0] > 0
    for y in range(height):
        row = np.uintp(top + y)
        source = np.uintp(y * TILE_WIDTH)
        target = np.uintp(left)
        count = np.uintp(width)
        write_depth(orthographic, row, target, count, source, keys, ids, depth)
        if not wants_ids:
            continue
        for x in range(count):
            triangle[row, target + x] = ids[source + x]
        start = np.uintp(0)
        one = np.uintp(1)
        py = top + y + 0.5 - centre_y
        shift = left + 0.5 - centre_x
        while start < count:
            t = np.int64(ids[source + start])
            end = start + one
            while end < count and ids[source + end] == t:
                end += one
            if t >= 0:
                owner = objects[t]
                slot = np.uintp(t & (CACHED - 1))
                if known[slot] != t:
                    known[slot] = t
                    a, b, c, d, e, f = barycentric_planes(points, faces, t, orthographic)
                    planes[slot, 0] = a
                    planes[slot, 1] = b
                    planes[slot, 2] = c
                    planes[slot, 3] = d
                    planes[slot, 4] = e
                    planes[slot, 5] = f
                ux, uc = planes[slot, 0], planes[slot, 1] * py + planes[slot, 2]
                vx, vc = planes[slot, 3], planes[slot, 4] * py + planes[slot, 5]
                for x in range(start, end):
                    object_id[row, target + x] = owner
                    weight = 1.0 if orthographic else keys[source + x]
                    px = np.float64(x) + shift
                    u = min(max((ux * px + uc) * weight, 0.0), 1.0)
                    v = min(max((vx * px + vc) * weight, 0.0), 1.0 - u)
                    barycentric[row, target + x, np.uintp(0)] = u
                    barycentric[row, target + x, np.uintp(1)] = v
            else:
                for x in range(start, end):
                    object_id[row, target + x] = -1
                    barycentric[row, target + x, np.uintp(0)] = 0.0
                    barycentric[row, target + x, np.uintp(1)] = 0.0
            start = end
