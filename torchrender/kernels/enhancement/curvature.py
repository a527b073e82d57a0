"""Curvature of meshes, and of what pixels see of them."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

TINY_AREA = 1e-12
"""Twice a triangle's area, in squares of its longest side, below which it is left out."""


@kernel()
def vertex_curvature(vertices, faces, normals, sums, out):
    """``out`` (V,): mean over the faces of a vertex of ``sum_i n_i . grad b_i / 3``, weighted by area; 0 without faces.

    Args:
        vertices: (V,3) float64; faces: (F,3) int32; normals: (V,3) float32 of vertices.
        sums: (V,2) float64 scratch, zeros: area times curvature, area.
    """
    corner = np.empty((3, 3))
    for f in range(len(faces)):
        for k in range(3):
            for c in range(3):
                corner[k, c] = vertices[faces[f, k], c]
        x1, y1, z1 = corner[1, 0] - corner[0, 0], corner[1, 1] - corner[0, 1], corner[1, 2] - corner[0, 2]
        x2, y2, z2 = corner[2, 0] - corner[0, 0], corner[2, 1] - corner[0, 1], corner[2, 2] - corner[0, 2]
        x3, y3, z3 = x2 - x1, y2 - y1, z2 - z1
        nx, ny, nz = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
        square = nx * nx + ny * ny + nz * nz
        longest = max(x1 * x1 + y1 * y1 + z1 * z1, x2 * x2 + y2 * y2 + z2 * z2, x3 * x3 + y3 * y3 + z3 * z3)
        twice = math.sqrt(square)
        if not twice > TINY_AREA * longest:
            continue
        # n_T x side / (2 |T|), dotted with the vertex normal; sides against corners 0, 1, 2.
        bend = 0.0
        for k in range(3):
            if k == 0:
                sx, sy, sz = x3, y3, z3
            elif k == 1:
                sx, sy, sz = -x2, -y2, -z2
            else:
                sx, sy, sz = x1, y1, z1
            v = faces[f, k]
            bend += normals[v, 0] * (ny * sz - nz * sy)
            bend += normals[v, 1] * (nz * sx - nx * sz)
            bend += normals[v, 2] * (nx * sy - ny * sx)
        bend /= 3.0 * square
        for k in range(3):
            v = faces[f, k]
            sums[v, 0] += twice * bend
            sums[v, 1] += twice
    for v in range(len(out)):
        out[v] = sums[v, 0] / sums[v, 1] if sums[v, 1] > 0.0 else 0.0


@kernel(parallel=True)
def pixel_curvature(triangle, barycentric, mesh, facing, out):
    """``out`` (N,) float32: curvature of vertices, interpolated; its sign turned where the seen side is the back.

    Args:
        triangle: (N,) int64, -1: nothing there, out is 0; barycentric: (N,2) of the second and third vertex.
        mesh: faces (F,3) int32, curvature (V,) float32, normals (V,3) float32 of vertices.
        facing: (N,3) float32 normals towards the eye.
    """
    faces, curvature, normals = mesh
    for p in prange(len(triangle)):
        t = triangle[p]
        if t < 0:
            out[p] = 0.0
            continue
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        b, c = barycentric[p, 0], barycentric[p, 1]
        a = np.float32(1.0) - b - c
        value = a * curvature[i] + b * curvature[j] + c * curvature[k]
        along = np.float32(0.0)
        for d in range(3):
            along += (a * normals[i, d] + b * normals[j, d] + c * normals[k, d]) * facing[p, d]
        out[p] = value if along >= 0.0 else -value
