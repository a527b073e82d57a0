"""Points of smooth surfaces, moved out of their triangles to where shadows are looked up."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.attributes import shading_normal, unit
from torchrender.kernels.shading.simd import MOST_BENT

FLAT = np.float32(1e-6)
"""One minus the cosine between shading and geometric normal up to which a surface is flat."""
BLOCK = 512
"""Points that a thread takes at a time."""


@kernel()
def corner_normals(faces, normals, t, face, units):
    """Unit normals of the corners of triangle ``t`` into ``units`` (3,3); whether all are that of the triangle."""
    least, most = 1.0, -1.0
    for k in range(3):
        at = faces[t, k]
        x, y, z = unit(np.float64(normals[at, 0]), np.float64(normals[at, 1]), np.float64(normals[at, 2]))
        units[k, 0], units[k, 1], units[k, 2] = x, y, z
        cosine = x * face[0] + y * face[1] + z * face[2]
        least, most = min(least, cosine), max(most, cosine)
    return least > 1.0 - 0.5 * FLAT or most < 0.5 * FLAT - 1.0


@kernel(inline=True)
def move_one(mesh, t, weights, place, face, units):
    """Where a point is asked for light, and by which normal; ``units``: :func:`corner_normals`."""
    vertices, faces, normals = mesh
    u, v = weights
    sx, sy, sz = shading_normal(
        normals, faces, t, u, v, (np.float64(face[0]), np.float64(face[1]), np.float64(face[2]))
    )
    fx, fy, fz = np.float32(sx), np.float32(sy), np.float32(sz)
    cosine = fx * face[0] + fy * face[1] + fz * face[2]
    if not (cosine < np.float32(1.0) - FLAT and cosine > MOST_BENT):
        return place, face
    x, y, z = place
    for k in range(3):
        corner = faces[t, k]
        share = 1.0 - u - v if k == 0 else (u if k == 1 else v)
        dx, dy, dz = units[k, 0], units[k, 1], units[k, 2]
        below = (place[0] - vertices[corner, 0]) * dx + (place[1] - vertices[corner, 1]) * dy
        below += (place[2] - vertices[corner, 2]) * dz
        turned = dx * fx + dy * fy + dz * fz < 0.0
        below = -share * (max(below, 0.0) if turned else min(below, 0.0))
        x, y, z = x + below * dx, y + below * dy, z + below * dz
    return (x, y, z), (fx, fy, fz)


@kernel(parallel=True)
def move_out(mesh, triangle, weights, given, made):
    """All points: ``given`` and ``made`` are positions (N,3) float64 and unit normals (N,3) float32, the given ones of
    the triangles; ``mesh`` = vertices, faces, normals of corners; triangles (N,), -1: none, weights (N,2).

    Points of flat surfaces, and of those whose normals lean too far from the triangle's, stay as they are.
    """
    count = triangle.shape[0]
    for block in prange((count + BLOCK - 1) // BLOCK):
        shape = (borrowed(mesh[0]), borrowed(mesh[1]), borrowed(mesh[2]))
        position, geometric = borrowed(given[0]), borrowed(given[1])
        moved, normal, shares = borrowed(made[0]), borrowed(made[1]), borrowed(weights)
        held = np.empty((3, 3))
        units, last, flat = borrowed(held), np.int64(-1), True
        for row in range(block * BLOCK, min((block + 1) * BLOCK, count)):
            t = triangle[row]
            place = (position[row, 0], position[row, 1], position[row, 2])
            face = (geometric[row, 0], geometric[row, 1], geometric[row, 2])
            if t >= 0 and t != last:
                last, flat = t, corner_normals(shape[1], shape[2], t, face, units)
            if t >= 0 and not flat:
                share = (np.float64(shares[row, 0]), np.float64(shares[row, 1]))
                place, face = move_one(shape, t, share, place, face, units)
            moved[row, 0], moved[row, 1], moved[row, 2] = place
            normal[row, 0], normal[row, 1], normal[row, 2] = face
        keep(held)
