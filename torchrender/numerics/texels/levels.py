"""Levels of detail of textures that are kept as codes: means of linear light, in 16 bits each.

A level is rounded to 1/65535 of full light, a fifteenth of the smallest step of 8-bit sRGB, and made of the one
before: the coarsest of thirteen is off by a third of that step at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.texels.coded import Array, CodedTexture, is_followed, looked_up, room_for, tables
from torchrender.numerics.texels.halving import halved, pooled

UNIT = np.float32(65535)
_CACHED = 1 << 17
"""Numbers of the finer level that are halved at a time."""


@dataclass(frozen=True, eq=False)
class CodedPyramid:
    """All mip levels of textures of one size side by side, C channels together."""

    codes: Array  # (T,C) uint8 texels of the finest level
    coarser: Array  # (S,C) uint16 those of the others, level after level, in units of 1/65535
    linear: tuple[bool, ...]  # for each channel: its codes are sRGB
    offset: Tensor  # (K,) int64 first texel of each level, those of the finest one first
    width: Tensor  # (K,) int64
    height: Tensor  # (K,) int64

    @property
    def level_count(self) -> int:
        return int(self.offset.shape[0])

    def take(self, rows: Tensor) -> Tensor:
        """(N,C) float32 numbers of texels."""
        at, count = rows.numpy(), len(self.codes)
        fine = at < count
        out = np.empty((len(at), self.codes.shape[1]), np.float32)
        for channel, linear in enumerate(self.linear):
            out[fine, channel] = tables()[int(linear)][self.codes[at[fine], channel]]
        out[~fine] = self.coarser[at[~fine] - count].astype(np.float32) / UNIT
        return torch.from_numpy(out)


def coded_pyramid(textures: Sequence[CodedTexture], sizes: Sequence[tuple[int, int]]) -> CodedPyramid:
    """Of textures (H,W,C_k) of one size side by side.

    Args:
        sizes: (K,) height and width of the levels, the textures' own first.
    """
    parts = [texture.codes for texture in textures]
    flags = [k < one.colors for one in textures for k in range(one.shape[2])]
    finest = _side_by_side(parts)
    counts = np.array([h * w for h, w in sizes], np.int64)
    channels = finest.shape[2]
    coarser = room_for((int(counts[1:].sum()), channels), np.uint16)
    first, finer = 0, finest
    for height, width in sizes[1:]:
        level = coarser[first : first + height * width].reshape(height, width, channels)
        _halve(finer, level, flags)
        first, finer = first + height * width, level
    offset = torch.from_numpy(counts.cumsum() - counts)
    shapes = torch.tensor([*sizes], dtype=torch.int64)
    codes = finest.reshape(-1, channels)
    return CodedPyramid(codes, coarser, tuple(flags), offset, shapes[:, 1].contiguous(), shapes[:, 0].contiguous())


def _side_by_side(parts: Sequence[Array]) -> Array:
    """(H,W,C) codes of all, with room behind them; of a single one the same memory where it has that."""
    if len(parts) == 1 and is_followed(parts[0]):
        return parts[0]
    whole = room_for((*parts[0].shape[:2], sum(part.shape[2] for part in parts)), np.uint8)
    begin = 0
    for part in parts:
        whole[..., begin : begin + part.shape[2]] = part
        begin += part.shape[2]
    return whole


def _halve(finer: Array, level: Array, flags: Sequence[bool]) -> None:
    """Means of (about) two by two texels (H,W,C) into those of the next level (h,w,C) uint16."""
    height, width, channels = level.shape
    if finer.shape[:2] != (2 * height, 2 * width):
        means = pooled(torch.from_numpy(_numbers(finer, flags)), (height, width))
        level[...] = _rounded(means)
        return
    rows = max(_CACHED // (4 * width * channels), 1)
    for row in range(0, height, rows):
        level[row : row + rows] = _rounded(halved(torch.from_numpy(_numbers(finer[2 * row : 2 * (row + rows)], flags))))


def _numbers(values: Array, flags: Sequence[bool]) -> Array:
    """(H,W,C) float32 of codes, or of numbers of 16 bits."""
    if values.dtype == np.uint16:
        return values.astype(np.float32) / UNIT
    if all(flags) or not any(flags):
        return np.take(tables()[int(flags[0])], values, mode="clip")
    height, width, channels = values.shape
    begins = np.tile(np.array([256 * int(flag) for flag in flags], np.uint16), width)
    row_by_row = values.reshape(height, width * channels)
    return np.take(tables().reshape(-1), row_by_row + begins, mode="clip").reshape(values.shape)


def _rounded(means: Tensor) -> Array:
    return (means.numpy() * UNIT + np.float32(0.5)).astype(np.uint16)


@lru_cache(maxsize=1)
def _nearest() -> Array:
    """(65536,2) uint8: the code that is nearest to each number of 16 bits, as a share and as linear light."""
    numbers = torch.arange(65536, dtype=torch.float64) / 65535
    both = torch.stack([numbers, srgb_from_linear(numbers)], dim=1)
    return (both * 255.0 + 0.5).to(torch.uint8).numpy()


def halved_codes(codes: Array, colors: int) -> Array:
    """(H,W,C) uint8 -> (H/2,W/2,C) rounded down, at least one: codes nearest to the means of two by two texels.

    Off by half a step of a code at most, as the codes of the file are.
    """
    height, width, channels = codes.shape
    out = room_for((max(height // 2, 1), max(width // 2, 1), channels), np.uint8)
    flags = [k < colors for k in range(channels)]
    plain, linear = np.ascontiguousarray(_nearest().T)
    even = height % 2 == 0 and width % 2 == 0
    rows = max(_CACHED // (2 * width * channels), 1) if even else len(out)
    for row in range(0, len(out), rows):
        part = codes[2 * row : 2 * (row + rows)] if even else codes
        means = np.empty((len(part) // 2 if even else len(out), *out.shape[1:]), np.uint16)
        _halve(part, means, flags)
        out[row : row + rows] = looked_up(means, linear, plain, colors)
    return out
