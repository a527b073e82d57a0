"""Colours of a reprojection in torch: the way of the kernel once more, for gradients to the colours of the images.

Which sample a pixel shows, and where on it, is decided by the kernels and held; colours are means of texels with
weights that do not depend on them, so these derivatives are exact. Twin of the kernel
:func:`torchrender.kernels.warp.resolve.resolve`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.reconstruct.pinholes import Closed

_LEAST = 1e-6
"""Weight of all texels of a surface below which the sample itself stands for them."""


class Drawn(NamedTuple):
    """What was drawn of one picture."""

    keys: np.ndarray  # (H*W,) uint64, see torchrender.kernels.warp.warp
    valid: np.ndarray  # (H,W) bool before pinholes were closed
    closed: Closed | None  # the pinholes
    bias: np.ndarray  # (N,) factors of 1/depth
    back: np.ndarray  # (N,3,4) from target pixels to those of the images


def followed_colors(
    colors: Tensor, drawn: Drawn, pixel_arrays: tuple[int, int, np.ndarray, bool], *, smooth: bool
) -> Tensor:
    """Colours (H,W,3) of one picture from those of the images (N,h,w,3), as the kernel has them.

    Args:
        pixel_arrays: rows and columns of quads in an image, ``joined``, and whether quads lie between pixel centres.
    """
    rows, columns, joined, centred = pixel_arrays
    shown = torch.from_numpy(drawn.valid)
    key = torch.from_numpy(drawn.keys.reshape(drawn.valid.shape)[drawn.valid].astype(np.int64))
    number = 0xFFFFFFFF - (key & 0xFFFFFFFF)
    line = number // columns
    place = line // rows, line % rows, number % columns
    if smooth:
        inverse = (drawn.keys.reshape(drawn.valid.shape)[drawn.valid] >> np.uint64(32)).astype(np.uint32)
        z = torch.from_numpy(drawn.bias)[place[0]] / torch.from_numpy(inverse.view(np.float32).astype(np.float64))
        v, u = (torch.from_numpy(axis) + 0.5 for axis in np.nonzero(drawn.valid))
        at = _source_place(u, v, z, torch.from_numpy(drawn.back)[place[0]], place)
        found = _blended(colors, place, at, torch.from_numpy(joined), centred)
    else:
        found = colors[place]
    picture = torch.zeros(*shown.shape, 3, dtype=found.dtype).masked_scatter(shown[..., None], found)
    if drawn.closed is None:
        return picture
    one, other = (tuple(torch.from_numpy(axis) for axis in side) for side in (drawn.closed.one, drawn.closed.other))
    weight = torch.from_numpy(drawn.closed.weight).to(picture.dtype)
    mean = (0.5 * (picture[one] + picture[other]) * weight[..., None]).sum(dim=1)
    return picture.index_put((torch.from_numpy(drawn.closed.rows), torch.from_numpy(drawn.closed.columns)), mean)


def _source_place(u: Tensor, v: Tensor, z: Tensor, m: Tensor, place: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
    """Where in its image each pixel's surface lies; the middle of the sample where that is no number."""
    x, y, w = (z * (m[:, k, 0] * u + (m[:, k, 1] * v + m[:, k, 2])) + m[:, k, 3] for k in range(3))
    x, y = x / w, y / w
    known = torch.isfinite(x) & torch.isfinite(y)
    return torch.where(known, x, place[2] + 0.5), torch.where(known, y, place[1] + 0.5)


def _blended(
    colors: Tensor, place: tuple[Tensor, ...], at: tuple[Tensor, Tensor], joined: Tensor, centred: bool
) -> Tensor:
    """Colours (N,3), bilinear among the pixels of one surface."""
    b, j, i = place
    u, v = at
    if centred:
        row, column = j + 1, i + 1
        k = torch.where(joined[b, row, column] & 256 > 0, 0, 1)
        nearest: tuple[Tensor, ...] = (b, j + 1 - k, column)
    else:
        u, v = (
            torch.minimum(torch.maximum(u, i.double()), i + 1.0),
            torch.minimum(torch.maximum(v, j.double()), j + 1.0),
        )
        row, column = j + (v - j >= 0.5).long(), i + (u - i >= 0.5).long()
        k = torch.where(row > j, torch.where(column == i, 1, 2), torch.where(column == i, 0, 3))
        nearest = place
    word = joined[b, row, column].long()
    label = (word >> (2 * k)) & 3
    x, y = (u - (column - 0.5)).clamp(0.0, 1.0), (v - (row - 0.5)).clamp(0.0, 1.0)
    shares = (x * y, x * (1.0 - y), (1.0 - x) * (1.0 - y), (1.0 - x) * y)
    steps = ((0, 0), (-1, 0), (-1, -1), (0, -1))
    weights = torch.stack([torch.where((word >> (2 * n)) & 3 == label, w, 0.0) for n, w in enumerate(shares)])
    total = weights.sum(dim=0)
    height, width = colors.shape[1:3]
    mixed = torch.zeros(len(b), 3, dtype=colors.dtype)
    for weight, (down, right) in zip(weights, steps, strict=True):
        texel = colors[b, (row + down).clamp(0, height - 1), (column + right).clamp(0, width - 1)]
        mixed = mixed + (weight / total.clamp_min(_LEAST)).to(colors.dtype)[:, None] * texel
    return torch.where((total <= _LEAST)[:, None], colors[nearest], mixed)
