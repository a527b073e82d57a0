"""Irradiance by normal: what each block of the sky gives a surface that it faces."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SPAN = 128
"""Normals at a time: sums over blocks then run along them."""


@kernel(parallel=True)
def facing_sum(vectors, normals, total):
    """``total[n, c] = sum_k max(0, vectors[c, :, k] . normals[:, n])``: vectors (3,3,K), normals (3,N), float32."""
    count = normals.shape[1]
    zero = np.float32(0.0)
    for part in prange((count + SPAN - 1) // SPAN):
        first = np.int64(part) * SPAN
        width = min(SPAN, count - first)
        x, y, z = (
            normals[0, first : first + width],
            normals[1, first : first + width],
            normals[2, first : first + width],
        )
        amount = np.zeros(width, np.float32)
        for c in range(3):
            amount[:] = zero
            for k in range(vectors.shape[2]):
                u, v, w = vectors[c, 0, k], vectors[c, 1, k], vectors[c, 2, k]
                for n in range(np.uintp(width)):
                    amount[n] += max(x[n] * u + y[n] * v + z[n] * w, zero)
            for n in range(width):
                total[first + n, c] = amount[n]
