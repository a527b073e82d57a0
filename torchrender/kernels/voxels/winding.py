"""Generalised winding numbers (Jacobson et al. 2013), distant clusters of triangles as dipoles (Barill et al. 2018).

Source: specification 05, section 5.2.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

FAR = 3.0  # cluster radii from which on a cluster counts as a dipole


@kernel(inline=True)
def solid_angle(p, q, r, x, y, z):
    """Signed solid angle of a triangle from (x, y, z) (Van Oosterom and Strackee 1983); zero on its edges."""
    ax, ay, az = p[0] - x, p[1] - y, p[2] - z
    bx, by, bz = q[0] - x, q[1] - y, q[2] - z
    cx, cy, cz = r[0] - x, r[1] - y, r[2] - z
    a = np.sqrt(ax * ax + ay * ay + az * az)
    b = np.sqrt(bx * bx + by * by + bz * bz)
    c = np.sqrt(cx * cx + cy * cy + cz * cz)
    det = ax * (by * cz - bz * cy) - ay * (bx * cz - bz * cx) + az * (bx * cy - by * cx)
    dots = (ax * bx + ay * by + az * bz) * c + (bx * cx + by * cy + bz * cz) * a + (cx * ax + cy * ay + cz * az) * b
    if det == 0.0:
        return 0.0
    return 2.0 * np.arctan2(det, a * b * c + dots)


@kernel(parallel=True)
def gather_clusters(corners, size, dipoles):
    """Centre, radius and area vector of every ``size`` triangles (F,3,3), as rows of ``dipoles`` (C,7)."""
    for n in prange(len(dipoles)):
        first, last = np.int64(n) * size, min((np.int64(n) + 1) * size, len(corners))
        centre, vector = np.zeros(3), np.zeros(3)
        for t in range(first, last):
            u, w = corners[t, 1] - corners[t, 0], corners[t, 2] - corners[t, 0]
            for c in range(3):
                a, b = (c + 1) % 3, (c + 2) % 3
                vector[c] += 0.5 * (u[a] * w[b] - u[b] * w[a])
                centre[c] += (corners[t, 0, c] + corners[t, 1, c] + corners[t, 2, c]) / (3.0 * (last - first))
        radius = 0.0
        for t in range(first, last):
            for k in range(3):
                radius = max(radius, np.sqrt(np.sum((corners[t, k] - centre) ** 2)))
        dipoles[n, :3], dipoles[n, 3], dipoles[n, 4:] = centre, radius, vector


@kernel(parallel=True)
def winding_slice(corners, size, dipoles, z, out):
    """Winding numbers at the cell centres (i + 1/2, j + 1/2, z) into ``out`` (ny,nx)."""
    ny, nx = out.shape
    for j in prange(ny):
        y = j + 0.5
        for i in range(nx):
            x, total = i + 0.5, 0.0
            for n in range(len(dipoles)):
                dx, dy, dz = dipoles[n, 0] - x, dipoles[n, 1] - y, dipoles[n, 2] - z
                square = dx * dx + dy * dy + dz * dz
                if square > FAR * FAR * dipoles[n, 3] * dipoles[n, 3]:
                    along = dx * dipoles[n, 4] + dy * dipoles[n, 5] + dz * dipoles[n, 6]
                    total += along / (square * np.sqrt(square))
                    continue
                for t in range(n * size, min((n + 1) * size, len(corners))):
                    total += solid_angle(corners[t, 0], corners[t, 1], corners[t, 2], x, y, z)
            out[j, i] = total / (4.0 * np.pi)
