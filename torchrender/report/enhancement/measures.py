"""What stands in for readers of pictures: contrast, level, ridges, overshoot."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.report.enhancement.baselines import high_pass
from torchrender.report.enhancement.objects import Subject

GRAZING, FRONT = (0.15, 0.4), (0.7, 2.0)
"""Cosines to the eye of the two regions."""

RIDGES = 0.05
"""Share of the surface that counts as ridges and valleys: that of the strongest principal curvature."""


def gain(subject: Subject, made: Tensor, region: tuple[float, float]) -> float:
    """Contrast in a region, over that of the plain picture."""
    chosen = (subject.facing > region[0]) & (subject.facing < region[1]) & subject.inner
    if int(chosen.sum()) < 20:
        return float("nan")
    before, after = (high_pass(p, subject.seen.covered)[chosen].std() for p in (subject.plain, made))
    return float(after / before)


def mean_shift(subject: Subject, made: Tensor) -> float:
    """Change of the mean level over the object."""
    return float((made - subject.plain)[subject.seen.covered].mean().abs())


def overshoot(subject: Subject, made: Tensor, weight: float) -> float:
    """99.9th percentile of the change beside creases: within 4 pixels of where faces meet at 30 degrees and more.

    NaN if there are none."""
    normal = subject.seen.geometric_normal[0]
    crease = torch.zeros(normal.shape[:2], dtype=torch.bool)
    for axis in (0, 1):
        turn = (normal.narrow(axis, 1, normal.shape[axis] - 1) * normal.narrow(axis, 0, normal.shape[axis] - 1)).sum(-1)
        crease.narrow(axis, 0, normal.shape[axis] - 1).logical_or_(turn < 0.866)
    near = torch.nn.functional.max_pool2d(crease[None, None].float(), 9, 1, 4)[:, 0] > 0
    chosen = near & subject.inner
    change = (made - weight * subject.plain).abs()[chosen]
    return float(change.quantile(0.999)) if change.numel() else float("nan")


def ridge_mask(subject: Subject) -> Tensor:
    """(1,H,W) bool: pixels of the vertices with the strongest principal curvature, by libigl."""
    import igl

    geometry = subject.scene.geometry
    vertices, faces = geometry.vertices.numpy(), geometry.faces.numpy().astype(np.int64)
    first, second = igl.principal_curvature(vertices, faces)[2:4]
    size = torch.from_numpy(np.maximum(np.abs(first), np.abs(second)))
    size = torch.where(torch.isfinite(size), size, 0.0)
    strong = size >= size.quantile(1 - RIDGES) if len(size) < 1 << 24 else size > 0
    corners = geometry.faces[subject.seen.triangle.clamp_min(0)].long()
    weights = subject.seen.barycentric
    nearest = torch.cat([1 - weights.sum(-1, keepdim=True), weights], dim=-1).argmax(dim=-1, keepdim=True)
    return strong[corners.gather(-1, nearest)[..., 0]] & subject.seen.covered


def ridge_score(subject: Subject, made: Tensor, weight: float, ridges: Tensor) -> float:
    """Area under the ROC curve of the size of the change as a detector of ridges, within the object."""
    inside = subject.inner
    score = (made - weight * subject.plain).abs()[inside]
    label = ridges[inside]
    positive, negative = int(label.sum()), int((~label).sum())
    if not positive or not negative:
        return float("nan")
    rank = torch.zeros(len(score), dtype=torch.float64)
    rank[score.argsort()] = torch.arange(1.0, len(score) + 1.0, dtype=torch.float64)
    return float((rank[label].sum() - positive * (positive + 1) / 2) / (positive * negative))
