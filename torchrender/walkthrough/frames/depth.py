"""Depth images: their noise, edges and normals."""

from __future__ import annotations

import cv2
import kornia
import numpy as np
import torch

from torchrender.walkthrough.frames.record import Array

STEPS = (1, 2, 3, 4, 6, 8, 12)
"""Pixels between the samples of a second difference; noisy depth needs wide ones."""


def noise_of(depth: Array, lag: int = 1) -> float:
    """Standard deviation of inverse depth from its fourth differences along rows, in which planes vanish, and smoothly
    curved surfaces nearly do."""
    known = (depth > 0) & np.isfinite(depth)
    q = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0).astype(np.float64)
    width = q.shape[1] - 4 * lag
    if width < 1:
        return 0.0
    parts = [q[:, k * lag : k * lag + width] for k in range(5)]
    whole = np.logical_and.reduce([known[:, k * lag : k * lag + width] for k in range(5)])
    fourth = np.abs(parts[0] - 4 * parts[1] + 6 * parts[2] - 4 * parts[3] + parts[4])
    values = fourth[whole & (fourth < 0.1 * parts[2])]
    return float(np.median(values)) * 1.4826 / 70**0.5 if len(values) else 0.0


def smoothing(noise: float, depth: float, focal: float, crease: float) -> int:
    """Step of second differences at which the noise stays below a third of the crease's threshold."""
    for step in STEPS:
        width = 2 * (step // 2) + 1
        if noise * 6**0.5 / width * depth * focal / step <= crease / 3:
            return step
    return STEPS[-1]


def median_depth(depth: Array, known: Array) -> Array:
    """5x5 median of inverse depth; what was unknown or background stays so."""
    q = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0).astype(np.float32)
    found = cv2.medianBlur(q, 5)
    # At borders of what is known the median may be 0.
    good = known & (np.abs(found - q) < 0.1 * q)
    return np.where(good, 1.0 / np.where(good, found, 1.0), depth).astype(np.float32)


def box_inverse(depth: Array, width: int) -> tuple[Array, Array]:
    """Inverse depth averaged over known pixels of a square, and the known mask."""
    known = (depth > 0) & np.isfinite(depth)
    q = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0)
    if width <= 1:
        return q, known
    total = cv2.boxFilter(q, cv2.CV_64F, (width, width), normalize=False, borderType=cv2.BORDER_CONSTANT)
    count = cv2.boxFilter(known.astype(np.float64), -1, (width, width), normalize=False, borderType=cv2.BORDER_CONSTANT)
    mean = total / np.maximum(count, 1)
    # Not over steps: what differs much from the mean keeps its own value.
    return np.where(known & (np.abs(mean - q) < 0.02 * q), mean, q), known


def step_edges(depth: Array, tau: float) -> Array:
    """(H,W) bool: |dz| / min(z) > tau to a neighbour, or a border of background or of what is known."""
    known = (depth > 0) & np.isfinite(depth)
    z = np.where(known, depth, 0.0)
    edges = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        a, b = (z[:-1], z[1:]) if axis == 0 else (z[:, :-1], z[:, 1:])
        ka, kb = (known[:-1], known[1:]) if axis == 0 else (known[:, :-1], known[:, 1:])
        step = (np.abs(a - b) > tau * np.minimum(a, b)) & ka & kb | (ka != kb)
        if axis == 0:
            edges[:-1] |= step
            edges[1:] |= step
        else:
            edges[:, :-1] |= step
            edges[:, 1:] |= step
    return edges


def normals(depth: Array, lens: Array, step: int) -> Array:
    """(H,W,3) unit normals towards the camera, by kornia from inverse depth averaged over ``step``; 0 if unknown."""
    q, known = box_inverse(depth, 2 * step + 1 if step > 1 else 1)
    z = torch.from_numpy(np.where(known, 1.0 / np.where(known, q, 1.0), 0.0).astype(np.float32))[None, None]
    fx, fy, cx, cy = (float(v) for v in lens)
    # kornia puts pixel centres at whole numbers.
    k = torch.tensor([[[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1.0]]])
    found = kornia.geometry.depth.depth_to_normals(z, k)[0].permute(1, 2, 0).numpy()
    x = (np.arange(depth.shape[1]) + 0.5 - cx) / fx
    y = (np.arange(depth.shape[0]) + 0.5 - cy) / fy
    along = found[..., 0] * x + found[..., 1] * y[:, None] + found[..., 2]
    found = np.where((along > 0)[..., None], -found, found)
    return np.where(known[..., None], np.nan_to_num(found), 0.0)


def one_sided_normals(depth: Array, lens: Array, step: int) -> Array:
    """(H,W,3) as :func:`normals`, but never across a depth step: of the differences to both sides, taken over ``step``
    pixels, the smaller one counts, and none where both are steps.

    Inverse depth is a u + b v + c on a plane of normal K^T (a, b, c) (specification 13, section 3).
    """
    known = (depth > 0) & np.isfinite(depth)
    q = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0)
    slopes = []
    for axis in (1, 0):
        ahead, behind = np.roll(q, -step, axis) - q, q - np.roll(q, step, axis)
        best = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
        slopes.append(np.where(np.abs(best) < 0.03 * step * q, best, 0.0) / step)
    a, b = slopes
    fx, fy, cx, cy = lens
    u, v = np.arange(q.shape[1]) + 0.5, (np.arange(q.shape[0]) + 0.5)[:, None]
    found = np.stack([a * fx, b * fy, a * cx + b * cy + (q - a * u - b * v)], axis=2)
    length = np.linalg.norm(found, axis=2, keepdims=True)
    # Inverse depth is positive: the normal of n.X = d with d > 0 faces away.
    return np.where(known[..., None], -found / np.maximum(length, 1e-30), 0.0)
