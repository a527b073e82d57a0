"""Every piece of surface from the photo that sampled it best (specification 13, section 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchrender.kernels.walkthrough.density import Comparison, compare, restore
from torchrender.walkthrough.frames.prepare import Capture, Progress, quiet
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.options import WalkthroughOptions

LEAST_FACING = 0.1
"""Cosine, about, below which an estimated normal is not believed: a point would become too large."""

COLOR_GAP = 40.0
"""Codes by which the colours of photos may differ and still be blended: beyond it something shines or has moved."""

EDGE_VOTES = 3
"""Photos that must see through a sample at an edge of noisy depth for it to be left out: it hangs in the air."""


@dataclass(frozen=True, eq=False)
class Samples:
    """M points that are not on planes, world space."""

    position: Array  # (M,3) float64
    normal: Array  # (M,3) float32 unit
    color: Array  # (M,3) uint8 sRGB codes
    log_density: Array  # (M,) float32 of pixels per unit of area


@dataclass(frozen=True, eq=False)
class Comparisons:
    """What the comparison found."""

    keep: Array  # (N,H,W) uint8
    samples: Samples
    count: Array  # (P,) kept pixels of each plane
    area: Array  # (P,) sum of 1/density over them: the area that they cover
    kept_share: float  # kept pixels over all with depth
    restored: int
    hanging: int  # samples left out


def moves(capture: Capture, i: int, others: Array) -> Array:
    """(P,3,4) camera_j from camera_i."""
    return np.ascontiguousarray((capture.camera_from_world[others] @ capture.pose[i])[:, :3])


def sample_density(capture: Capture, i: int, rows: Array, columns: Array) -> Array:
    """(K,) pixels per unit of area: fx fy |n.X| / z^3."""
    p = capture.points(i, rows, columns)
    n = capture.normal[i, rows, columns].astype(np.float64)
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1.0)
    facing = np.maximum(np.abs((n * p).sum(1)), LEAST_FACING * p[:, 2])
    return np.asarray(capture.lens[i, 0] * capture.lens[i, 1] * facing / p[:, 2] ** 3)


def compare_density(
    capture: Capture, near: list[Array], planes: int, options: WalkthroughOptions, progress: Progress = quiet
) -> Comparisons:
    """Keep each pixel unless another photo sampled its surface more densely; equal ones go to the earlier photo.

    A second look restores pixels that nobody stands for. Colours and depths of points are means over the photos that
    agree, weighted by density.
    """
    count, (height, width) = len(capture), capture.size
    keep = np.zeros((count, height, width), np.uint8)
    settings = Comparison(options.tau_z, 2.0, options.eta, options.blend_power, COLOR_GAP)
    photos = capture.photos
    exact, parts, hanging, known = capture.exact, [], 0, 0
    outputs = tuple(np.zeros(s, d) for s, d in (((height, width, 3), np.uint8), ((height, width), np.float32),
                                                ((height, width), np.uint8)))  # fmt: skip
    for i in progress(range(count), "compare density"):
        others = near[i] if options.compare else near[i][:0]
        compare(i, others, moves(capture, i, others), photos, settings, (keep[i], *outputs))
        known += int(((capture.depth[i] > 0) & np.isfinite(capture.depth[i])).sum())
        blended, fused, through = outputs
        if not exact:
            loose = (keep[i] != 0) & (capture.plane[i] < 0) & (through >= EDGE_VOTES)
            hanging += int(loose.sum())
            keep[i][loose] = 0
        rows, columns = np.nonzero((keep[i] != 0) & (capture.plane[i] < 0))
        scale = fused[rows, columns] / capture.depth[i, rows, columns]
        parts.append(_samples(capture, i, rows, columns, blended[rows, columns], scale))
    restored = 0
    if options.compare:
        again = np.zeros((height, width), np.uint8)
        for i in progress(range(count), "restore"):
            restore(i, near[i], moves(capture, i, near[i]), photos, keep, options.tau_z, again)
            lost = (again != 0) & ((capture.guard[i] == 0) | exact)
            # At once, so that two photos that both lost a place do not both get it back.
            keep[i][lost] = 1
            restored += int(lost.sum())
            rows, columns = np.nonzero(lost & (capture.plane[i] < 0))
            parts.append(_samples(capture, i, rows, columns, capture.color[i, rows, columns], np.ones(len(rows))))
    number, area = _areas(capture, keep, planes)
    samples = Samples(*(np.concatenate([getattr(p, n) for p in parts]) for n in Samples.__dataclass_fields__))
    share = float(keep.sum(dtype=np.int64)) / max(known, 1)
    return Comparisons(keep, samples, number, area, share, restored, hanging)


def _samples(capture: Capture, i: int, rows: Array, columns: Array, color: Array, scale: Array) -> Samples:
    turn, eye = capture.pose[i, :3, :3], capture.pose[i, :3, 3]
    n = capture.normal[i, rows, columns].astype(np.float64)
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1.0)
    return Samples(
        position=capture.points(i, rows, columns) * scale[:, None] @ turn.T + eye,
        normal=(n @ turn.T).astype(np.float32),
        color=np.ascontiguousarray(color),
        log_density=np.log(sample_density(capture, i, rows, columns)).astype(np.float32),
    )


def _areas(capture: Capture, keep: Array, planes: int) -> tuple[Array, Array]:
    number, area = np.zeros(planes, np.int64), np.zeros(planes)
    for i in range(len(capture)):
        rows, columns = np.nonzero((keep[i] != 0) & (capture.plane[i] >= 0))
        if not len(rows):
            continue
        row = capture.plane[i, rows, columns]
        number += np.bincount(row, minlength=planes)
        area += np.bincount(row, weights=1.0 / sample_density(capture, i, rows, columns), minlength=planes)
    return number, area
