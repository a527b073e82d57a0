"""Repair of poses, and of colour that does not lie over its depth.

Poses: Gauss-Newton over all photos at once. Residuals are distances of points of one photo to the tangent planes of
another, and differences of their brightness, which hold what slides along walls (as in Park, Zhou and Koltun, *Colored
point cloud registration revisited*, 2017). Small corrections only: the given poses are a prior.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from torchrender.walkthrough.frames.pairs import Matches, match, random_pixels
from torchrender.walkthrough.frames.prepare import Capture, Progress, quiet
from torchrender.walkthrough.frames.record import Array

SAMPLES = 1200
PARTNERS = 10
ROUNDS = 6
BRIGHTNESS = 0.04
"""Difference of brightness, of 1, that weighs as much as a distance of the depth's noise."""

ALIGNED = 2e-4
"""Median disagreement, share of depth, below which poses are left as they are."""


def disagreement(capture: Capture, near: list[Array], seed: int = 0) -> float:
    """Median distance to the tangent plane of another photo, over depth."""
    rng = np.random.default_rng(seed)
    found = []
    for i in range(len(capture)):
        pixels = random_pixels(capture, i, 300, rng)
        for j in near[i][:4]:
            m = match(capture, i, int(j), pixels, 0.05)
            found.append(np.abs(((m.world - m.there) * m.normal).sum(1)) / np.maximum(m.depth, 1e-9))
    values = np.concatenate(found) if found else np.zeros(0)
    return float(np.median(values)) if len(values) else 0.0


def register(
    capture: Capture, near: list[Array], seed: int = 0, progress: Progress = quiet
) -> tuple[float, float, float]:
    """Repair the poses in place; returns the disagreement before and after, and the largest shift of a camera."""
    before = disagreement(capture, near, seed)
    if len(capture) < 2 or before < ALIGNED:
        return before, before, 0.0
    first = capture.pose.copy()
    diagonal = capture.diagonal()
    best, best_pose = before, first
    for turn in progress(range(ROUNDS), "register"):
        blur = 3.0 if turn < ROUNDS // 2 else 1.2
        images = _brightness(capture, blur)
        step = _solve(capture, near, images, np.random.default_rng(seed + turn), 0.04 if turn < 2 else 0.02)
        _apply(capture.pose, step, capture.pose[:, :3, 3].mean(0))
    after = disagreement(capture, near, seed)
    moved = float(np.linalg.norm(capture.pose[:, :3, 3] - first[:, :3, 3], axis=1).max())
    if after > best or moved > 0.05 * diagonal:
        capture.pose[:] = best_pose
        return before, before, 0.0
    return before, after, moved


