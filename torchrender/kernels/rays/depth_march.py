"""Where a ray is along its projection into a depth image, and where it meets a triangle.

Inverse depth is linear along the projection of a ray, so its depth at each step of a march is exact.
Source: specification 03, section 7 (algorithm 7), and 12.2.
"""

from __future__ import annotations

import math

from torchrender.kernels.compile import kernel

CLEAR, HIT, UNKNOWN = 0, 1, 2
EDGE = 1e-7  # barycentric slack: rays along a shared edge hit one of its triangles


@kernel(inline=True)
def cross_triangle(vertices, faces, triangle, p, d):
    """Ray parameter and weights of the second and third corner where a ray meets a triangle's plane; +inf if never."""
    a, b, c = faces[triangle, 0], faces[triangle, 1], faces[triangle, 2]
    e0 = vertices[b, 0] - vertices[a, 0]
    e1 = vertices[b, 1] - vertices[a, 1]
    e2 = vertices[b, 2] - vertices[a, 2]
    f0 = vertices[c, 0] - vertices[a, 0]
    f1 = vertices[c, 1] - vertices[a, 1]
    f2 = vertices[c, 2] - vertices[a, 2]
    h0, h1, h2 = d[1] * f2 - d[2] * f1, d[2] * f0 - d[0] * f2, d[0] * f1 - d[1] * f0
    determinant = e0 * h0 + e1 * h1 + e2 * h2
    if determinant == 0.0:
        return math.inf, 0.0, 0.0
    s0, s1, s2 = p[0] - vertices[a, 0], p[1] - vertices[a, 1], p[2] - vertices[a, 2]
    q0, q1, q2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
    u = (s0 * h0 + s1 * h1 + s2 * h2) / determinant
    v = (d[0] * q0 + d[1] * q1 + d[2] * q2) / determinant
    t = (f0 * q0 + f1 * q1 + f2 * q2) / determinant
    return t, u, v


@kernel(inline=True)
def depth_at(k1, k2, along):
    """Camera depth of a ray at share ``along`` of its projection."""
    return 1.0 / (k1 + k2 * along)


@kernel(inline=True)
def length_at(piece, along):
    """Ray parameter at share ``along`` of the projection of a piece."""
    t0, t1, z0, z1 = piece
    return t0 + (t1 - t0) * along * z0 / (z1 + along * (z0 - z1))


@kernel(inline=True)
def clip(position, rate, low, high, first, last):
    """The part of [first, last] in which ``position + along rate`` lies in [low, high]."""
    if rate == 0.0:
        return (first, last) if low <= position <= high else (1.0, 0.0)
    a, b = (low - position) / rate, (high - position) / rate
    return max(first, min(a, b)), min(last, max(a, b))


@kernel(inline=True)
def project(matrix, p, d, t, z):
    """Pixel coordinates of a ray at parameter ``t``, where its camera depth is ``z``."""
    a, b, c = p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2]
    u = (matrix[0, 0] * a + matrix[0, 1] * b + matrix[0, 2] * c + matrix[0, 3]) / z
    v = (matrix[1, 0] * a + matrix[1, 1] * b + matrix[1, 2] * c + matrix[1, 3]) / z
    return u, v
