"""Few pixels of a picture for many: the middles of squares, and parts of what a camera sees."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer


def spacing_of(count: int, room: int) -> int:
    """Of a lattice in ``count`` pixels that has no more than ``room``; odd, so that it has pixels in its middle."""
    least = max(1, math.ceil(math.sqrt(count / max(1, room))))
    return least + 1 - least % 2


def middles(side: int, spacing: int) -> Tensor:
    """(N,) int64 the middles of runs of so many pixels; that of the last one, which may end early, lies within."""
    return torch.arange(spacing // 2, side + spacing // 2, spacing)[: -(-side // spacing)].clamp(max=side - 1)


def scattered(pixels: Tensor, count: int) -> Tensor:
    """(H,W) bool: about so many of the pixels, others as soon as there are more or fewer of them."""
    total = int(pixels.sum())
    if count <= 0 or not total:
        return torch.zeros_like(pixels)
    rows = pixels.reshape(-1).nonzero()[:, 0]
    drawn = rows[torch.rand(total, generator=torch.Generator().manual_seed(total)) < count / total]
    chosen = torch.zeros_like(pixels)
    chosen.view(-1)[drawn] = True
    return chosen


def widened(seen: VisibilityBuffer, size: tuple[int, int]) -> VisibilityBuffer:
    """What one camera sees, with empty rows below and columns to the right; the camera stays as it is."""
    depth = widen(seen.depth, size, torch.inf)
    triangle, owner = (widen(ids, size, -1) for ids in (seen.triangle, seen.object_id))
    return VisibilityBuffer(seen.cameras, depth, triangle, owner, torch.zeros(1, 1, 1, 2).expand(1, *size, 2))


def widen(values: Tensor, size: tuple[int, int], empty: float) -> Tensor:
    """(1,H,W) made as large as that."""
    height, width = values.shape[1:]
    return torch.nn.functional.pad(values, (0, size[1] - width, 0, size[0] - height), value=empty)


def part_of(seen: VisibilityBuffer, rows: slice | Tensor, columns: slice | Tensor) -> VisibilityBuffer:
    """Some rows and columns of what one camera sees; the camera stays that of all."""
    names = ("depth", "triangle", "object_id", "barycentric")
    return VisibilityBuffer(seen.cameras, *(getattr(seen, name)[:, rows, columns].contiguous() for name in names))


def extent(found: Tensor) -> slice:
    """From the first to the last of those found (N) bool; there is one."""
    rows = found.nonzero()[:, 0]
    return slice(int(rows[0]), int(rows[-1]) + 1)


def window_of(seen: VisibilityBuffer, rows: slice, columns: slice) -> VisibilityBuffer:
    """A rectangle of what one camera sees."""
    part = part_of(seen, rows, columns)
    size = columns.stop - columns.start, rows.stop - rows.start
    return replace(part, cameras=seen.cameras.sub_camera(columns.start, rows.start, *size))
