"""The float64 watertight triangle test, and the rules by which one hit is better than another.

Source: Woop, Benthin and Wald, "Watertight ray/triangle intersection", JCGT 2013. The edge functions of two
neighbouring triangles are exact negatives of each other at their shared edge, and rounding can only turn them into
zero, which counts as a hit; so no ray slips through a shared edge or vertex.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.compile import kernel

TIE = 1e-12
"""Hits whose ray parameters differ by less than this, relatively, are one surface; the lowest triangle id wins."""
BLOCK = 64
"""Rays handed out to a thread at a time."""
LANES = 64
"""Strided sequences of blocks that threads share."""


class Rays(NamedTuple):
    """N rays and where hits count; ``t`` is in units of the direction's length."""

    origins: np.ndarray  # (N,3) float64
    directions: np.ndarray  # (N,3) float64, not zero
    span: np.ndarray  # (N,2) float64: hits lie strictly between the two
    ignore: np.ndarray  # (N,) int32 triangle id that is no hit, or -1
    cull: bool  # triangles whose right-hand normal points along the ray are no hits
    any_hit: bool  # stop at any hit


class Shear(NamedTuple):
    """Axes with the direction's largest last, and what turns the ray into that axis, seen from its origin."""

    x: int
    y: int
    z: int
    ox: float
    oy: float
    oz: float
    sx: float
    sy: float
    sz: float


@kernel(inline=True)
def shear_of(origins, directions, r, scale):
    """Axes with the direction's largest last, winding kept, and the shear that turns the ray into that axis."""
    # Scalars, not row views: views count references, which two threads fight over.
    dx, dy, dz = abs(directions[r, 0]), abs(directions[r, 1]), abs(directions[r, 2])
    z = 0
    if dy > dx:
        z = 1
    if dz > max(dx, dy):
        z = 2
    x, y = (z + 1) % 3, (z + 2) % 3
    if directions[r, z] < 0:
        x, y = y, x
    step = 1.0 / directions[r, z]
    ox, oy, oz = origins[r, x] * scale, origins[r, y] * scale, origins[r, z] * scale
    return Shear(x, y, z, ox, oy, oz, directions[r, x] * step, directions[r, y] * step, step / scale)


@kernel(inline=True)
def hit_triangle(points, a, b, c, shear):
    """Determinant (0: no hit; > 0: front face), ray parameter and weights of the second and third vertex.

    Args:
        points: flat float64 coordinates, times the frame's scale; ``a``, ``b``, ``c`` are where the corners start.
        shear: :class:`Shear` of the ray.
    """
    x, y, z, ox, oy, oz, sx, sy, sz = shear
    az, bz, cz = points[a + z] - oz, points[b + z] - oz, points[c + z] - oz
    ax, ay = points[a + x] - ox - sx * az, points[a + y] - oy - sy * az
    bx, by = points[b + x] - ox - sx * bz, points[b + y] - oy - sy * bz
    cx, cy = points[c + x] - ox - sx * cz, points[c + y] - oy - sy * cz
    u, v, w = cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax
    if (u < 0 or v < 0 or w < 0) and (u > 0 or v > 0 or w > 0):
        return 0.0, 0.0, 0.0, 0.0
    det = u + v + w
    if det == 0:
        return 0.0, 0.0, 0.0, 0.0
    return det, sz * (u * az + v * bz + w * cz) / det, v / det, w / det


@kernel(inline=True)
def row_length(directions, r):
    """Length of row ``r`` without overflow or underflow."""
    x, y, z = directions[r, 0], directions[r, 1], directions[r, 2]
    m = max(abs(x), max(abs(y), abs(z)))
    if 1e-100 < m < 1e100:
        return np.sqrt(x * x + y * y + z * z)
    return m * np.sqrt((x / m) ** 2 + (y / m) ** 2 + (z / m) ** 2) if m > 0 else 0.0
