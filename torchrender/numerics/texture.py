"""Texture look-up: bilinear, and trilinear over a mip pyramid where the picture is smaller than a texel.

Texture coordinates: (0, 0) is the lower left corner of the texture, v = 1 its upper edge; row 0 of the tensor is the
top. Texel (j, i) covers one cell and its value sits at the cell's centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary

from torchrender.checks import check_tensor
from torchrender.numerics.texels.coded import PADDING, CodedTexture, codes_of, state_of
from torchrender.numerics.texels.halving import halved, pooled
from torchrender.numerics.texels.levels import CodedPyramid, coded_pyramid, halved_codes

_PYRAMIDS: WeakTensorKeyDictionary = WeakTensorKeyDictionary()


class Addressing(NamedTuple):
    """What lies beyond the edges of a texture, and how its texels are blended."""

    wrap_u: str = "repeat"  # repeat, mirror or clamp
    wrap_v: str = "repeat"
    filter: str = "trilinear"  # trilinear, bilinear (of the finest level) or nearest


REPEATED = Addressing()


@dataclass(frozen=True, eq=False)
class TexturePyramid:
    """All mip levels of one texture in one list of texels, so that one gather reads any mix of levels."""

    texels: Tensor  # (T,C) float32, level after level, each row by row
    offset: Tensor  # (K,) int64 first texel of each level
    width: Tensor  # (K,) int64
    height: Tensor  # (K,) int64

    @property
    def level_count(self) -> int:
        return int(self.offset.shape[0])

    def take(self, rows: Tensor) -> Tensor:
        """(N,C) numbers of texels."""
        return self.texels.index_select(0, rows)


Pyramid = TexturePyramid | CodedPyramid


def build_pyramid(texture: Tensor) -> Pyramid:
    """Mip pyramid of a texture (H,W,C): each level averages the level above over cells of (about) two by two.

    Sides that are not powers of two halve rounding down; the cells are then uneven but still cover the whole texture,
    and the mean of a level is kept where the sides are even. Levels of a texture that is kept as codes have 16 bits.
    """
    check_tensor("texture", texture, ("H", "W", "C"))
    return pyramid_of([texture])


def pyramid_of(textures: Sequence[Tensor]) -> Pyramid:
    """The pyramid of textures (H,W,C_k) of one size side by side, as one of all their channels."""
    height, width, _ = textures[0].shape
    sizes = [(height, width)]
    while max(sizes[-1]) > 1:
        sizes.append((max(sizes[-1][0] // 2, 1), max(sizes[-1][1] // 2, 1)))
    coded = [texture for texture in textures if isinstance(texture, CodedTexture) and codes_of(texture) is not None]
    if len(coded) == len(textures):
        return coded_pyramid(coded, sizes)
    shapes = torch.tensor(sizes, dtype=torch.int64)
    counts = shapes[:, 0] * shapes[:, 1]
    wanted = any(texture.requires_grad for texture in textures) and torch.is_grad_enabled()
    texels = _in_a_row(textures, sizes) if wanted else _in_place(textures, sizes)
    return TexturePyramid(texels, counts.cumsum(0) - counts, shapes[:, 1].contiguous(), shapes[:, 0].contiguous())


def padded(values: Tensor) -> Tensor:
    """The same numbers, with :data:`PADDING` more after them in memory."""
    whole = torch.cat([values.reshape(-1), values.new_zeros(PADDING)])
    return whole[: values.numel()].view(values.shape)


def _in_a_row(textures: Sequence[Tensor], sizes: list[tuple[int, int]]) -> Tensor:
    """Texels of all levels, through which derivatives are known."""
    levels = [torch.cat([texture.float() for texture in textures], dim=2)]
    for height, width in sizes[1:]:
        levels.append(pooled(levels[-1], (height, width)))
    return torch.cat([level.reshape(-1, level.shape[2]) for level in levels])


def _in_place(textures: Sequence[Tensor], sizes: list[tuple[int, int]]) -> Tensor:
    """The same, each level written where it stays: textures of users are large. :data:`PADDING` numbers follow."""
    channels = sum(texture.shape[2] for texture in textures)
    count = sum(h * w for h, w in sizes) * channels
    texels = torch.zeros(count + PADDING)[:count].view(-1, channels)
    first, (height, width) = 0, sizes[0]
    finer = texels[: height * width].view(height, width, channels)
    begin = 0
    for texture in textures:
        held = texture.numbers() if isinstance(texture, CodedTexture) else texture.detach()
        finer[..., begin : begin + texture.shape[2]] = held
        begin += texture.shape[2]
    for height, width in sizes[1:]:
        first += finer.shape[0] * finer.shape[1]
        level = texels[first : first + height * width].view(height, width, channels)
        if finer.shape[:2] == (2 * height, 2 * width):
            rows = finer.view(height, 2, 2 * width, channels)
            pairs = (rows[:, 0] + rows[:, 1]).view(height, width, 2, channels)
            torch.add(pairs[:, :, 0], pairs[:, :, 1], out=level)
            level *= 0.25
        else:
            level.copy_(pooled(finer, (height, width)))
        finer = level
    return texels


def halved_texture(texture: Tensor) -> Tensor:
    """(H,W,C) -> (H/2,W/2,C) rounded down, at least one: means of (about) two by two texels, kept as it is kept."""
    codes = codes_of(texture)
    if isinstance(texture, CodedTexture) and codes is not None:
        return CodedTexture(halved_codes(codes, texture.colors), texture.colors)
    return halved(texture)


def channels_of(texture: Tensor, first: int, end: int) -> Tensor:
    """Some of the channels (H,W,end - first) of a texture, kept as it is kept."""
    if isinstance(texture, CodedTexture) and codes_of(texture) is not None:
        return texture.channels(first, end)
    return texture[..., first:end]


def color_pyramid(texture: Tensor) -> Pyramid:
    """The pyramid of a texture's three colour channels, kept for as long as the texture itself lives.

    A texture that asks for gradients is never kept, one that was changed in place is built anew.
    """
    return _kept(texture, 3)


def texture_pyramid(texture: Tensor) -> Pyramid:
    """The same of all channels."""
    return _kept(texture, texture.shape[2])


def _kept(texture: Tensor, channels: int) -> Pyramid:
    if texture.requires_grad:
        return build_pyramid(texture[..., :channels])
    state = state_of(texture)
    before, made = _PYRAMIDS.get(texture) or (None, {})
    known: dict[int, Pyramid] = made if before == state else {}
    if channels not in known:
        known[channels] = build_pyramid(channels_of(texture, 0, channels))
        _PYRAMIDS[texture] = (state, known)
    return known[channels]


def sample_texture(
    pyramid: Pyramid, uv: Tensor, footprint: Tensor | None = None, addressing: Addressing = REPEATED
) -> Tensor:
    """Texture values (N,C) at coordinates ``uv`` (N,2).

    ``footprint`` (N,) is the width of a pixel in uv; the two levels whose texels are just narrower and just wider are
    blended (Williams, *Pyramidal parametrics*, 1983). None, or a footprint below one texel, reads the finest level.
    Coordinates that are not finite read as 0.
    """
    check_tensor("uv", uv, ("N", 2))
    if addressing.filter == "nearest":
        return _nearest(pyramid, uv, addressing)
    if footprint is None or addressing.filter == "bilinear":
        return _bilinear(pyramid, uv, None, addressing)
    side = max(int(pyramid.width[0]), int(pyramid.height[0]))
    level = torch.log2(footprint.float().clamp(1e-12, 1e12) * side).nan_to_num(0.0)
    level = level.clamp(0.0, float(pyramid.level_count - 1))
    if not bool((level > 0).any()):
        return _bilinear(pyramid, uv, None, addressing)
    lower = level.floor()
    share = level - lower
    fine = lower.long()
    value = _bilinear(pyramid, uv, fine, addressing)
    blended = (share > 0).nonzero().reshape(-1)
    if not len(blended):
        return value
    if len(blended) == len(uv):
        return torch.lerp(value, _bilinear(pyramid, uv, fine + 1, addressing), share[:, None])
    coarse = _bilinear(pyramid, uv[blended], fine[blended] + 1, addressing)
    return value.index_add(0, blended, (coarse - value[blended]) * share[blended, None])


def _placed(coordinate: Tensor, wrap: str) -> Tensor:
    """Coordinates (N,) moved into [0, 1]. Whole parts go first: what is far from the unit square keeps its fraction."""
    if wrap == "clamp":
        return coordinate.clamp(0.0, 1.0)
    if wrap == "mirror":
        half = coordinate / 2.0
        return 1.0 - (1.0 - 2.0 * (half - half.floor())).abs()
    return coordinate - coordinate.floor()


def _texel_place(uv: Tensor, addressing: Addressing) -> tuple[Tensor, Tensor]:
    """Column and row as shares (N,) of width and height, from the upper left corner."""
    u, v = uv.nan_to_num(0.0, 0.0, 0.0).unbind(-1)
    down = v.ceil() - v if addressing.wrap_v == "repeat" else 1.0 - _placed(v, addressing.wrap_v)
    return _placed(u, addressing.wrap_u), down


def _nearest(pyramid: Pyramid, uv: Tensor, addressing: Addressing) -> Tensor:
    """Values (N,C) of the texels that hold the points."""
    across, down = _texel_place(uv, addressing)
    width, height = pyramid.width[0], pyramid.height[0]
    column = torch.minimum((across * width).floor().long(), width - 1)
    row = torch.minimum((down * height).floor().long(), height - 1)
    return pyramid.take(row * width + column)


def _bilinear(pyramid: Pyramid, uv: Tensor, level: Tensor | None, addressing: Addressing) -> Tensor:
    """Values (N,C), each from its own level; None: all from the finest."""
    if level is None:
        first, width, height = pyramid.offset[:1], pyramid.width[:1], pyramid.height[:1]
    else:
        first, width, height = (v.index_select(0, level) for v in (pyramid.offset, pyramid.width, pyramid.height))
    across, down = _texel_place(uv, addressing)
    x, y = (across * width - 0.5).float(), (down * height - 0.5).float()
    left, top = x.floor(), y.floor()
    a, b = (x - left)[:, None], (y - top)[:, None]
    i0, i1 = (_wrapped if addressing.wrap_u == "repeat" else _held)(left.long(), width)
    j0, j1 = (_wrapped if addressing.wrap_v == "repeat" else _held)(top.long(), height)
    row0, row1 = first + j0 * width, first + j1 * width
    corners = (row0 + i0, row0 + i1, row1 + i0, row1 + i1)
    upper_left, upper_right, lower_left, lower_right = (pyramid.take(c) for c in corners)
    return torch.lerp(torch.lerp(upper_left, upper_right, a), torch.lerp(lower_left, lower_right, a), b)


def _wrapped(index: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
    """``index`` in [-1, size] and its successor, both modulo ``size`` (integer division is slow)."""
    index = torch.where(index < 0, index + size, index)
    index = torch.where(index >= size, index - size, index)
    following = index + 1
    return index, torch.where(following >= size, following - size, following)


def _held(index: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
    """``index`` in [-1, size] and its successor, both held at the edges: also what a mirror beyond them shows."""
    last = size - 1
    return torch.minimum(index.clamp_min(0), last), torch.minimum((index + 1).clamp_min(0), last)
