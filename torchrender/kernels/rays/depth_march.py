"""Rays marched through a depth image, pixel by pixel along their projection.

Inverse depth is linear along the projection of a ray, so its depth at each step is exact. Where the ray goes behind the
image, the triangles that the nearest texels name are intersected with the ray itself: the image decides which surfaces
come into question, not where they are. A ray that passes behind the rim of something nearer, beyond the thickness that
one step explains, goes on. Blocks of texels that lie behind the ray as a whole are stepped over.
Source: specification 03, section 7 (algorithm 7), and 12.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

CLEAR, HIT, UNKNOWN = 0, 1, 2
BLOCK = 8  # texels along the edge of a block
GROUP = 128  # rays that a thread takes at a time
EDGE = 1e-7  # barycentric slack: rays along a shared edge hit one of its triangles


class DepthImage(NamedTuple):
    """A depth image of a perspective camera."""

    depth: np.ndarray  # (H,W) float32, +inf where empty
    triangle: np.ndarray  # (H,W) int64, -1 where empty
    blocks: np.ndarray  # (H/BLOCK,W/BLOCK) smallest depth of each block
    matrix: np.ndarray  # (3,4) from world to homogeneous pixels
    near: float
    footprint: float  # pixel size per unit of depth


class MarchedHits(NamedTuple):
    """What became of N rays."""

    state: np.ndarray  # (N,) uint8 CLEAR, HIT or UNKNOWN
    t: np.ndarray  # (N,) ray parameter
    triangle: np.ndarray  # (N,) int64
    barycentric: np.ndarray  # (N,2) float32 weights of the second and third corner
    steps: np.ndarray  # (1 + N / GROUP,) int64 texel visits


class Piece(NamedTuple):
    """Part of a ray: first and last parameter, and the camera depths there."""

    t0: float
    t1: float
    z0: float
    z1: float


class Path(NamedTuple):
    """Projection of a piece: where it begins, how far it goes, and the share of it within the image."""

    u: float
    v: float
    du: float
    dv: float
    first: float
    last: float


@kernel(parallel=True)
def nearest_depths(depth, blocks):
    """Smallest depth of each block of texels, (H/BLOCK, W/BLOCK) rounded up."""
    for by in prange(blocks.shape[0]):
        for bx in range(blocks.shape[1]):
            least = np.float32(np.inf)
            for y in range(by * BLOCK, min((by + 1) * BLOCK, depth.shape[0])):
                for x in range(bx * BLOCK, min((bx + 1) * BLOCK, depth.shape[1])):
                    least = min(least, depth[y, x])
            blocks[by, bx] = least


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
def nearest_candidate(scene, triangle, x, y, p, d, t_low):
    """The nearest hit beyond ``t_low`` among the triangles of the 3 x 3 texels about (x, y)."""
    vertices, faces = scene
    best, best_u, best_v, found = math.inf, 0.0, 0.0, np.int64(-1)
    last = np.int64(-1)
    for j in range(max(y - 1, 0), min(y + 2, triangle.shape[0])):
        for i in range(max(x - 1, 0), min(x + 2, triangle.shape[1])):
            k = triangle[j, i]
            if k < 0 or k == last:
                continue
            last = k
            t, u, v = cross_triangle(vertices, faces, k, p, d)
            if t > t_low and t < best and u >= -EDGE and v >= -EDGE and u + v <= 1.0 + EDGE:
                best, best_u, best_v, found = t, u, v, k
    return best, best_u, best_v, found


@kernel(inline=True)
def on_surface(scene, k, p, d, t_low, t_high):
    """Where the ray meets the plane of triangle ``k``, kept within the step in which it went behind it, and weights
    kept within the triangle."""
    t, u, v = cross_triangle(scene[0], scene[1], k, p, d)
    if not (t >= t_low and t <= t_high):
        t = t_high
    u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
    if u + v > 1.0:
        u, v = u / (u + v), v / (u + v)
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


@kernel(inline=True)
def leave_block(start, rate, block):
    """Share of the projection at which it leaves a row or column of blocks."""
    if rate == 0.0:
        return math.inf
    return ((block + (1.0 if rate > 0.0 else 0.0)) * BLOCK - start) / rate


@kernel(inline=True)
def march(scene, image, epsilon, p, d, ends):
    """One ray: ``ends`` = first and last parameter. Returns what happened, (t, weights, triangle), and steps."""
    matrix, near = image.matrix, image.near
    nothing = (math.inf, 0.0, 0.0, np.int64(-1))
    t0, t1 = ends
    hz = matrix[2, 0] * p[0] + matrix[2, 1] * p[1] + matrix[2, 2] * p[2] + matrix[2, 3]
    dz = matrix[2, 0] * d[0] + matrix[2, 1] * d[1] + matrix[2, 2] * d[2]
    z0, z1 = hz + t0 * dz, hz + t1 * dz
    known = z1 >= near
    if z0 < near:
        if z1 <= near:
            return UNKNOWN, nothing, 0
        t0, z0 = t0 + (near - z0) / dz, near
    elif z1 < near:
        t1, z1 = (near - hz) / dz, near
    u0, v0 = project(matrix, p, d, t0, z0)
    u1, v1 = project(matrix, p, d, t1, z1)
    first, last = clip(u0, u1 - u0, 0.0, np.float64(image.depth.shape[1]), 0.0, 1.0)
    first, last = clip(v0, v1 - v0, 0.0, np.float64(image.depth.shape[0]), first, last)
    if last < first:
        return UNKNOWN, nothing, 0
    known = known and first <= 0.0 and last >= 1.0
    path = Path(u0, v0, u1 - u0, v1 - v0, first, last)
    return step(scene, image, epsilon, p, d, Piece(t0, t1, z0, z1), path, known)


@kernel(inline=True)
def step(scene, image, epsilon, p, d, piece, path, known):
    """March along the ``path`` of a ``piece`` of a ray."""
    depth, triangle, blocks = image.depth, image.triangle, image.blocks
    rows, columns = depth.shape
    t0, _, z0, z1 = piece
    u0, v0, du, dv, first, last = path
    k1, k2 = 1.0 / z0, 1.0 / z1 - 1.0 / z0
    count = max(1.0, math.ceil(max(abs(du), abs(dv))))
    m, end = max(1.0, math.ceil(first * count)), math.floor(last * count + 1e-9)
    before, behind, steps = first, False, 0
    while m <= end:
        along = m / count
        x, y = min(max(int(u0 + along * du), 0), columns - 1), min(max(int(v0 + along * dv), 0), rows - 1)
        z = depth_at(k1, k2, along)
        steps += 1
        # Where the ray leaves the block, and whether it is before everything in it until then.
        ahead = min(leave_block(u0, du, x // BLOCK), leave_block(v0, dv, y // BLOCK))
        leave = min(max(math.floor(min(ahead * count, end)), m), end)
        if max(z, depth_at(k1, k2, leave / count)) < blocks[y // BLOCK, x // BLOCK] * (1.0 + epsilon):
            before, behind = leave / count, False
            m = leave + 1.0
            continue
        surface = np.float64(depth[y, x])
        if z < surface * (1.0 + epsilon):
            before, behind = along, False
            m += 1.0
            continue
        t, a, b, k = nearest_candidate(scene, triangle, x, y, p, d, t0)
        if k >= 0 and t <= length_at(piece, min(along + 2.0 / count, 1.0)) * (1.0 + 1e-9):
            return HIT, (t, a, b, k), steps
        explained = abs(z - depth_at(k1, k2, max(along - 1.0 / count, 0.0)))
        if not behind and z - surface <= max(4.0 * image.footprint * surface, explained):
            k = triangle[y, x]
            low, high = length_at(piece, before), length_at(piece, along)
            t, a, b = on_surface(scene, k, p, d, low, high)
            return HIT, (t, a, b, k), steps
        behind, known = True, False
        before = along
        m += 1.0
    return (CLEAR if known else UNKNOWN), (math.inf, 0.0, 0.0, np.int64(-1)), steps


@kernel(parallel=True)
def march_rays(scene, image, epsilon, rays, rows, ends, found):
    """March rays ``rows`` (N,) of ``rays`` = (origins, directions) and fill ``found``, row by row of N.

    ``scene`` = (vertices, faces); ``image``: :class:`DepthImage`; ``ends`` = (first, last (N,) ray parameter);
    ``found``: :class:`MarchedHits`.
    """
    origins, directions = rays
    state, t, triangle, barycentric, steps = found
    for group in prange((rows.shape[0] + GROUP - 1) // GROUP):
        total = 0
        for n in range(group * GROUP, min((group + 1) * GROUP, rows.shape[0])):
            i = rows[n]
            p = (origins[i, 0], origins[i, 1], origins[i, 2])
            d = (directions[i, 0], directions[i, 1], directions[i, 2])
            kind, hit, visits = march(scene, image, epsilon, p, d, (ends[0], ends[1][n]))
            state[n] = kind
            t[n], triangle[n] = hit[0], hit[3]
            barycentric[n, 0], barycentric[n, 1] = hit[1], hit[2]
            total += visits
        steps[group] = total
