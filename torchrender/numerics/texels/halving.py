"""Pictures of half the size: means of two by two texels."""

from __future__ import annotations

import torch
from torch import Tensor

ROWS = 256
"""That are halved at a time: what that takes is little beside the texture."""


def halved(texture: Tensor) -> Tensor:
    """(H,W,C) -> (H/2,W/2,C) rounded down, at least one: means of (about) two by two texels."""
    height, width, channels = texture.shape
    size = max(height // 2, 1), max(width // 2, 1)
    if height % 2 or width % 2:
        return pooled(texture, size).contiguous()
    made = texture.new_zeros(*size, channels)
    for begin in range(0, size[0], ROWS):
        rows = texture[2 * begin : 2 * (begin + ROWS)]
        pairs = rows[0::2] + rows[1::2]
        torch.add(pairs[:, 0::2], pairs[:, 1::2], out=made[begin : begin + ROWS])
    return made.mul_(0.25)


def pooled(texture: Tensor, size: tuple[int, int]) -> Tensor:
    """(H,W,C) -> (h,w,C): means over cells that cover the whole texture."""
    image = texture.permute(2, 0, 1)[None]
    return torch.nn.functional.adaptive_avg_pool2d(image, size)[0].permute(1, 2, 0)
