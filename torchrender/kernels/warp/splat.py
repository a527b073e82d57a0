"""Samples of depth images as discs in another camera's image: exact ray-disc intersection in each pixel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.warp import Canvas, keep

ROWS = 8
EDGE_ON = 0.1  # cosine below which a disc no longer grows


class Samples(NamedTuple):
    """The samples of B images."""

    depth: np.ndarray  # (B,H,W) float32
    normal: np.ndarray  # (B,H,W,3) float32
    poses: np.ndarray  # (B,3,4): target camera space = z M[:, :3] (u, v, 1) + M[:, 3]
    rays: np.ndarray  # (B,3,3) world direction of a pixel
    footprints: np.ndarray  # (B,) of the cameras at unit depth
    bias: np.ndarray  # (B,) factors of 1/depth


class Target(NamedTuple):
    """The camera that is drawn from."""

    rotation: np.ndarray  # (3,3) camera from world
    intrinsics: np.ndarray  # (3,3)
    near: float


class Disc(NamedTuple):
    """One sample in the target camera's frame."""

    centre: tuple[float, float, float]
    normal: tuple[float, float, float]
    radius: float


@kernel()
def multiply(matrix, x, y, z):
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@kernel()
def disc_radius(ray, normal, depth, footprint, scale):
    """0.5 sqrt(2) g(z) scale / max(|n.d|, 0.1), d the unit ray (specification 02, section 3.5)."""
    length = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
    facing = abs(ray[0] * normal[0] + ray[1] * normal[1] + ray[2] * normal[2]) / length
    return math.sqrt(0.5) * footprint * depth * scale / max(facing, EDGE_ON)


@kernel()
def box(disc, target, width, height):
    """Pixels that a sphere can reach: first and last column and row."""
    centre, _, radius = disc
    intrinsics, near = target.intrinsics, target.near
    depth = max(centre[2] - radius, near)
    x0, x1, y0, y1 = 0.0, width - 1.0, 0.0, height - 1.0
    if centre[2] - radius >= near:
        fx, fy, skew = intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 1]
        u = (fx * centre[0] + skew * centre[1]) / centre[2]
        v = fy * centre[1] / centre[2]
        # |X/Z - X0/Z0| <= radius (1 + |X0/Z0|) / (Z0 - radius)
        reach_v = radius * (fy + abs(v)) / depth
        reach_u = radius * (fx + abs(skew) + abs(u)) / depth
        u += intrinsics[0, 2]
        v += intrinsics[1, 2]
        x0, x1 = max(x0, u - reach_u - 0.5), min(x1, u + reach_u - 0.5)
        y0, y1 = max(y0, v - reach_v - 0.5), min(y1, v + reach_v - 0.5)
    if x0 > x1 or y0 > y1:
        return 0, 0, -1, -1
    return math.ceil(x0), math.ceil(y0), math.floor(x1), math.floor(y1)


@kernel()
def draw_disc(disc, target, bias, number, canvas):
    """One disc; left out if seen from behind."""
    centre, normal, radius = disc
    intrinsics, near = target.intrinsics, target.near
    offset = normal[0] * centre[0] + normal[1] * centre[1] + normal[2] * centre[2]
    if offset >= 0.0 or centre[2] + radius < near:
        return
    x0, y0, x1, y1 = box(disc, target, canvas.width, canvas.height)
    for v in range(y0, y1 + 1):
        dy = (v + 0.5 - intrinsics[1, 2]) / intrinsics[1, 1]
        for u in range(x0, x1 + 1):
            dx = (u + 0.5 - intrinsics[0, 2] - intrinsics[0, 1] * dy) / intrinsics[0, 0]
            slope = normal[0] * dx + normal[1] * dy + normal[2]
            if slope >= 0.0:
                continue
            z = offset / slope
            ex, ey, ez = z * dx - centre[0], z * dy - centre[1], z - centre[2]
            if z >= near and ex * ex + ey * ey + ez * ez <= radius * radius:
                keep(canvas.keys, v * canvas.width + u, bias / z, number)


@kernel(parallel=True)
def draw_splats(samples, target, scale, threads, canvas):
    """Draw every one of the :class:`Samples` as a disc for the :class:`Target`; ``scale``: factor of their radii."""
    depth, normal, poses, rays, footprints, bias = samples
    keys, across, down = canvas
    count, height, width = depth.shape
    blocks = (height + ROWS - 1) // ROWS
    counter = np.zeros(1, np.int64)
    for _ in prange(threads):
        onto = Canvas(keys, across, down)
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= count * blocks:
                break
            b, first = turn // blocks, (turn % blocks) * ROWS
            for j in range(first, min(first + ROWS, height)):
                for i in range(width):
                    z = np.float64(depth[b, j, i])
                    if not z < np.inf:
                        continue
                    n = (np.float64(normal[b, j, i, 0]), np.float64(normal[b, j, i, 1]), np.float64(normal[b, j, i, 2]))
                    ray = multiply(rays[b], i + 0.5, j + 0.5, 1.0)
                    radius = disc_radius(ray, n, z, footprints[b], scale)
                    m = poses[b]
                    p = multiply(m, z * (i + 0.5), z * (j + 0.5), z)
                    centre = (p[0] + m[0, 3], p[1] + m[1, 3], p[2] + m[2, 3])
                    facing = multiply(target.rotation, n[0], n[1], n[2])
                    number = (b * height + j) * width + i
                    draw_disc(Disc(centre, facing, radius), target, bias[b], number, onto)