def _brightness(capture: Capture, blur: float) -> Array:
    """(N,H,W) float32 grey in [0,1], blurred."""
    made = np.zeros(capture.depth.shape, np.float32)
    for i in range(len(capture)):
        grey = cv2.cvtColor(capture.color[i], cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
        made[i] = cv2.GaussianBlur(grey, (0, 0), blur)
    return made


def locate(capture: Capture, photo: Capture, seed: int = 0) -> Array:
    """(4,4) pose of a single photo among photos whose poses were repaired: its own pose alone is corrected, by the same
    residuals, against the nearest of them. As it was given where that does not make depths agree better."""
    gap = np.linalg.norm(capture.pose[:, :3, 3] - photo.pose[0, :3, 3], axis=1) / max(capture.diagonal(), 1e-9)
    turn = 1.0 - (capture.pose[:, :3, 2] * photo.pose[0, :3, 2]).sum(1)
    chosen = np.sort(np.argsort(gap + turn, kind="stable")[:PARTNERS])
    fields = ("pose", "lens", "color", "depth", "normal", "guard", "noise")
    parts: dict[str, Any] = {
        name: np.concatenate([getattr(photo, name)[:1], getattr(capture, name)[chosen]]) for name in fields
    }
    both = replace(photo, names=("",) * (1 + len(chosen)), **parts)
    near = [np.arange(1, 1 + len(chosen))] + [np.zeros(1, np.int64)] * len(chosen)
    fixed = np.arange(1 + len(chosen)) > 0
    first = both.pose[0].copy()
    before = disagreement(both, near, seed)
    for number in range(ROUNDS):
        images = _brightness(both, 3.0 if number < ROUNDS // 2 else 1.2)
        step = _solve(both, near, images, np.random.default_rng(seed + number), 0.04 if number < 2 else 0.02, fixed)
        _apply(both.pose[:1], step[:1], both.pose[:, :3, 3].mean(0))
    return both.pose[0] if disagreement(both, near, seed) <= before else first


def _apply(pose: Array, step: Array, centre: Array) -> None:
    """Turn about the centre and shift, in place."""
    for i in range(len(pose)):
        rotation = Rotation.from_rotvec(step[i, :3]).as_matrix()
        pose[i, :3, :3] = rotation @ pose[i, :3, :3]
        pose[i, :3, 3] = rotation @ (pose[i, :3, 3] - centre) + centre + step[i, 3:]


def _solve(
    capture: Capture,
    near: list[Array],
    images: Array,
    rng: np.random.Generator,
    limit: float,
    fixed: Array | None = None,
) -> Array:
    """(N,6) rotations and shifts about the mean eye; zero where ``fixed`` (N,)."""
    count = len(capture)
    matrix, right = np.zeros((count, 6, count, 6)), np.zeros((count, 6))
    centre = capture.pose[:, :3, 3].mean(0)
    scale = max(np.median(capture.noise), 1e-6)
    for i in range(count):
        pixels = random_pixels(capture, i, SAMPLES, rng)
        for j in near[i][:PARTNERS].tolist():
            m = match(capture, i, j, pixels, limit)
            if len(m.depth) < 50:
                continue
            spread = np.maximum(scale * m.depth**2, 1e-3 * m.depth)
            distance = ((m.world - m.there) * m.normal).sum(1) / spread
            parts = [(m.normal / spread[:, None], distance)]
            parts.append(_photometric(capture, j, images, m, i))
            for direction, residual in parts:
                cut = 3.0 * max(1.4826 * float(np.median(np.abs(residual))), 0.5)
                weight = np.where(np.abs(residual) < cut, (1 - (residual / cut) ** 2) ** 2, 0.0)
                jacobian = np.concatenate([np.cross(m.world - centre, direction), direction], axis=1)
                block = (jacobian * weight[:, None]).T @ jacobian
                slope = (jacobian * (weight * residual)[:, None]).sum(0)
                matrix[i, :, i] += block
                matrix[j, :, j] += block
                matrix[i, :, j] -= block
                matrix[j, :, i] -= block
                right[i] -= slope
                right[j] += slope
    flat = matrix.reshape(6 * count, 6 * count)
    usual = np.median(np.diag(flat)[np.diag(flat) > 0]) if (np.diag(flat) > 0).any() else 1.0
    prior = np.full(count, 1e-3) if fixed is None else np.where(fixed, 1e9, 1e-3)
    flat[np.arange(6 * count), np.arange(6 * count)] += np.repeat(prior, 6) * usual
    return np.linalg.solve(flat, right.reshape(-1)).reshape(count, 6)


def _photometric(capture: Capture, j: int, images: Array, m: Matches, i: int) -> tuple[Array, Array]:
    """Directions (K,3) and residuals (K,) of brightness, the median difference taken out."""
    image = images[j]
    u, v = np.clip(m.u, 1.0, image.shape[1] - 2.0), np.clip(m.v, 1.0, image.shape[0] - 2.0)
    here = images[i][m.row, m.column]
    there = _sample(image, u, v)
    du = (_sample(image, u + 1, v) - _sample(image, u - 1, v)) / 2
    dv = (_sample(image, u, v + 1) - _sample(image, u, v - 1)) / 2
    turn, eye = capture.pose[j, :3, :3], capture.pose[j, :3, 3]
    camera = (m.world - eye) @ turn
    z = camera[:, 2]
    fx, fy = capture.lens[j, :2]
    across = np.stack([du * fx / z, dv * fy / z, -(du * fx * camera[:, 0] + dv * fy * camera[:, 1]) / z**2], axis=1)
    ratio = np.median(here / np.maximum(there, 1e-3)) if len(here) else 1.0
    ratio = float(np.clip(ratio, 0.5, 2.0))
    return ratio * across @ turn.T / BRIGHTNESS, (ratio * there - here) / BRIGHTNESS


def _sample(image: Array, u: Array, v: Array) -> Array:
    """Bilinear at pixel coordinates with centres at +0.5."""
    x, y = np.clip(u - 0.5, 0, image.shape[1] - 1.001), np.clip(v - 0.5, 0, image.shape[0] - 1.001)
    a, b = x.astype(int), y.astype(int)
    s, t = x - a, y - b
    top = image[b, a] * (1 - s) + image[b, a + 1] * s
    return top * (1 - t) + (image[b + 1, a] * (1 - s) + image[b + 1, a + 1] * s) * t


# --------------------------------------------------------------- colour over depth

REACH = 6
CELLS = 3
CLEAR = 1.10
"""Strength of colour edges at the best shift over that at none, from which on a shift is believed."""


def color_shift(capture: Capture) -> Array:
    """(2,3) affine map from a depth pixel to its colour pixel: identity unless edges of colour lie clearly elsewhere.

    The mean colour gradient at edges of depth is compared over shifts of up to 6 pixels, in nine parts of the picture,
    over all photos; parts with a clear peak vote for a shift and a scale.
    """
    height, width = capture.size
    span = 2 * REACH + 1
    scores, counts = np.zeros((CELLS, CELLS, span, span)), np.zeros((CELLS, CELLS))
    for i in range(0, len(capture), max(len(capture) // 24, 1)):
        grey = cv2.GaussianBlur(cv2.cvtColor(capture.color[i], cv2.COLOR_RGB2GRAY), (0, 0), 1.0)
        gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
        depth = capture.depth[i]
        known = (depth > 0) & np.isfinite(depth)
        z = np.where(known, depth, 1e9)
        behind = cv2.dilate(np.where(known, depth, 0), np.ones((3, 3)))
        # The near side of steps from surface to surface: borders of what is known are no edges of things.
        edge = known & (behind > 1.08 * z) & (cv2.erode(known.astype(np.uint8), np.ones((5, 5))) > 0)
        rows, columns = np.nonzero(edge[REACH:-REACH, REACH:-REACH])
        rows, columns = rows + REACH, columns + REACH
        cy, cx = rows * CELLS // height, columns * CELLS // width
        np.add.at(counts, (cy, cx), 1)
        for a in range(span):
            for b in range(span):
                np.add.at(scores[:, :, a, b], (cy, cx), gradient[rows + a - REACH, columns + b - REACH])
    found = _peaks(scores, counts, height, width)
    if found is None:
        return np.eye(2, 3)
    return found


def _peaks(scores: Array, counts: Array, height: int, width: int) -> Array | None:
    total = scores.sum((0, 1))
    peak = np.unravel_index(int(total.argmax()), total.shape)
    zero = total[REACH, REACH]
    if counts.sum() < 2000 or total[peak] < CLEAR * zero or max(abs(p - REACH) for p in peak) < 2:
        return None
    at, shifts = [], []
    for y in range(CELLS):
        for x in range(CELLS):
            score = scores[y, x]
            a, b = np.unravel_index(int(score.argmax()), score.shape)
            if (
                counts[y, x] > 300
                and score[a, b] > CLEAR * np.median(score)
                and 0 < a < 2 * REACH
                and 0 < b < 2 * REACH
            ):
                at.append(((x + 0.5) * width / CELLS, (y + 0.5) * height / CELLS))
                shifts.append((b - REACH, a - REACH))
    shift = np.array([peak[1] - REACH, peak[0] - REACH], np.float64)
    made = np.eye(2, 3)
    made[:, 2] = shift
    if len(at) >= 6:
        place, move = np.array(at), np.array(shifts, np.float64)
        for axis in range(2):
            slope, offset = np.polyfit(place[:, axis], move[:, axis], 1)
            if np.abs(slope * place[:, axis] + offset - move[:, axis]).mean() < 1.0 and abs(slope) < 0.05:
                made[axis, axis], made[axis, 2] = 1 + slope, offset
    return made


def shift_color(capture: Capture, affine: Array) -> None:
    """Move the colours of all photos over their depth, in place."""
    capture.color_shift = affine
    if np.array_equal(affine, np.eye(2, 3)):
        return
    for i in range(len(capture)):
        capture.color[i] = shifted(capture.color[i], affine)


def shifted(color: Array, affine: Array) -> Array:
    """One picture moved so."""
    # warpAffine counts from pixel centres at whole numbers.
    moved = affine.copy()
    moved[:, 2] += affine[:, :2] @ np.array([0.5, 0.5]) - 0.5
    size = (color.shape[1], color.shape[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(color, moved, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))
