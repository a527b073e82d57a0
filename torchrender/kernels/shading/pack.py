"""Triangles as the shading kernel reads them: normal and texture density in one cache line."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.attributes import face_cross, unit, uv_density


@kernel(parallel=True)
def pack_planes(vertices, faces, uv, second, planes, density):
    """Unit normals and uv per length of all triangles into ``planes`` (F,4), of the second uv into ``density`` (F,)."""
    first_there, second_there = uv.shape[0] > 0, second.shape[0] > 0
    for t in prange(faces.shape[0]):
        nx, ny, nz = face_cross(vertices, faces, t)
        gx, gy, gz = unit(nx, ny, nz)
        planes[t, 0], planes[t, 1], planes[t, 2] = np.float32(gx), np.float32(gy), np.float32(gz)
        planes[t, 3] = np.float32(uv_density(vertices, faces, uv, t)) if first_there else np.float32(0)
        if second_there:
            density[t] = np.float32(uv_density(vertices, faces, second, t))
