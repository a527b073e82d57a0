"""Texels that no photo saw: filled from the rest of the same plane (specification 13, section 6).

A texture is a smooth part, which is continued across the gap, and detail around it, which is copied from where the
surroundings look alike: so a copy never brings another place's brightness with it.
"""

from __future__ import annotations

import cv2
import numpy as np

from torchrender.kernels.walkthrough.fill import Search, synthesise
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.options import WalkthroughOptions

SMALL = 50
"""Texels of a gap that is simply inpainted."""

MOST = 8000
"""Texels that are searched for one by one; larger gaps are filled at a coarser scale, and copied from there."""

PICKS = 14
SMOOTH = 4.0
SLACK = 1.1


def fill_holes(color: Array, known: Array, wanted: Array, options: WalkthroughOptions, seed: int) -> Array:
    """Colours (Ht,Wt,3) uint8 with the texels ``wanted`` filled; those that are ``known`` stay exactly as they are."""
    if not wanted.any() or not known.any():
        return color
    made = color.copy()
    if options.fill == "inpaint":
        return _inpaint(made, known, wanted)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(wanted.astype(np.uint8), connectivity=8)
    small = wanted & (statistics[:, cv2.CC_STAT_AREA] < SMALL)[labels]
    made = _inpaint(made, known, small)
    large = wanted & ~small
    if large.any():
        made = _exemplar(made, known, large, options, seed)
    return np.where(known[..., None], color, made).astype(np.uint8)


def _inpaint(color: Array, known: Array, wanted: Array) -> Array:
    if not wanted.any():
        return color
    # Texels that are neither known nor wanted must not bleed in.
    mask = (~known).astype(np.uint8)
    found = cv2.inpaint(color, mask, 3.0, cv2.INPAINT_TELEA) if mask.mean() < 0.6 else smooth_fill(color, known)
    return np.where(wanted[..., None], found, color).astype(np.uint8)


def smooth_fill(color: Array, known: Array) -> Array:
    """(H,W,C) float32: known texels as they are, the rest from ever coarser means of known ones (pull and push)."""
    weights, values = [known.astype(np.float32)], [color.astype(np.float32) * known[..., None]]
    while max(weights[-1].shape) > 1:
        h, w = weights[-1].shape
        size = (max((w + 1) // 2, 1), max((h + 1) // 2, 1))
        weight = cv2.resize(weights[-1], size, interpolation=cv2.INTER_AREA)
        value = cv2.resize(values[-1], size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], -1)
        weights.append(weight)
        values.append(value)
    coarse = values[-1] / np.maximum(weights[-1][..., None], 1e-6)
    for weight, value in zip(weights[-2::-1], values[-2::-1]):
        up = cv2.resize(coarse, (weight.shape[1], weight.shape[0]), interpolation=cv2.INTER_LINEAR)
        up = up.reshape(*weight.shape, -1)
        share = np.minimum(weight, 1.0)[..., None]
        coarse = value / np.maximum(weight[..., None], 1e-6) * share + up * (1 - share)
    return np.asarray(coarse)


def _exemplar(color: Array, known: Array, wanted: Array, options: WalkthroughOptions, seed: int) -> Array:
    whole = smooth_fill(color, known)
    base = cv2.GaussianBlur(whole, (0, 0), SMOOTH)
    detail = np.where(known[..., None], color.astype(np.float32) - base, 0.0).astype(np.float32)
    factor = max(int(np.ceil(np.sqrt(wanted.sum() / MOST))), 1)
    source = _search(detail, known, wanted, factor, options, seed)
    if source is None:
        return np.where(wanted[..., None], np.clip(np.rint(base), 0, 255), color).astype(np.uint8)
    rows, columns = np.nonzero(wanted)
    from_row, from_column = source[rows, columns, 0], source[rows, columns, 1]
    good = (from_row >= 0) & known[np.maximum(from_row, 0), np.maximum(from_column, 0)]
    copied = np.where(good[:, None], detail[np.maximum(from_row, 0), np.maximum(from_column, 0)], 0.0)
    made = color.copy()
    made[rows, columns] = np.clip(np.rint(base[rows, columns] + copied), 0, 255)
    return made


def _search(
    detail: Array, known: Array, wanted: Array, factor: int, options: WalkthroughOptions, seed: int
) -> Array | None:
    """(Ht,Wt,2) int32 known texel that each wanted one is copied from; None where there is nothing to copy."""
    height, width = known.shape
    pad = ((0, -height % factor), (0, -width % factor))
    h, w = (height + pad[0][1]) // factor, (width + pad[1][1]) // factor
    blocks = np.pad(known, pad).reshape(h, factor, w, factor)
    small_known = np.asarray(blocks.all(axis=(1, 3)))
    small_wanted = np.asarray(np.pad(wanted, pad).reshape(h, factor, w, factor).any(axis=(1, 3))) & ~small_known
    image = np.pad(detail, (*pad, (0, 0))).reshape(h, factor, w, factor, 3).mean(axis=(1, 3))
    window = min(options.fill_window, 2 * (min(h, w) // 4) + 1)
    if window < 3:
        return None
    whole = cv2.erode(
        small_known.astype(np.uint8), np.ones((window, window)), borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    candidates = np.argwhere(whole > 0)
    if len(candidates) < 8:
        return None
    rng = np.random.default_rng(seed)
    order = _onion(image, small_known, small_wanted, window)
    picks = rng.integers(0, len(candidates), (len(order), PICKS))
    offset = np.arange(window) - window // 2
    gauss = np.exp(-(offset[:, None] ** 2 + offset[None] ** 2) / (2 * (window / 4) ** 2))
    source = np.full((h, w, 2), -1, np.int32)
    made = np.ascontiguousarray(image, np.float32)
    synthesise(made, small_known, small_wanted, Search(order, candidates, picks), gauss, SLACK, source)
    if factor == 1:
        return source[:height, :width]
    fine = np.repeat(np.repeat(source, factor, 0), factor, 1)[:height, :width] * factor
    fine[..., 0] += (np.arange(height) % factor)[:, None].astype(np.int32)
    fine[..., 1] += (np.arange(width) % factor)[None].astype(np.int32)
    fine[np.repeat(np.repeat(source[..., 0] < 0, factor, 0), factor, 1)[:height, :width]] = -1
    fine[..., 0] = np.minimum(fine[..., 0], height - 1)
    fine[..., 1] = np.minimum(fine[..., 1], width - 1)
    return fine


def _onion(image: Array, known: Array, wanted: Array, window: int) -> Array:
    """(K,2) wanted texels, layer by layer from what is known; in a layer those first that have most known neighbours,
    counted by the strength of edges there."""
    layer = cv2.distanceTransform((~known).astype(np.uint8), cv2.DIST_L1, 3)
    grey = np.where(known, image.mean(2), 0.0).astype(np.float32)
    strength = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)) * known
    votes = cv2.boxFilter((1.0 + strength / max(float(strength.max()), 1e-6)) * known, cv2.CV_32F, (window, window))
    rows, columns = np.nonzero(wanted)
    order = np.lexsort((-votes[rows, columns], np.rint(layer[rows, columns])))
    return np.ascontiguousarray(np.stack([rows, columns], axis=1)[order])
