"""What enhancement may do beside creases and outlines, where contrast would flip (specification 10, section 9)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.enhancement.surface_image import SurfaceImage

SHARP = 0.866
"""Cosine between faces of neighbouring pixels below which they meet in a crease: 30 degrees."""

STEP = 0.05
"""Difference of inverse depth, as a share, from which on neighbours lie on two sides of an outline."""

REACH, FADE = 5.0, 6.0
"""Pixels around creases that the bound holds in, and pixels over which it ends: no line shows where it does."""

STRONGEST = 0.999
"""Quantile of the changes beside creases that counts as the largest: a single pixel must not set the bound."""


def crease_distance(surface: SurfaceImage) -> Tensor:
    """(B,H,W) float32 pixels to the nearest crease or outline, counted along rows, columns and diagonals; as far as
    the picture is large where there is none."""
    normal = surface.geometric_normal
    nearness = torch.where(surface.covered, 1.0 / surface.depth, 0.0)
    crease = torch.zeros(nearness.shape, dtype=torch.bool)
    for axis in (1, 2):
        count = nearness.shape[axis] - 1
        here, there = (nearness.narrow(axis, n, count) for n in (0, 1))
        turn = (normal.narrow(axis, 0, count) * normal.narrow(axis, 1, count)).sum(dim=-1)
        greater = torch.maximum(here, there)
        edge = ((turn < SHARP) | ((here - there).abs() > STEP * greater)) & (greater > 0)
        crease.narrow(axis, 0, count).logical_or_(edge)
        crease.narrow(axis, 1, count).logical_or_(edge)
    return torch.stack([torch.from_numpy(_distance_to(c.numpy())) for c in crease])


def _distance_to(mask: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """(H,W) float32 pixels to the nearest of ``mask`` (H,W) bool."""
    if not mask.any():
        return np.full(mask.shape, sum(mask.shape), np.float32)
    import cv2  # slow to import, and few pictures need it

    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_C, 3))


def bound_overshoot(plain: Tensor, made: Tensor, surface: SurfaceImage, share: float) -> Tensor:
    """``made`` (B,H,W,C) changed no more from ``plain`` beside creases than by ``share`` of the largest change there.

    What is smaller stays; away from creases, over a few pixels, everything does. The largest change of each picture is
    the 99.9th percentile of those within ``REACH`` of its creases; what stands within that of nothing changes most of
    all, at a grazing view, and does not count unless there is nothing else. What the bound cuts off has no derivative.
    """
    distance = crease_distance(surface)
    change = made - plain
    size = change.detach().abs().numpy()
    bound = torch.full_like(distance, torch.finfo(torch.float32).max)
    for b in range(len(bound)):
        covered = surface.covered[b].numpy()
        near = covered & (distance[b].numpy() <= REACH)
        inner = near & (_distance_to(~covered) > REACH)
        beside = size[b][inner if inner.any() else near].reshape(-1)
        if len(beside):
            rank = min(int(STRONGEST * len(beside)), len(beside) - 1)
            most = float(np.partition(beside, rank)[rank])
            left = (1.0 - (distance[b] - REACH).clamp_min(0.0) / FADE).clamp_min(0.0)
            bound[b] = torch.where(left > 0, share * most / left, bound[b])
    return plain + torch.minimum(torch.maximum(change, -bound[..., None]), bound[..., None])
