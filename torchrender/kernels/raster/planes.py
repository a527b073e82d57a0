"""Planes over the image, in homogeneous pixel coordinates (Olano and Greer 1997): no division by a vertex depth,
so a vertex behind the camera does no harm. The depth key is ``1/z`` (perspective) or ``-z`` (orthographic): linear in
the image, greater is nearer."""

from __future__ import annotations

import math

from torchrender.kernels.compile import kernel


@kernel(inline=True)
def cofactors(points, faces, t, k, orthographic):
    """Edge normal opposite to corner ``k`` in homogeneous pixel coordinates: cross(q[k+1], q[k+2])."""
    a, b = faces[t, (k + 1) % 3], faces[t, (k + 2) % 3]
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    aw = 1.0 if orthographic else points[a, 2]
    bw = 1.0 if orthographic else points[b, 2]
    return ay * bw - aw * by, aw * bx - ax * bw, ax * by - ay * bx


@kernel(inline=True)
def determinant(points, faces, t, n, orthographic):
    a = faces[t, 0]
    return points[a, 0] * n[0] + points[a, 1] * n[1] + (1.0 if orthographic else points[a, 2]) * n[2]


@kernel(inline=True)
def key_plane(points, faces, t, frame):
    """(x, y, constant, least, greatest) of the key over the image; a triangle seen edge-on has its mean key."""
    near, orthographic = frame.near, frame.orthographic
    n0 = cofactors(points, faces, t, 0, orthographic)
    n1 = cofactors(points, faces, t, 1, orthographic)
    n2 = cofactors(points, faces, t, 2, orthographic)
    z0, z1, z2 = points[faces[t, 0], 2], points[faces[t, 1], 2], points[faces[t, 2], 2]
    nearest, farthest = max(min(z0, min(z1, z2)), near), max(z0, max(z1, z2))
    low = -farthest if orthographic else 1.0 / farthest
    high = -nearest if orthographic else 1.0 / nearest
    g0 = g1 = g2 = 1.0
    if orthographic:
        g0, g1, g2 = -z0, -z1, -z2
    det = determinant(points, faces, t, n0, orthographic)
    scale = 1.0 / det
    x = (n0[0] * g0 + n1[0] * g1 + n2[0] * g2) * scale
    y = (n0[1] * g0 + n1[1] * g1 + n2[1] * g2) * scale
    c = (n0[2] * g0 + n1[2] * g1 + n2[2] * g2) * scale
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(c)):
        x, y, c = 0.0, 0.0, 0.5 * (low + high)
    return x, y, c, low, high


@kernel(inline=True)
def barycentric_planes(points, faces, t, orthographic):
    """Planes over the image of the second and third weight times the key; a third each where seen edge-on."""
    n0 = cofactors(points, faces, t, 0, orthographic)
    n1 = cofactors(points, faces, t, 1, orthographic)
    n2 = cofactors(points, faces, t, 2, orthographic)
    scale = 1.0 / determinant(points, faces, t, n0, orthographic)
    ux, uy, uc = n1[0] * scale, n1[1] * scale, n1[2] * scale
    vx, vy, vc = n2[0] * scale, n2[1] * scale, n2[2] * scale
    if not math.isfinite(ux + uy + uc + vx + vy + vc):
        ux = uy = vx = vy = 0.0
        uc = vc = 1.0 / 3.0 if orthographic else 1.0 / (3.0 * points[faces[t, 0], 2])
    return ux, uy, uc, vx, vy, vc
