"""Exemplar-based filling: unknown texels take the place of known ones whose surroundings fit best."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.compile import kernel


@kernel()
def window_cost(image, known, filled, gauss, target, source):
    """Weighted squared difference of two windows over what is known around the target, normalised; stops at
    ``best``."""
    half = gauss.shape[0] // 2
    height, width, channels = image.shape
    total, weight = 0.0, 0.0
    for dy in range(-half, half + 1):
        ty, sy = target[0] + dy, source[0] + dy
        if ty < 0 or ty >= height:
            continue
        for dx in range(-half, half + 1):
            tx, sx = target[1] + dx, source[1] + dx
            if tx < 0 or tx >= width or not filled[ty, tx]:
                continue
            if sy < 0 or sx < 0 or sy >= height or sx >= width or not known[sy, sx]:
                return np.inf
            g = gauss[dy + half, dx + half]
            weight += g
            for c in range(channels):
                d = image[ty, tx, c] - image[sy, sx, c]
                total += g * d * d
    return total / weight if weight > 0.0 else np.inf


class Search(NamedTuple):
    """What is filled, and out of what."""

    order: np.ndarray  # (K,2) int64 texels to fill, row and column
    candidates: np.ndarray  # (M,2) int64 known texels
    picks: np.ndarray  # (K,T) int64 candidates of each step


@kernel()
def synthesise(image, known, wanted, search, gauss, slack, source):
    """Fill ``image`` (H,W,C) float32 in place, one texel after the other, as ``search`` (:class:`Search`) has it.

    Candidates are ``candidates`` (M,2) known texels, of which ``picks`` (K,T) names some for each step, and what the
    neighbours that are filled were copied from, moved along (so that whole pieces are copied). The first within
    ``slack`` times the best cost wins. ``source`` (H,W,2) int32 receives where each texel comes from.
    """
    order, candidates, picks = search
    height, width, channels = image.shape
    filled = known.copy()
    costs = np.zeros(picks.shape[1] + 4)
    rows = np.zeros((picks.shape[1] + 4, 2), np.int64)
    for step in range(len(order)):
        y, x = order[step, 0], order[step, 1]
        count, best = 0, np.inf
        for k in range(4):
            ny, nx = y + (1 if k == 0 else -1 if k == 1 else 0), x + (1 if k == 2 else -1 if k == 3 else 0)
            if ny < 0 or nx < 0 or ny >= height or nx >= width or not filled[ny, nx]:
                continue
            sy = source[ny, nx, 0] + y - ny
            sx = source[ny, nx, 1] + x - nx
            if known[ny, nx] or sy < 0 or sx < 0 or sy >= height or sx >= width or not known[sy, sx]:
                continue
            cost = window_cost(image, known, filled, gauss, (y, x), (sy, sx))
            rows[count, 0], rows[count, 1], costs[count] = sy, sx, cost
            best, count = min(best, cost), count + 1
        for t in range(picks.shape[1]):
            sy, sx = candidates[picks[step, t], 0], candidates[picks[step, t], 1]
            cost = window_cost(image, known, filled, gauss, (y, x), (sy, sx))
            rows[count, 0], rows[count, 1], costs[count] = sy, sx, cost
            best, count = min(best, cost), count + 1
        chosen = -1
        for t in range(count):
            if costs[t] <= slack * best and costs[t] < np.inf:
                chosen = t
                break
        if chosen < 0:
            chosen = 0 if count == 0 else count - 1
            if count == 0:
                continue
        sy, sx = rows[chosen, 0], rows[chosen, 1]
        source[y, x, 0], source[y, x, 1] = sy, sx
        for c in range(channels):
            image[y, x, c] = image[sy, sx, c]
        filled[y, x] = wanted[y, x]
