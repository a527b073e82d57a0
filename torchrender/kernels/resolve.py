"""Finished tiles into images: depth, ids and barycentrics."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.coverage import TILE_WIDTH
from torchrender.kernels.planes import barycentric_planes


@kernel(inline=True)
def write_depth(orthographic, row_keys, row_ids, depth, triangle):
    """One row of depth, and of triangle ids if wanted."""
    count = np.uintp(depth.shape[0])
    if orthographic:
        for x in range(count):
            depth[x] = -row_keys[x] if row_ids[x] >= 0 else np.inf
    else:
        for x in range(count):
            depth[x] = 1.0 / row_keys[x] if row_ids[x] >= 0 else np.inf
    if triangle.shape[0] > 0:
        for x in range(count):
            triangle[x] = row_ids[x]


@kernel(inline=True)
def write_run(planes, orthographic, px, py, row_keys, barycentric):
    """Barycentrics of a run of pixels of one triangle; ``px``, ``py``: the first centre."""
    ux, uy, uc, vx, vy, vc = planes
    for x in range(np.uintp(barycentric.shape[0])):
        weight = 1.0 if orthographic else 1.0 / row_keys[x]
        u = (ux * (px + np.float64(x)) + uy * py + uc) * weight
        v = (vx * (px + np.float64(x)) + vy * py + vc) * weight
        u = min(max(u, 0.0), 1.0)
        barycentric[x, np.uintp(0)] = u
        barycentric[x, np.uintp(1)] = min(max(v, 0.0), 1.0 - u)


@kernel()
def resolve(scene, view, place, keys, ids, outputs):
    """Write a finished tile: depth, and if wanted ids and barycentrics, run by run."""
    points, _, faces, objects, _, _ = scene
    orthographic = view[4] != 0.0
    left, top, width, height, centre_x, centre_y = place
    depth, triangle, object_id, barycentric = outputs
    wants_ids = triangle.shape[0] > 0
    for y in range(height):
        row_keys = keys[y * TILE_WIDTH : y * TILE_WIDTH + width]
        row_ids = ids[y * TILE_WIDTH : y * TILE_WIDTH + width]
        row = top + y
        if not wants_ids:
            write_depth(orthographic, row_keys, row_ids, depth[row, left : left + width], triangle[:0, 0])
            continue
        write_depth(
            orthographic, row_keys, row_ids, depth[row, left : left + width], triangle[row, left : left + width]
        )
        start = 0
        while start < width:
            t = np.int64(row_ids[start])
            end = start + 1
            while end < width and row_ids[end] == t:
                end += 1
            if t >= 0:
                for x in range(left + start, left + end):
                    object_id[row, x] = objects[t]
                planes = barycentric_planes(points, faces, t, orthographic)
                run = barycentric[row, left + start : left + end]
                write_run(
                    planes, orthographic, left + start + 0.5 - centre_x, row + 0.5 - centre_y, row_keys[start:end], run
                )
            else:
                for x in range(left + start, left + end):
                    object_id[row, x] = -1
                    barycentric[row, x, 0] = 0.0
                    barycentric[row, x, 1] = 0.0
            start = end
