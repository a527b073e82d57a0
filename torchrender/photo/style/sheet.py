"""A contact sheet: the photos beside all views of the scene in their style."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.photo.photograph import resized
from torchrender.photo.style.session import Style

GAP = 8
_PAPER = 1.0


def contact_sheet(style: Style, *, columns: int | None = None) -> Tensor:
    """(H,W,3) linear light: the photos as the first pictures, then all views, row by row."""
    views = style.pictures()
    height, width = views.shape[1:3]
    tiles = [_fitted(p.pixels, width, height) for p in style.problem.photos] + list(views)
    across = columns or math.ceil(math.sqrt(len(tiles)))
    down = math.ceil(len(tiles) / across)
    sheet = torch.full((down * (height + GAP) + GAP, across * (width + GAP) + GAP, 3), _PAPER)
    for number, tile in enumerate(tiles):
        top, left = GAP + number // across * (height + GAP), GAP + number % across * (width + GAP)
        sheet[top : top + height, left : left + width] = tile
    return sheet


def _fitted(pixels: Tensor, width: int, height: int) -> Tensor:
    """The whole photo in its own shape within a tile."""
    scale = min(width / pixels.shape[1], height / pixels.shape[0])
    inner = (max(1, round(pixels.shape[1] * scale)), max(1, round(pixels.shape[0] * scale)))
    tile = torch.full((height, width, 3), _PAPER)
    top, left = (height - inner[1]) // 2, (width - inner[0]) // 2
    tile[top : top + inner[1], left : left + inner[0]] = resized(pixels, *inner)
    return tile
