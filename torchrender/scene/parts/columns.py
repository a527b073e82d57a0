"""Arrays of several meshes as one, and what is made of numbers that say nothing."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def are_whole(numbers: Tensor) -> bool:
    """Whether a tensor holds whole numbers."""
    return not numbers.is_floating_point() and not numbers.is_complex() and numbers.dtype != torch.bool


def finite_rows(values: Tensor | None) -> Tensor | None:
    """Rows (V,C) that are not finite as those that say nothing: zeros. In float32, where large numbers are infinite."""
    if values is None or not values.numel():
        return values
    values = values.detach().float()
    return torch.where(torch.isfinite(values).all(dim=1, keepdim=True), values, 0.0)


def joined(parts: Sequence[Tensor], width: int, dtype: torch.dtype) -> Tensor:
    """Rows (V,width) of all parts."""
    return torch.cat(list(parts)).contiguous() if parts else torch.zeros(0, width, dtype=dtype)


def optional(parts: Sequence[Tensor | None], counts: Sequence[int], width: int, missing: float) -> Tensor | None:
    """Rows (V,width) float32 of all parts, ``missing`` where a part has none; None where none has any."""
    if all(p is None for p in parts):
        return None
    full = [torch.full((n, width), missing) if p is None else p.detach().float() for p, n in zip(parts, counts)]
    return torch.cat(full).contiguous()
