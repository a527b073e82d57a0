"""Which pixels of a photo show planes large enough to be drawn as such.

Inverse depth is affine on a plane, so its second differences vanish there and answer at steps and creases
(specification 13, section 3). With noisy depth they are taken over several pixels of averaged inverse depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from torchrender.walkthrough.frames.depth import box_inverse, smoothing, step_edges
from torchrender.walkthrough.frames.jobs import Jobs
from torchrender.walkthrough.frames.prepare import Capture, Progress, quiet
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.options import WalkthroughOptions

RANSAC_PLANES = 4
NOISY_PLANES = 10
"""The same where depth is noisy: creases drown, and what belongs to several planes stays one region."""

WIDEST = 3.0
"""Times the tolerance that pixels far away may be off their plane, where noise grows with the square of depth."""

HYPOTHESES = 48
SAMPLES = 160
"""Points that stand for a region when planes are merged and tested."""


@dataclass(frozen=True)
class Tolerances:
    """Distances to planes, scene units."""

    largest: float
    mean: float
    normal_deg: float  # of a pixel's normal to that of its plane
    diagonal: float

    @classmethod
    def of(cls, capture: Capture, options: WalkthroughOptions, disagreement: float = 0.0) -> Tolerances:
        """From the options, or where they say nothing from noise and disagreement of depths (shares of depth)."""
        diagonal = capture.diagonal()
        sample = capture.depth[:: max(len(capture) // 8, 1), ::9, ::9]
        known = sample[(sample > 0) & np.isfinite(sample)]
        middle = float(np.median(known)) if known.size else 1.0
        noise = (8.0 * capture.relative_noise + 2.0 * disagreement) * middle
        largest = min(max(noise, 0.0005 * diagonal), 0.005 * diagonal)
        if options.tau_max is not None:
            largest = options.tau_max * diagonal
        mean = 0.25 * largest if options.tau_avg is None else options.tau_avg * diagonal
        return cls(largest, mean, 8.0 if capture.exact else 18.0, diagonal)


@dataclass(frozen=True, eq=False)
class Fit:
    """A plane fitted in one photo, world space."""

    photo: int
    normal: Array  # (3,) unit, towards the camera
    offset: float  # normal . x = offset
    centroid: Array  # (3,)
    count: int
    points: Array  # (<= SAMPLES,3) some of its points
    footprint: float  # usual size of a pixel on it
    largest: float  # distance of its points to it: 99th percentile, with exact depth the maximum
    mean: float


def edge_map(capture: Capture, i: int, options: WalkthroughOptions) -> Array:
    """(H,W) bool: creases, steps, borders, and what is unknown."""
    depth = capture.depth[i]
    known = (depth > 0) & np.isfinite(depth)
    middle = float(np.median(depth[known])) if known.any() else 1.0
    step = smoothing(float(capture.noise[i]), middle, float(capture.lens[i, 0]), options.tau_crease)
    q, _ = box_inverse(depth, 2 * (step // 2) + 1)
    edges = step_edges(depth, options.tau_step) | ~known
    z = np.where(known, depth, 0.0)
    drowned = 3.0 * capture.noise[i] * 6**0.5 / (2 * (step // 2) + 1) * z * capture.lens[i, 0] / step
    # Where noise drowns creases, normals over wide windows and consensus have to tell planes apart.
    readable = drowned < options.tau_crease
    edges |= readable & (crease(q, z, float(capture.lens[i, 0]), step) > options.tau_crease)
    edges[[0, -1]] = True
    edges[:, [0, -1]] = True
    return edges


def crease(q: Array, z: Array, focal: float, step: int) -> Array:
    """(H,W) max(|q_uu|, |q_uv|, |q_vv|) z f / step: about the jump of the surface's slope; 0 within ``step`` of the
    border."""
    found = np.zeros(q.shape)
    s = step
    if min(q.shape) <= 2 * s:
        return found
    centre = q[s:-s, s:-s]
    uu = q[s:-s, 2 * s :] - 2 * centre + q[s:-s, : -2 * s]
    vv = q[2 * s :, s:-s] - 2 * centre + q[: -2 * s, s:-s]
    uv = (q[2 * s :, 2 * s :] - q[2 * s :, : -2 * s] - q[: -2 * s, 2 * s :] + q[: -2 * s, : -2 * s]) / 4
    inner = np.maximum(np.maximum(np.abs(uu), np.abs(vv)), np.abs(uv))
    found[s:-s, s:-s] = inner * z[s:-s, s:-s] * (focal / s)
    return found


def fit_plane(points: Array, weights: Array | None = None) -> tuple[Array, float, Array]:
    """Total least squares: unit normal, offset and centroid of points (K,3) float64."""
    w = np.ones(len(points)) if weights is None else weights
    total = float(w.sum())
    centroid = (points * w[:, None]).sum(0) / total
    away = points - centroid
    covariance = (away * w[:, None]).T @ away / total
    normal = np.linalg.eigh(covariance)[1][:, 0]
    return normal, float(normal @ centroid), centroid


def widening(capture: Capture, i: int, z: Array, tolerances: Tolerances) -> Array:
    """Factors of the tolerance at depths ``z``: 1, more where the noise of depth is larger than it."""
    return np.clip(5.0 * capture.noise[i] * z * z / tolerances.largest, 1.0, WIDEST)


def classify_all(
    capture: Capture, options: WalkthroughOptions, tolerances: Tolerances, progress: Progress = quiet
) -> list[Fit]:
    """The planes of all photos; ``capture.plane`` receives their rows in the list, -1 elsewhere."""
    fits: list[Fit] = []
    work = Jobs().ordered(lambda i: classify(capture, i, options, tolerances), range(len(capture)))
    for i, found in progress(work, "classify"):
        capture.plane[i][capture.plane[i] >= 0] += len(fits)
        fits += found
    return fits


def classify(capture: Capture, i: int, options: WalkthroughOptions, tolerances: Tolerances) -> list[Fit]:
    """The planes of photo ``i``; ``capture.plane[i]`` receives their rows in the list, -1 elsewhere."""
    edges = edge_map(capture, i, options)
    height, width = capture.size
    rows, columns = np.mgrid[0:height, 0:width]
    points = capture.points(i, rows.reshape(-1), columns.reshape(-1)).reshape(height, width, 3)
    normal = capture.normal[i].astype(np.float32)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-6)
    depth = np.where(np.isfinite(capture.depth[i]), capture.depth[i], 0.0)
    wide = widening(capture, i, depth.reshape(-1).astype(np.float64), tolerances)
    work = _Photo(capture, i, points, normal, wide, options, tolerances)
    count, labels = cv2.connectedComponents((~edges).astype(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    sizes = np.bincount(labels.reshape(-1), minlength=count)
    order = np.argsort(labels.reshape(-1), kind="stable")
    starts = np.concatenate([[0], np.cumsum(sizes)])
    plane = np.full(height * width, -1, np.int32)
    fits: list[Fit] = []
    rng = np.random.default_rng((options.seed, i))
    for label in np.nonzero(sizes >= options.n_min)[0]:
        if label == 0:
            continue
        inside = order[starts[label] : starts[label + 1]]
        for chosen, fit in work.planes_in(inside, rng):
            plane[chosen] = len(fits)
            fits.append(fit)
    found = plane.reshape(height, width)
    if fits:
        found = _absorb(found, fits, work)
    capture.plane[i] = found
    return fits


@dataclass(frozen=True, eq=False)
class _Photo:
    """One photo while it is classified."""

    capture: Capture
    i: int
    points: Array  # (H,W,3) camera space
    normal: Array  # (H,W,3) float32 camera space
    wide: Array  # (H*W,) factors of the tolerance
    options: WalkthroughOptions
    tolerances: Tolerances

    def planes_in(self, inside: Array, rng: np.random.Generator) -> list[tuple[Array, Fit]]:
        """The plane of a region (flat pixel numbers), or several if it is not one."""
        whole = self.test(inside, rng)
        if whole is not None:
            return [(inside, whole)]
        found: list[tuple[Array, Fit]] = []
        left = inside
        for _ in range(RANSAC_PLANES if self.capture.exact else NOISY_PLANES):
            if len(left) < 2 * self.options.n_min:
                break
            chosen = self._consensus(left, rng)
            if chosen is None:
                break
            fit = self.test(chosen, rng)
            if fit is None:
                break
            found.append((chosen, fit))
            left = np.setdiff1d(left, chosen, assume_unique=True)
        return found

    def test(self, inside: Array, rng: np.random.Generator) -> Fit | None:
        """A fit whose distances are small enough, or None."""
        p = self.points.reshape(-1, 3)[inside]
        sample = p if len(p) <= 20000 else p[rng.choice(len(p), 20000, replace=False)]
        weights = None if self.capture.exact else 1.0 / sample[:, 2] ** 4
        normal, offset, centroid = fit_plane(sample, weights)
        distance = np.abs(sample @ normal - offset) / widening(self.capture, self.i, sample[:, 2], self.tolerances)
        largest = float(distance.max() if self.capture.exact else np.percentile(distance, 99))
        mean = float(distance.mean())
        if largest > self.tolerances.largest or mean > self.tolerances.mean:
            return None
        if normal @ centroid > 0:
            normal = -normal
        facing = self.normal.reshape(-1, 3)[inside] @ normal
        if np.median(facing) < np.cos(np.radians(self.tolerances.normal_deg)):
            return None
        turn, eye = self.capture.pose[self.i, :3, :3], self.capture.pose[self.i, :3, 3]
        world = centroid @ turn.T + eye
        some = p[rng.choice(len(p), SAMPLES, replace=False)] if len(p) > SAMPLES else p
        z = np.median(p[:, 2])
        tilt = max(abs(float(normal @ centroid)) / float(np.linalg.norm(centroid)), 0.05)
        return Fit(
            photo=self.i,
            normal=turn @ normal,
            offset=float((turn @ normal) @ world),
            centroid=world,
            count=len(p),
            points=some @ turn.T + eye,
            footprint=float(z / self.capture.lens[self.i, 0] / tilt**0.5),
            largest=largest,
            mean=mean,
        )

    def _consensus(self, left: Array, rng: np.random.Generator) -> Array | None:
        """The largest connected set of pixels on the best plane through one of them."""
        p, n = self.points.reshape(-1, 3), self.normal.reshape(-1, 3)
        wide = self.wide
        some = left if len(left) <= 1500 else rng.choice(left, 1500, replace=False)
        seeds = rng.choice(left, min(HYPOTHESES, len(left)), replace=False)
        limit, cosine = 0.5 * self.tolerances.largest, np.cos(np.radians(self.tolerances.normal_deg))
        distance = np.abs(p[some] @ n[seeds].T - (p[seeds] * n[seeds]).sum(1)) / wide[some, None]
        votes = ((distance < limit) & (n[some] @ n[seeds].T > cosine)).sum(0)
        best = seeds[int(votes.argmax())]
        normal, offset = n[best].astype(np.float64), float(p[best] @ n[best])
        place, facing, width = p[left], n[left], limit * wide[left]
        # The first of the two rounds moves the plane a little: a share of the pixels is enough for it.
        few = slice(None, None, max(len(left) // 20000, 1))
        for part in (few, slice(None)):
            on_it = (np.abs(place[part] @ normal - offset) < width[part]) & (facing[part] @ normal > cosine)
            near = left[part][on_it]
            if len(near) * len(left) < self.options.n_min * len(place[part]):
                return None
            fitted, offset, centroid = fit_plane(p[near], None if self.capture.exact else 1.0 / p[near, 2] ** 4)
            normal = -fitted if fitted @ centroid > 0 else fitted
            offset = float(normal @ centroid)
        mask = np.zeros(self.normal.shape[:2], np.uint8)
        mask.reshape(-1)[near] = 1
        # Noise leaves gaps of single pixels: what they part is still one piece.
        whole = mask if self.capture.exact else cv2.dilate(mask, np.ones((3, 3), np.uint8))
        count, labels = cv2.connectedComponents(whole, connectivity=4)
        if count < 2:
            return None
        size = np.bincount(labels.reshape(-1), weights=mask.reshape(-1), minlength=count)
        size[0] = 0
        chosen = np.nonzero((labels.reshape(-1) == int(size.argmax())) & (mask.reshape(-1) > 0))[0]
        return chosen if len(chosen) >= self.options.n_min else None


def _absorb(plane: Array, fits: list[Fit], work: _Photo) -> Array:
    """Give edge pixels to planes near them that they lie on."""
    capture, i = work.capture, work.i
    turn, eye = capture.pose[i, :3, :3], capture.pose[i, :3, 3]
    normals = np.stack([turn.T @ f.normal for f in fits])
    offsets = np.array([f.offset - f.normal @ eye for f in fits])
    depth = capture.depth[i]
    known = np.isfinite(depth) & (depth > 0)
    middle = float(np.median(depth[known]))
    step = smoothing(float(capture.noise[i]), middle, float(capture.lens[i, 0]), work.options.tau_crease)
    spread = capture.noise[i] * np.where(known, depth, 0.0) ** 2
    limit = np.maximum(0.25 * work.tolerances.largest, np.minimum(3.0 * spread, work.tolerances.largest))
    found = plane.copy()
    for reach in (step + 1, 2 * step + 2):
        around = cv2.dilate((plane >= 0).astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
        open_ = np.nonzero((found < 0) & known & (around > 0))
        p = work.points[open_]
        best, choice = np.full(len(open_[0]), np.inf), np.full(len(open_[0]), -1)
        for dy in (-reach, 0, reach):
            for dx in (-reach, 0, reach):
                y = np.clip(open_[0] + dy, 0, plane.shape[0] - 1)
                x = np.clip(open_[1] + dx, 0, plane.shape[1] - 1)
                label = plane[y, x]
                gap = np.abs((p * normals[label]).sum(1) - offsets[label])
                closer = (label >= 0) & (gap < best)
                best, choice = np.where(closer, gap, best), np.where(closer, label, choice)
        good = best <= limit[open_]
        found[open_[0][good], open_[1][good]] = choice[good]
    return found
