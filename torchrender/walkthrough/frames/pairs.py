"""Which photos see the same surfaces, and what corresponds in two of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchrender.walkthrough.frames.prepare import Capture
from torchrender.walkthrough.frames.record import Array

GRID = (12, 9)
LEAST_SHARE = 0.03


def overlaps(capture: Capture) -> Array:
    """(N,N) share of what photo i sees (on a coarse grid) that lies in the picture of photo j and is not hidden
    there."""
    count, (height, width) = len(capture), capture.size
    columns = ((np.arange(GRID[0]) + 0.5) * width / GRID[0]).astype(int)
    rows = ((np.arange(GRID[1]) + 0.5) * height / GRID[1]).astype(int)
    row, column = (g.reshape(-1) for g in np.meshgrid(rows, columns, indexing="ij"))
    inverse = capture.camera_from_world
    depth = capture.depth[:, row, column]
    share = np.zeros((count, count))
    small = np.ascontiguousarray(capture.depth[:, ::4, ::4])
    for i in range(count):
        known = np.isfinite(depth[i]) & (depth[i] > 0)
        if not known.any():
            continue
        world = capture.points(i, row[known], column[known]) @ capture.pose[i, :3, :3].T + capture.pose[i, :3, 3]
        camera = world @ inverse[:, :3, :3].transpose(0, 2, 1) + inverse[:, None, :3, 3]
        z = camera[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = camera[..., 0] / z * capture.lens[:, 0, None] + capture.lens[:, 2, None]
            v = camera[..., 1] / z * capture.lens[:, 1, None] + capture.lens[:, 3, None]
        inside = (z > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        a = np.where(inside, v, 0).astype(int) // 4
        b = np.where(inside, u, 0).astype(int) // 4
        there = small[np.arange(count)[:, None], a, b]
        share[i] = (inside & (np.abs(there - z) < 0.1 * z)).mean(axis=1) * known.mean()
    np.fill_diagonal(share, 0.0)
    return share


def partners(share: Array, most: int) -> list[Array]:
    """For each photo the photos that it overlaps with, most first."""
    both = np.maximum(share, share.T)
    found = []
    for row in both:
        order = np.argsort(-row, kind="stable")[:most]
        found.append(np.ascontiguousarray(order[row[order] >= LEAST_SHARE]).astype(np.int64))
    return found


@dataclass(frozen=True, eq=False)
class Matches:
    """K points of photo i seen in photo j."""

    world: Array  # (K,3) by photo i
    there: Array  # (K,3) by photo j, world
    normal: Array  # (K,3) of photo j, world
    row: Array  # (K,) pixels of photo i
    column: Array
    u: Array  # (K,) where they fall in photo j
    v: Array
    depth: Array  # (K,) in photo j


def random_pixels(capture: Capture, i: int, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Rows and columns of known pixels away from edges."""
    height, width = capture.size
    rows, columns = rng.integers(2, max(height - 2, 3), 3 * count), rng.integers(2, max(width - 2, 3), 3 * count)
    z = capture.depth[i, rows, columns]
    good = np.isfinite(z) & (z > 0) & (capture.guard[i, rows, columns] == 0)
    return rows[good][:count], columns[good][:count]


def match(capture: Capture, i: int, j: int, pixels: tuple[Array, Array], limit: float) -> Matches:
    """Points of photo i at ``pixels`` that photo j sees too: depths that differ by less than ``limit`` times depth."""
    rows, columns = pixels
    world = capture.points(i, rows, columns) @ capture.pose[i, :3, :3].T + capture.pose[i, :3, 3]
    turn, eye = capture.pose[j, :3, :3], capture.pose[j, :3, 3]
    fx, fy, cx, cy = capture.lens[j]
    z, (u, v), (a, b), there, good = _looked_at(capture, world, j)
    good &= np.abs(np.where(good, there, 0.0) - z) < limit * np.abs(z)
    a, b, there, u, v = a[good], b[good], there[good], u[good], v[good]
    # Depth there belongs to the pixel's centre: onto the ray through (u, v) along the tangent plane.
    centre = np.stack([(b + 0.5 - cx) / fx, (a + 0.5 - cy) / fy, np.ones(len(a))], axis=1) * there[:, None]
    normal = capture.normal[j, a, b].astype(np.float64)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return Matches(world[good], centre @ turn.T + eye, normal @ turn.T, rows[good], columns[good], u, v, there)


def _looked_at(
    capture: Capture, world: Array, j: int
) -> tuple[Array, tuple[Array, Array], tuple[Array, Array], Array, Array]:
    """Where points (N,3) fall into photo j.

    Depth of the points, pixel coordinates, rows and columns, depth that the photo has there, and whether it has one.
    """
    height, width = capture.size
    camera = (world - capture.pose[j, :3, 3]) @ capture.pose[j, :3, :3]
    z = camera[:, 2]
    fx, fy, cx, cy = capture.lens[j]
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = camera[:, 0] / z * fx + cx, camera[:, 1] / z * fy + cy
    inside = (z > 0) & (u >= 1) & (u < width - 1) & (v >= 1) & (v < height - 1)
    a, b = np.where(inside, v, 1).astype(int), np.where(inside, u, 1).astype(int)
    there = capture.depth[j, a, b].astype(np.float64)
    good = inside & (there > 0) & np.isfinite(there) & (capture.guard[j, a, b] == 0)
    return z, (u, v), (a, b), there, good


def seen_through(
    capture: Capture, near: list[Array], seed: int = 0, *, samples: int = 400, limit: float = 0.05
) -> float:
    """Share of points that another photo looks past, by more than ``limit`` times depth, among those that fall into it.

    Surfaces cannot be looked through: with right poses, intrinsics and depth scale it is next to nothing. Points that
    the other photo sees something before say nothing, they may be hidden.
    """
    rng = np.random.default_rng(seed)
    past = total = 0
    for i in range(len(capture)):
        rows, columns = random_pixels(capture, i, samples, rng)
        world = capture.points(i, rows, columns) @ capture.pose[i, :3, :3].T + capture.pose[i, :3, 3]
        for j in near[i][:6].tolist():
            z, _, _, there, good = _looked_at(capture, world, j)
            past += int((good & (there > (1 + limit) * z)).sum())
            total += int(good.sum())
    return past / total if total else 0.0
