"""Fewer points: neighbours that look alike become one, until all fit into a budget.

Redundant ones go first (what several photos sampled at one place, and smooth colours), detail last. Points fall into
cubes about two footprints wide; all points of a cube that face one way are one candidate, and its cost is how far their
colours are from their mean. Rounds allow more and more cost, and later rounds merge what earlier ones made.
"""

from __future__ import annotations

import numpy as np

from torchrender.walkthrough.density import Samples
from torchrender.walkthrough.frames.record import Array

ALIKE = (3.0, 6.0, 9.0, 12.0)
"""Rounds: root mean square distance of colours from their mean, sRGB codes, up to which points are one."""

UNLIKE = (18.0, 27.0, 40.0, 60.0, 90.0, 140.0, 256.0)
"""Further rounds where the budget must be kept whatever it costs."""


def merge_points(samples: Samples, most: int, *, strict: bool = False) -> Samples:
    """About ``most`` points or fewer in place of M, in the order of the cubes; as they are if there are no more.

    A merged point lies at the mean of its points, with their mean colour and normal, and stands for the area that they
    covered.

    Args:
        strict: merge on, whatever the colours, until there are no more than ``most``; else only what looks alike.
    """
    for limit in ALIKE + (UNLIKE if strict else ()):
        for _ in range(4 if limit == UNLIKE[-1] else 1):
            excess = len(samples.position) - most
            if excess <= 0:
                return samples
            samples = _round(samples, limit, excess)
    return samples


def _round(samples: Samples, limit: float, excess: int) -> Samples:
    """One merge of the cubes whose cost is within ``limit``, the cheapest first, until ``excess`` points are gone."""
    group = _cubes(samples)
    count = np.bincount(group)
    color = _means(samples.color.astype(np.float64), group, count)
    spread = np.bincount(group, weights=np.square(samples.color - color[group]).sum(1)) / (3.0 * count)
    candidates = np.nonzero((count > 1) & (spread <= limit * limit))[0]
    order = candidates[np.argsort(spread[candidates], kind="stable")]
    saved = np.cumsum(count[order] - 1)
    order = order[: int(np.searchsorted(saved, excess)) + 1]
    chosen = np.zeros(len(count), bool)
    chosen[order] = True
    single = ~chosen[group]
    merged = _merged(samples, group, chosen)
    return Samples(*(np.concatenate([getattr(samples, n)[single], getattr(merged, n)])
                     for n in Samples.__dataclass_fields__))  # fmt: skip


def _cubes(samples: Samples) -> Array:
    """(M,) int64 which cube and side of its faces each point belongs to; points of unlike size never share one."""
    footprint = np.exp(-0.5 * samples.log_density.astype(np.float64))
    usual = float(np.median(footprint))
    level = np.ceil(np.log2(footprint / usual))
    edge = usual * np.exp2(level + 1.0)
    cell = np.floor((samples.position - samples.position.min(0)) / edge[:, None]).astype(np.int64)
    axis = np.abs(samples.normal).argmax(1)
    facing = 2 * axis + (np.take_along_axis(samples.normal, axis[:, None], 1)[:, 0] > 0)
    key = np.stack([*cell.T, level.astype(np.int64), facing], axis=1)
    key -= key.min(0)
    span = key.max(0) + 1
    if float(np.prod(span.astype(np.float64))) < 2.0**62:
        flat = key[:, 0]
        for n in range(1, key.shape[1]):
            flat = flat * span[n] + key[:, n]
        return np.asarray(np.unique(flat, return_inverse=True)[1])
    return np.asarray(np.unique(key, axis=0, return_inverse=True)[1]).reshape(-1)


def _means(values: Array, group: Array, count: Array) -> Array:
    """(G,C) means of rows (M,C)."""
    sums = [np.bincount(group, weights=values[:, c], minlength=len(count)) for c in range(values.shape[1])]
    return np.asarray(np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])


def _merged(samples: Samples, group: Array, chosen: Array) -> Samples:
    """The points of the chosen groups, one each."""
    rows = np.nonzero(chosen[group])[0]
    inside = (np.cumsum(chosen) - 1)[group[rows]]
    count = np.bincount(inside, minlength=int(chosen.sum()))
    position = samples.position[rows]
    mean = _means(position, inside, count)
    normal = _means(samples.normal[rows].astype(np.float64), inside, count)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    color = _means(samples.color[rows].astype(np.float64), inside, count)
    area = np.exp(-samples.log_density[rows].astype(np.float64))
    total = np.bincount(inside, weights=area, minlength=len(count))
    # A square patch of side s spreads by s^2 / 12 along each of its sides: what several photos sampled at one place
    # is no larger for that.
    away = np.bincount(inside, weights=np.square(position - mean[inside]).sum(1), minlength=len(count)) / count
    total = np.minimum(total, 6.0 * away + total / count)
    return Samples(
        position=mean,
        normal=(normal / np.maximum(length, 1e-9)).astype(np.float32),
        color=np.rint(color).astype(np.uint8),
        log_density=-np.log(np.maximum(total, 1e-300)).astype(np.float32),
    )
