"""Parts of a photo by a few strokes, and its sky without any: GrabCut as OpenCV has it.

Source: Rother, Kolmogorov, Blake, GrabCut, 2004.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_tensor
from torchrender.errors import InputError
from torchrender.numerics.color import luminance

SIDE = 320
"""Pixels of the longer side at which graphs are cut."""
ROUNDS = 3
BRIGHT = 0.25
"""Linear luminance that a sky has at least."""


def cut_out(photo: Tensor, inside: Tensor, outside: Tensor) -> Tensor:
    """(H,W) bool: the part of a photo (H,W,3) that strokes mean.

    Args:
        inside: (H,W) bool, pixels that belong to it. outside: (H,W) bool, pixels that do not.

    Raises:
        InputError: no stroke of either kind, or shapes that differ.
    """
    h, w = photo.shape[:2]
    for name, mask in (("inside", inside), ("outside", outside)):
        check_tensor(name, mask, (h, w))
        if not bool(mask.any()):
            raise InputError(f"{name} has no pixel: draw at least one stroke of either kind")
    scale = min(1.0, SIDE / max(h, w))
    size = (max(2, round(w * scale)), max(2, round(h * scale)))
    codes = (photo.clamp(0.0, 1.0).sqrt() * 255).byte().numpy()
    small = cv2.resize(codes, size, interpolation=cv2.INTER_AREA)
    trimap = np.full(small.shape[:2], cv2.GC_PR_BGD, np.uint8)
    for strokes, kind in ((outside, cv2.GC_BGD), (inside, cv2.GC_FGD)):
        at = cv2.resize(strokes.numpy().astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.25
        trimap[at] = kind
    if not (trimap == cv2.GC_FGD).any() or not (trimap == cv2.GC_BGD).any():
        raise InputError("strokes are too thin")
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(small, trimap, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    found = ((trimap == cv2.GC_FGD) | (trimap == cv2.GC_PR_FGD)).astype(np.float32)
    grown = torch.from_numpy(cv2.resize(found, (w, h), interpolation=cv2.INTER_LINEAR)) > 0.5
    return (grown | inside) & ~outside


def guess_sky(photo: Tensor, never: Tensor | None = None) -> Tensor:
    """(H,W) bool: what is bright, smooth, not warm and hangs together with the upper edge; none if nothing does.

    Args:
        never: (H,W) bool, pixels that are no sky, such as those whose depth is known.
    """
    h, w = photo.shape[:2]
    level = luminance(photo).numpy()
    cold = (photo[..., 2] >= 0.85 * photo[..., 0]).numpy()
    rough = cv2.GaussianBlur(np.abs(cv2.Laplacian(np.sqrt(level), cv2.CV_32F)), (0, 0), 2.0)
    bright = np.quantile(level[: max(1, h // 3)], 0.9)
    sure = (level > max(BRIGHT, 0.5 * float(bright))) & cold & (rough < 0.06)
    if never is not None:
        sure &= ~never.numpy()
    _, parts = cv2.connectedComponents(sure.astype(np.uint8), connectivity=4)
    top = np.unique(parts[: max(1, h // 50)])
    sky = np.isin(parts, top[top > 0])
    if sky.mean() < 0.005:
        return torch.zeros(h, w, dtype=torch.bool)
    outside = (level < 0.3 * max(BRIGHT, 0.5 * float(bright))) | (np.arange(h) > 0.9 * h)[:, None]
    outside &= ~sky
    if never is not None:
        outside |= never.numpy()
    if not outside.any():
        return torch.from_numpy(sky)
    eroded = cv2.erode(sky.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    inside = torch.from_numpy(eroded if eroded.any() else sky)
    try:
        found = cut_out(photo, inside, torch.from_numpy(outside) & ~inside)
    except InputError:
        return torch.from_numpy(sky)
    _, parts = cv2.connectedComponents(found.numpy().astype(np.uint8), connectivity=8)
    reached = np.unique(parts[eroded])
    return torch.from_numpy(np.isin(parts, reached[reached > 0]))
