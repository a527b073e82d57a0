"""Catmull-Rom splines through key values, at constant speed."""

from __future__ import annotations

import torch
from torch import Tensor

FINE = 64
"""Samples per key pose from which lengths are measured."""


def spans(count: int, closed: bool) -> int:
    """Pieces of a spline through so many key values."""
    return count if closed else count - 1


def even_times(values: Tensor, frames: int, closed: bool) -> Tensor:
    """Parameters (frames,) in [0, spans] at equal lengths of the way through (K,3); a closed one ends before its start.

    Where nothing moves, equal steps of the parameter.
    """
    last = spans(len(values), closed)
    fine = torch.linspace(0, last, FINE * last + 1, dtype=torch.float64)
    steps = spline_at(values, fine, closed).diff(dim=0).norm(dim=1)
    if not float(steps.sum()) > 0:
        steps = torch.ones_like(steps)
    way = torch.cat([torch.zeros(1, dtype=torch.float64), steps.cumsum(0)])
    parts = frames if closed else max(frames - 1, 1)
    wanted = way[-1] * torch.arange(frames, dtype=torch.float64) / parts
    after = torch.searchsorted(way, wanted, right=True).clamp(1, len(way) - 1)
    span = (way[after] - way[after - 1]).clamp_min(1e-300)
    part = ((wanted - way[after - 1]) / span).clamp(0.0, 1.0)
    return fine[after - 1] + part * (fine[after] - fine[after - 1])


def spline_at(values: Tensor, time: Tensor, closed: bool) -> Tensor:
    """(T,C) values of the spline through (K,C) at (T,) parameters."""
    count = len(values)
    span = time.floor().clamp(0, spans(count, closed) - 1).long()
    part = (time - span)[:, None]
    points = []
    for step in (-1, 0, 1, 2):
        index = span + step
        points.append(values[index % count if closed else index.clamp(0, count - 1)])
    before, first, second, after = points
    slope, end = (second - before) / 2, (after - first) / 2
    cube, square = part**3, part**2
    return (
        (2 * cube - 3 * square + 1) * first
        + (cube - 2 * square + part) * slope
        + (3 * square - 2 * cube) * second
        + (cube - square) * end
    )
