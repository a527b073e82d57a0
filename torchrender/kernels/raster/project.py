"""Vertices into the image: homogeneous pixel coordinates, snapped positions, and the clusters that are in view.

Planes over the image come from the homogeneous coordinates (Olano and Greer 1997): no division by a vertex depth, so a
vertex behind the camera does no harm. The depth key is ``1/z`` (perspective) or ``-z`` (orthographic): linear in the
image, greater is nearer."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.lanes.vectors import LANES
from torchrender.kernels.raster.lanes.vertices import project_lanes

SUBPIXEL_BITS = 15
SUBPIXEL = 1 << SUBPIXEL_BITS
HALF = SUBPIXEL >> 1
GUARD = 1 << 14  # pixels around the image centre; with the bits above every edge function stays below 2**62
CULL_NONE, CULL_BACK, CULL_FRONT = 0, 1, 2
BLOCK = 256  # vertices projected or skipped together

NEEDS_CLIP = np.int64(-(2**63))  # in place of a snapped position: before the near plane or outside the guard band


@kernel(inline=True)
def snap(x, y):
    """Both fixed-point coordinates in one 64-bit integer."""
    return (np.int64(np.floor(x * SUBPIXEL + 0.5)) << 32) | (
        np.int64(np.floor(y * SUBPIXEL + 0.5)) & np.int64(0xFFFFFFFF)
    )


@kernel(inline=True)
def snapped_x(packed):
    return packed >> 32


@kernel(inline=True)
def snapped_y(packed):
    return (packed << 32) >> 32


@kernel()
def visible_clusters(bounds, planes):
    """Clusters whose box (C,2,3) meets the frustum given by planes (6,4): indices, and distance to the near plane."""
    count = bounds.shape[0]
    out = np.zeros(count, np.int64)
    distance = np.zeros(count)
    n = 0
    for c in range(count):
        inside = True
        for p in range(planes.shape[0]):
            reach = planes[p, 3]
            size = abs(planes[p, 3])
            for k in range(3):
                side = bounds[c, 1, k] if planes[p, k] > 0 else bounds[c, 0, k]
                reach += planes[p, k] * side
                size += abs(planes[p, k] * side)
            if reach < -1e-12 * size:
                inside = False
                break
        if inside:
            out[n] = c
            distance[n] = planes[4, 3]
            for k in range(3):
                side = bounds[c, 0, k] if planes[4, k] > 0 else bounds[c, 1, k]
                distance[n] += planes[4, k] * side
            n += 1
    return out[:n], distance[:n]


@kernel()
def area_in_view(bounds, runs, seen, scale, frame):
    """Pixels of squares over the diagonals of clusters, and how many triangles these have.

    ``seen``: clusters, and their distances to the near plane; ``scale``: pixels of a unit at depth 1.
    """
    chosen, distance = seen
    area, triangles = 0.0, np.int64(0)
    for n in range(chosen.shape[0]):
        c = chosen[n]
        square = 0.0
        for k in range(3):
            square += (bounds[c, 1, k] - bounds[c, 0, k]) ** 2
        size = math.sqrt(square)
        depth = 1.0 if frame.orthographic else frame.near + max(distance[n], 0.0) + 0.5 * size
        area += (size * scale / depth) ** 2
        triangles += runs[c, 1] - runs[c, 0]
    return area, triangles


@kernel()
def needed_blocks(chosen, starts, blocks, vertex_count):
    """Indices of the blocks of BLOCK vertices that the chosen clusters use; starts (C+1,) into blocks."""
    wanted = np.zeros((vertex_count + BLOCK - 1) // BLOCK, np.bool_)
    for c in chosen:
        for place in range(starts[c], starts[c + 1]):
            wanted[blocks[place]] = True
    return np.nonzero(wanted)[0]


@kernel(inline=True)
def project_block(vertices, block, matrix, eye, limits, out, packed):
    """One block of :func:`project_vertices`; ``limits``: near, whether orthographic."""
    near, orthographic = limits
    first, end = block * BLOCK, min((block + 1) * BLOCK, vertices.shape[0])
    whole = end - (end - first) % LANES
    fixed = (float(GUARD), float(SUBPIXEL), NEEDS_CLIP)
    for v in range(first, whole, LANES):
        project_lanes(vertices, np.uintp(v), (matrix, eye), (near, orthographic), out, fixed)
    for v in range(whole, end):
        x = vertices[v, 0] - eye[0]
        y = vertices[v, 1] - eye[1]
        z = vertices[v, 2] - eye[2]
        px = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z
        py = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z
        w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z
        out[v, 0] = px
        out[v, 1] = py
        out[v, 2] = w
        if not w >= near:
            packed[v, 3] = NEEDS_CLIP
            continue
        if not orthographic:
            px /= w
            py /= w
        if abs(px) < GUARD and abs(py) < GUARD:
            packed[v, 3] = snap(px, py)
        else:
            packed[v, 3] = NEEDS_CLIP


@kernel(parallel=True)
def project_vertices(vertices, blocks, matrix, eye, near, orthographic, out, packed):
    """Fill ``out`` (V,4) and its integer twin ``packed`` (the same memory) for the wanted blocks.

    ``matrix`` (3,3) takes a world vector from ``eye`` to (X, Y, z): perspective pixel = X/z, Y/z; orthographic
    pixel = X, Y. Pixels count from the image centre. Column 3 holds the snapped pixel position.
    """
    for b in prange(blocks.shape[0]):
        project_block(vertices, blocks[b], matrix, eye, (near, orthographic), out, packed)


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


@kernel(inline=True)
def greatest_key(points, faces, t, frame):
    """Key that no fragment of triangle ``t`` exceeds: that of its nearest corner, or of the near plane."""
    nearest = min(points[faces[t, 0], 2], min(points[faces[t, 1], 2], points[faces[t, 2], 2]))
    nearest = max(nearest, frame.near)
    return -nearest if frame.orthographic else 1.0 / nearest
