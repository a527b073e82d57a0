"""Which ray hits fall into the holes of textured triangles."""

from __future__ import annotations

from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.fragments import is_hole


@kernel(parallel=True)
def hits_in_holes(triangle, weights, faces, holes, out):
    """Set ``out`` (N,) where hit ``triangle`` (N,) at barycentric ``weights`` (N,2) is a missing texel."""
    for k in prange(triangle.shape[0]):
        t = triangle[k]
        out[k] = t >= 0 and is_hole(t, weights[k, 0], weights[k, 1], faces, holes)
