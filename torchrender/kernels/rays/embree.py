"""Float32 stand-ins that make Embree a safe bound: triangles grown in their planes, rays that start at the scene's box.

Every ray that meets a triangle also meets the grown one, whatever float32 rounds away. Embree's nearest hit of the
grown triangles therefore bounds the true nearest hit from below, up to ``SLACK``; the float64 tree settles the rest.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.bvh_build import HIGH, LOW, SCALE

GROW = 2e-5
"""Edges move out by this share of the scene's half extent: tens of times what float32 moves rays and vertices."""
SLACK = 1e-4
"""Embree's ray length is trusted to this share of the half extent: float32 noise over the cosine of grazing rays."""
BACK = 2e-5
"""Rays start earlier by this share of the half extent, so that rounding cannot put them past a surface."""
ROOM = 1e-3  # the box at which rays start and end is larger by this


@kernel()
def _length(x, y, z):
    """Length without overflow or underflow."""
    m = max(abs(x), abs(y), abs(z))
    return m * np.sqrt((x / m) ** 2 + (y / m) ** 2 + (z / m) ** 2) if m > 0 else 0.0


def grown_triangles(corners: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (T,3,3) float32, relative to the frame, of triangles whose edges lie at least GROW further out.

    Also (T,) bool: the triangle's incircle is smaller than GROW, so that float32 cannot tell its sides apart.
    """
    # Edges from the uncentred corners: small triangles of a large scene keep their shape.
    p = corners.reshape(-1, 3, 3)
    edges = np.stack([p[:, 2] - p[:, 1], p[:, 0] - p[:, 2], p[:, 1] - p[:, 0]], axis=1)
    largest = np.abs(edges).max(axis=(1, 2), keepdims=True)
    edges /= largest
    sides = np.sqrt((edges * edges).sum(axis=2))
    normals = np.cross(edges[:, 1], edges[:, 2])
    double_area = np.sqrt((normals * normals).sum(axis=1))
    around = sides.sum(axis=1)
    radius = largest[:, 0, 0] * double_area / around
    thin = radius <= GROW
    p = p - frame[:3]
    # Scaling about the incentre moves all three edges out by the same distance.
    centre = (p * (sides / around[:, None])[:, :, None]).sum(axis=1, keepdims=True)
    out = (centre + (1.0 + GROW / np.maximum(radius, GROW))[:, None, None] * (p - centre)).astype(np.float32)
    if thin.any():
        out[thin] = _cover(p[thin], edges[thin], sides[thin], largest[thin, :, 0], normals[thin])
    return out, thin


def _cover(p: np.ndarray, edges: np.ndarray, sides: np.ndarray, largest: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Right triangles over the grown rectangles round thin triangles, whose scaling would have no limit."""
    row = np.arange(len(p))
    tip = sides.argmax(axis=1)
    along = edges[row, tip] / sides[row, tip, None]
    axis = np.zeros_like(along)
    axis[row, np.abs(along).argmin(axis=1)] = 1.0
    noise = np.abs(normals).max(axis=1, keepdims=True) < 1e-12
    up = np.cross(np.where(noise, np.cross(along, axis), normals), along)
    up /= np.sqrt((up * up).sum(axis=1, keepdims=True))
    start = p[row, (tip + 1) % 3]
    height = ((p[row, tip] - start) * up).sum(axis=1, keepdims=True)
    up = np.where(height < 0, -up, up)
    low = start - GROW * (along + up)
    long = 2.0 * (sides[row, tip, None] * largest + 2.0 * GROW) * along
    return np.stack([low, low + long, low + 2.0 * (np.abs(height) + 2.0 * GROW) * up], axis=1)


@kernel(parallel=True)
def aim(frame, origins, directions, span):
    """Float32 rays through the scene's box.

    Returns:
        Origins and unit directions (N,3) float32 relative to the frame, lengths to search (N,) float32 (-1: the ray
        passes the scene by), and (N,2) float64 with the ray parameter at the new origin and that of one unit of length.
    """
    n = origins.shape[0]
    start, toward = np.zeros((n, 3), np.float32), np.zeros((n, 3), np.float32)
    reach = np.full(n, -1.0, np.float32)
    unit = np.zeros((n, 2))
    scale = frame[SCALE]
    for r in prange(n):
        o, d = origins[r], directions[r]
        length = _length(d[0], d[1], d[2]) * scale
        near, far = span[r]
        for k in range(3):
            step = d[k] * scale
            step = 1.0 / step if abs(step) > 1e-290 else np.copysign(1e290, step)
            at = o[k] * scale - frame[k]
            a, b = (frame[LOW + k] - ROOM - at) * step, (frame[HIGH + k] + ROOM - at) * step
            near, far = max(near, min(a, b)), min(far, max(a, b))
        if not near < far:
            toward[r, 0] = 1.0
            continue
        near -= BACK / length
        for k in range(3):
            start[r, k] = o[k] * scale - frame[k] + near * (d[k] * scale)
            toward[r, k] = d[k] * scale / length
        reach[r] = (far - near) * length + SLACK
        unit[r, 0], unit[r, 1] = near, 1.0 / length
    return start, toward, reach, unit
