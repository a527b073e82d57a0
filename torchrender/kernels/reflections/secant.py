"""Algorithm 7 to the letter: rays marched through one depth image, whose colours they take.

The first texel step at which the ray is behind the image is a hit, whatever lies in between; its place is then refined
by bisection between that step and the one before. Source: specification 03, section 7.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.depth_march import HIT, UNKNOWN, depth_at, length_at, project

BISECTIONS = 4
GROUP = 128


class Painting(NamedTuple):
    """A depth image with colours."""

    depth: np.ndarray  # (H,W) float32, +inf where empty
    triangle: np.ndarray  # (H,W) int64
    color: np.ndarray  # (H,W,3) float32
    matrix: np.ndarray  # (3,4) from world to homogeneous pixels
    near: float
    footprint: float  # pixel size per unit of depth


class Painted(NamedTuple):
    """What N rays met."""

    state: np.ndarray  # (N,) uint8 HIT or UNKNOWN
    t: np.ndarray  # (N,) ray parameter
    triangle: np.ndarray  # (N,) int64
    color: np.ndarray  # (N,3) float32


@kernel(inline=True)
def texel_of(depth, u, v):
    """Row and column of the texel at a pixel position; row -1 outside."""
    x, y = np.int64(math.floor(u)), np.int64(math.floor(v))
    if x < 0 or y < 0 or x >= depth.shape[1] or y >= depth.shape[0]:
        return np.int64(-1), np.int64(-1)
    return y, x


@kernel(inline=True)
def is_behind(depth, epsilon, u, v, z):
    """A ray at depth ``z`` over a pixel position is behind the image."""
    y, x = texel_of(depth, u, v)
    return y >= 0 and z >= np.float64(depth[y, x]) * (1.0 + epsilon)


@kernel(inline=True)
def blend_color(image, u, v, z, out, i):
    """Bilinear colour of the texels whose depths lie within two footprints of ``z``; the nearest one if none does."""
    depth, color = image.depth, image.color
    x0, y0 = math.floor(u - 0.5), math.floor(v - 0.5)
    fx, fy = u - 0.5 - x0, v - 0.5 - y0
    total = 0.0
    out[i, 0] = out[i, 1] = out[i, 2] = np.float32(0.0)
    for j in range(2):
        for k in range(2):
            y, x = np.int64(y0) + j, np.int64(x0) + k
            if y < 0 or x < 0 or y >= depth.shape[0] or x >= depth.shape[1]:
                continue
            if abs(np.float64(depth[y, x]) - z) > 2.0 * image.footprint * z:
                continue
            weight = (fy if j == 1 else 1.0 - fy) * (fx if k == 1 else 1.0 - fx)
            total += weight
            for c in range(3):
                out[i, c] += np.float32(weight) * color[y, x, c]
    if total > 1e-6:
        for c in range(3):
            out[i, c] /= np.float32(total)
        return
    y, x = texel_of(depth, u, v)
    for c in range(3):
        out[i, c] = color[y, x, c]


@kernel(inline=True)
def search_ray(image, epsilon, p, d, ends):
    """Share of the projection at which a ray is hit, < 0: nowhere; the piece it counts along, and the pixel there."""
    matrix, near = image.matrix, image.near
    t0, t1 = ends
    hz = matrix[2, 0] * p[0] + matrix[2, 1] * p[1] + matrix[2, 2] * p[2] + matrix[2, 3]
    dz = matrix[2, 0] * d[0] + matrix[2, 1] * d[1] + matrix[2, 2] * d[2]
    z0, z1 = hz + t0 * dz, hz + t1 * dz
    missed = (-1.0, (t0, t1, 1.0, 1.0), (0.0, 0.0))
    if z0 < near:
        if z1 <= near:
            return missed
        t0, z0 = t0 + (near - z0) / dz, near
    elif z1 < near:
        t1, z1 = (near - hz) / dz, near
    u0, v0 = project(matrix, p, d, t0, z0)
    u1, v1 = project(matrix, p, d, t1, z1)
    piece, k1, k2 = (t0, t1, z0, z1), 1.0 / z0, 1.0 / z1 - 1.0 / z0
    count = max(1.0, math.ceil(max(abs(u1 - u0), abs(v1 - v0))))
    m = 1.0
    while m <= count:
        along = m / count
        if is_behind(image.depth, epsilon, u0 + along * (u1 - u0), v0 + along * (v1 - v0), depth_at(k1, k2, along)):
            low, high = (m - 1.0) / count, along
            for _ in range(BISECTIONS):
                middle = 0.5 * (low + high)
                u, v = u0 + middle * (u1 - u0), v0 + middle * (v1 - v0)
                if is_behind(image.depth, epsilon, u, v, depth_at(k1, k2, middle)):
                    high = middle
                else:
                    low = middle
            return high, piece, (u0 + high * (u1 - u0), v0 + high * (v1 - v0))
        m += 1.0
    return missed


@kernel(parallel=True)
def search_rays(image, epsilon, rays, ends, found):
    """March N rays = (origins, directions) between ``ends`` = (first, last (N,)) and fill ``found``."""
    depth, triangle, color, matrix, near, footprint = image
    origins, directions = rays
    state, t, number, paint = found
    for group in prange((origins.shape[0] + GROUP - 1) // GROUP):
        for i in range(group * GROUP, min((group + 1) * GROUP, origins.shape[0])):
            p = (origins[i, 0], origins[i, 1], origins[i, 2])
            d = (directions[i, 0], directions[i, 1], directions[i, 2])
            own = Painting(depth, triangle, color, matrix, near, footprint)
            along, piece, (u, v) = search_ray(own, epsilon, p, d, (ends[0], ends[1][i]))
            if along < 0.0:
                state[i], t[i], number[i] = UNKNOWN, math.inf, np.int64(-1)
                continue
            y, x = texel_of(depth, u, v)
            z = piece[2] * piece[3] / (piece[3] + along * (piece[2] - piece[3]))
            state[i], t[i], number[i] = HIT, length_at(piece, along), triangle[y, x]
            blend_color(own, u, v, z, paint, i)
