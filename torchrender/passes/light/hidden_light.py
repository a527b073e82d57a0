"""How much light from everywhere nearby surfaces hide, told from the depth of a few pixels.

Where a picture leaves ambient visibility out, the error of that follows this: a picture that traced rays would tell it
better, but none has.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.passes.senses import few

SIDE = 32
"""Pixels along each side, at most."""

DISTANCES = (1, 2, 4, 8, 16)
"""In these pixels, at which surfaces are looked for in each of eight directions."""


def _steps() -> Tensor:
    """(8,S,2) rows and columns."""
    ways = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    return torch.tensor([[(row * far, column * far) for far in DISTANCES] for row, column in ways])


def depth_visibility(gbuffer: GBuffer, reach: float = math.inf) -> Tensor:
    """Cosine-weighted share (B,h,w) of the hemisphere that no surface in the picture hides, of a few of its pixels.

    Args:
        reach: scene units within which something hides.
    """
    place, normal, covered = (few(image, SIDE) for image in (gbuffer.position, gbuffer.normal, gbuffer.covered))
    place = place.float()
    height, width = covered.shape[1:]
    steps = _steps()
    rows = torch.arange(height)[:, None] + steps[..., 0, None, None]
    columns = torch.arange(width) + steps[..., 1, None, None]
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    rows, columns = rows.clamp(0, height - 1), columns.clamp(0, width - 1)
    way = place[:, rows, columns] - place[:, None, None]  # (B,8,S,h,w,3)
    length = way.norm(dim=-1)
    sine = (way * normal[:, None, None]).sum(dim=-1) / length.clamp_min(1e-30)
    hides = inside & covered[:, rows, columns] & (length <= reach)
    highest = torch.where(hides, sine, 0.0).clamp(0.0, 1.0).amax(dim=2)
    return torch.where(covered, 1.0 - highest.square().mean(dim=1), 1.0)
