"""Texture look-up: bilinear with repeat wrap, trilinear over a mip pyramid where the picture is smaller than a texel.

Texture coordinates: (0, 0) is the lower left corner of the texture, v = 1 its upper edge; row 0 of the tensor is the
top. Texel (j, i) covers one cell and its value sits at the cell's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary

from torchrender.checks import check_tensor

_PYRAMIDS: WeakTensorKeyDictionary = WeakTensorKeyDictionary()


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


def build_pyramid(texture: Tensor) -> TexturePyramid:
    """Mip pyramid of a texture (H,W,C): each level averages the level above over cells of (about) two by two.

    Sides that are not powers of two halve rounding down; the cells are then uneven but still cover the whole texture,
    and the mean of a level is kept where the sides are even.
    """
    check_tensor("texture", texture, ("H", "W", "C"))
    levels = [texture.float()]
    while max(levels[-1].shape[:2]) > 1:
        height, width, _ = levels[-1].shape
        image = levels[-1].permute(2, 0, 1)[None]
        smaller = torch.nn.functional.adaptive_avg_pool2d(image, (max(height // 2, 1), max(width // 2, 1)))
        levels.append(smaller[0].permute(1, 2, 0))
    sizes = torch.tensor([level.shape[:2] for level in levels], dtype=torch.int64)
    counts = sizes[:, 0] * sizes[:, 1]
    return TexturePyramid(
        texels=torch.cat([level.reshape(-1, level.shape[2]) for level in levels]),
        offset=counts.cumsum(0) - counts,
        width=sizes[:, 1].contiguous(),
        height=sizes[:, 0].contiguous(),
    )


def color_pyramid(texture: Tensor) -> TexturePyramid:
    """The pyramid of a texture's three colour channels, kept for as long as the texture itself lives.

    A texture that asks for gradients is never kept, one that was changed in place is built anew.
    """
    if texture.requires_grad:
        return build_pyramid(texture[..., :3])
    kept = _PYRAMIDS.get(texture)
    if kept is not None and kept[0] == texture._version:
        pyramid: TexturePyramid = kept[1]
        return pyramid
    pyramid = build_pyramid(texture[..., :3])
    _PYRAMIDS[texture] = (texture._version, pyramid)
    return pyramid


def sample_texture(pyramid: TexturePyramid, uv: Tensor, footprint: Tensor | None = None) -> Tensor:
    """Texture values (N,C) at coordinates ``uv`` (N,2).

    ``footprint`` (N,) is the width of a pixel in uv; the two levels whose texels are just narrower and just wider are
    blended (Williams, *Pyramidal parametrics*, 1983). None, or a footprint below one texel, reads the finest level.
    Coordinates that are not finite read as 0.
    """
    check_tensor("uv", uv, ("N", 2))
    if footprint is None:
        return _bilinear(pyramid, uv, None)
    side = max(int(pyramid.width[0]), int(pyramid.height[0]))
    level = torch.log2(footprint.float().clamp(1e-12, 1e12) * side).nan_to_num(0.0)
    level = level.clamp(0.0, float(pyramid.level_count - 1))
    if not bool((level > 0).any()):
        return _bilinear(pyramid, uv, None)
    lower = level.floor()
    share = level - lower
    fine = lower.long()
    value = _bilinear(pyramid, uv, fine)
    blended = (share > 0).nonzero().reshape(-1)
    if not len(blended):
        return value
    if len(blended) == len(uv):
        return torch.lerp(value, _bilinear(pyramid, uv, fine + 1), share[:, None])
    coarse = _bilinear(pyramid, uv[blended], fine[blended] + 1)
    return value.index_add(0, blended, (coarse - value[blended]) * share[blended, None])


def _bilinear(pyramid: TexturePyramid, uv: Tensor, level: Tensor | None) -> Tensor:
    """Values (N,C), each from its own level; None: all from the finest."""
    if level is None:
        first, width, height = pyramid.offset[:1], pyramid.width[:1], pyramid.height[:1]
    else:
        first, width, height = (v.index_select(0, level) for v in (pyramid.offset, pyramid.width, pyramid.height))
    # The whole part goes before anything is multiplied: coordinates far from the unit square keep their fraction.
    u, v = uv.nan_to_num(0.0, 0.0, 0.0).unbind(-1)
    x = ((u - u.floor()) * width - 0.5).to(pyramid.texels.dtype)
    y = ((v.ceil() - v) * height - 0.5).to(pyramid.texels.dtype)
    left, top = x.floor(), y.floor()
    a, b = (x - left)[:, None], (y - top)[:, None]
    i0, i1 = _wrapped(left.long(), width)
    j0, j1 = _wrapped(top.long(), height)
    row0, row1 = first + j0 * width, first + j1 * width
    corners = (row0 + i0, row0 + i1, row1 + i0, row1 + i1)
    upper_left, upper_right, lower_left, lower_right = (pyramid.texels.index_select(0, c) for c in corners)
    return torch.lerp(torch.lerp(upper_left, upper_right, a), torch.lerp(lower_left, lower_right, a), b)


def _wrapped(index: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
    """``index`` in [-1, size] and its successor, both modulo ``size`` (integer division is slow)."""
    index = torch.where(index < 0, index + size, index)
    index = torch.where(index >= size, index - size, index)
    following = index + 1
    return index, torch.where(following >= size, following - size, following)
