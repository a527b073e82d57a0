"""Hits of rays that lie near one another share what each of them found out: few rays each, and no noise.

Hits fall into the cells of a grid in space, as wide as a few of their rays or, where these are still few, twice, four
times … as wide; the corners of the grid know the means of the cells around them, and hits take those of their corners,
smoothly. Surfaces that face different axes do not mix; what faces between them takes part in each.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

WIDE = 8.0
"""Widths of a ray that a cell has at least."""

ENOUGH = 24.0
"""Samples of the hits in a cell that need no wider one: the corners of a cell know four times as many."""

LEVELS = 4
"""Widths of cells, each twice the one before."""

LEAST = 0.02
"""Share of a hit among those that face along an axis, below which it is none of them."""

_FACTORS = (0x1E3779B97F4A7C15, 0x42B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5)


class _Cells(NamedTuple):
    """M cells that hold hits."""

    place: Tensor  # (M,3) int64 whole widths
    kind: Tensor  # (M,) int64 width and side that surfaces face
    sums: Tensor  # (M,C+1) float64 of the values of hits, and their number


def share_hits(position: Tensor, normal: Tensor, width: Tensor, values: Tensor, samples: int) -> Tensor:
    """Values (N,C) of hits, each a mean over those of the hits around it that face the same way.

    Args:
        position: (N,3) float64.
        normal: (N,3) unit.
        width: (N,) of the rays, scene units; those without any keep their values.
        values: (N,C) float32, each the mean of ``samples`` samples.
    """
    rows = ((width > 0) & torch.isfinite(width)).nonzero().reshape(-1)
    if not len(rows):
        return values
    share = normal[rows].double().square().square()
    share = share / share.sum(dim=1, keepdim=True).clamp_min(1e-30)
    part, axis = (share > LEAST).nonzero().unbind(1)  # a hit that faces between two axes is one of both
    weight, rows = share[part, axis], rows[part]
    level = (width[rows].double() * WIDE).log2().ceil().clamp(-1000, 1000)
    place = position[rows].double() / torch.exp2(level)[:, None]
    side = 2 * axis + (normal[rows].gather(1, axis[:, None])[:, 0] > 0).long()
    own = torch.cat([values[rows].double() * weight[:, None], weight[:, None]], dim=1)
    cells, cell = _merged(place.floor().long(), side + 6 * level.long(), own)
    found, open_rows = torch.zeros(len(rows), values.shape[1], dtype=torch.float64), torch.arange(len(rows))
    for number in range(LEVELS):
        filled = cells.sums[cell[open_rows], -1] * samples >= ENOUGH
        done = open_rows if number == LEVELS - 1 else open_rows[filled]
        if len(done):
            found[done] = _from_corners(cells, cell[done], place[done])
        open_rows = open_rows[:0] if number == LEVELS - 1 else open_rows[~filled]
        if not len(open_rows):
            break
        place = place / 2
        cells, parent = _merged(cells.place >> 1, cells.kind, cells.sums)
        cell = parent[cell]
    total = torch.zeros(len(values), values.shape[1] + 1, dtype=torch.float64)
    total.index_add_(0, rows, torch.cat([found, torch.ones(len(rows), 1)], dim=1) * weight[:, None])
    known = total[:, -1:] > 0
    return torch.where(known, total[:, :-1] / total[:, -1:].clamp_min(1e-30), values).float()


def _merged(place: Tensor, kind: Tensor, sums: Tensor) -> tuple[_Cells, Tensor]:
    """Cells of what lies in the same place and is of one kind, and their numbers."""
    key = (torch.cat([place, kind[:, None]], dim=1) * torch.tensor(_FACTORS)).sum(dim=1)
    unique, number = key.unique(return_inverse=True)
    first = torch.empty_like(unique).scatter_(0, number, torch.arange(len(key)))
    total = torch.zeros(len(unique), sums.shape[1], dtype=sums.dtype).index_add_(0, number, sums)
    return _Cells(place[first], kind[first], total), number


def _from_corners(cells: _Cells, cell: Tensor, place: Tensor) -> Tensor:
    """Means (N,C) at places (N,3), in widths, within the numbered cells, between those at the cells' corners."""
    steps = torch.cartesian_prod(*[torch.arange(2)] * 3)  # (8,3)
    corner = (cells.place[:, None] + steps).reshape(-1, 3)
    count = len(cells.kind)
    corners, number = _merged(corner, cells.kind.repeat_interleave(8), cells.sums.repeat_interleave(8, dim=0))
    mean = corners.sums[:, :-1] / corners.sums[:, -1:]
    number = number.reshape(count, 8)
    within = (place - cells.place[cell]).clamp(0.0, 1.0)
    found = torch.zeros(len(cell), mean.shape[1], dtype=mean.dtype)
    for k, step in enumerate(steps.tolist()):
        share = torch.ones(len(cell), dtype=mean.dtype)
        for axis in range(3):
            share = share * (within[:, axis] if step[axis] else 1.0 - within[:, axis])
        found += share[:, None] * mean[number[cell, k]]
    return found
