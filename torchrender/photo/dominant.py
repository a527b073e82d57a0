"""The colour that most of an object's pixels have: the largest of a few clusters in Lab."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from torchrender.checks import check_range, check_tensor

MAX_ITERATIONS = 30
MAX_COLORS = 16
SAME = 8.0
"""Clusters whose centres are nearer than this in Lab are one colour: several seeds within the majority's colour split
it, and the minority would come out largest."""


def dominant_pixels(lab: Tensor, seeds: int = 4) -> Tensor:
    """(N,) bool: the largest cluster of Lab pixels (N,3), clusters of nearly the same colour taken as one.

    Lloyd's iterations from ``seeds`` pixels at even spacing through the list, at most 30; an empty cluster starts
    again at the farthest pixel (OpenCV's k-means). One seed keeps everything; so do fewer pixels than seeds, and
    pixels that are all alike.

    Raises:
        InputError: another shape. OptionError: ``seeds`` outside [1, 8].
    """
    check_tensor("lab", lab, ("N", 3))
    check_range("seeds", seeds, 1, 8)
    count = len(lab)
    if seeds == 1 or count <= seeds or bool((lab == lab[0]).all()):
        return torch.ones(count, dtype=torch.bool)
    points = np.ascontiguousarray(lab.numpy(), dtype=np.float32)
    starts = points[[(2 * k + 1) * count // (2 * seeds) for k in range(seeds)]]
    nearest = ((points[:, None] - starts[None]) ** 2).sum(axis=2).argmin(axis=1)
    labels = nearest.astype(np.int32)[:, None]
    until = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, MAX_ITERATIONS, 1e-3)
    _, found, centres = cv2.kmeans(points, seeds, labels, until, 1, cv2.KMEANS_USE_INITIAL_LABELS)
    near = np.linalg.norm(centres[:, None] - centres[None], axis=2) < SAME
    _, color = connected_components(near, directed=False)
    found = color[found[:, 0]]
    return torch.from_numpy(found == np.bincount(found).argmax())


def palette(lab: Tensor, colors: int = 5, *, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Main colours of a photo: Lab (k,3) float64, most frequent first, and the cluster (N,) int64 of each pixel.

    Fewer colours come back where the photo has fewer.

    Raises:
        InputError: another shape, or no pixel. OptionError: ``colors`` outside [1, 16].
    """
    check_tensor("lab", lab, ("N", 3))
    check_range("colors", colors, 1, MAX_COLORS)
    points = np.ascontiguousarray(lab.numpy(), dtype=np.float32)
    chosen = points[:: max(1, len(points) // 20_000)]
    distinct = len(np.unique(chosen, axis=0))
    cv2.setRNGSeed(seed)
    until = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, MAX_ITERATIONS, 1e-2)
    wanted = min(colors, distinct)
    _, _, centres = cv2.kmeans(chosen, wanted, None, until, 3, cv2.KMEANS_PP_CENTERS)
    label = ((points[:, None] - centres[None]) ** 2).sum(axis=2).argmin(axis=1)
    share = np.bincount(label, minlength=wanted)
    order = np.argsort(-share, kind="stable")
    place = np.argsort(order)
    return torch.from_numpy(centres[order].astype(np.float64)), torch.from_numpy(place[label])
