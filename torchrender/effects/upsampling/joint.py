"""Pictures that were rendered with fewer pixels, scaled up along the surfaces that the whole picture shows.

Joint bilateral upsampling (Kopf et al., *Joint bilateral upsampling*, 2007) whose guide is what every pixel sees, which
is drawn much sooner than it is shaded: depth, object and material. Outlines stay as sharp as with all pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from torchrender.arrays import view
from torchrender.buffers import VisibilityBuffer
from torchrender.checks import check_tensor
from torchrender.errors import InputError
from torchrender.kernels.warp.joint_upsampling import spread_colors

SAME_SURFACE = 0.04
"""Difference of 1/z, as a share, from which a rendered pixel counts little for another one."""
OTHER_SURFACE = 1e-3
"""Weight of pixels of another object or material at the same depth."""
LEFT_OVER = 1e-6
"""Weight of pixels of other surfaces at other depths: they are better than nothing."""
WINDOW = 4
"""Rendered pixels along each side that count for a pixel, at most."""


def joint_upsampled(
    radiance: Tensor,
    few: VisibilityBuffer,
    many: VisibilityBuffer,
    materials: Tensor,
    wanted: Tensor | None = None,
) -> Tensor:
    """Radiance (B,H,W,C) of all pixels: means of the rendered ones around, of the same surface where there are any.

    Gradients go to ``radiance``: whose means are taken does not depend on it.

    Args:
        radiance: (B,h,w,C) of the rendered pixels, in any number of channels.
        few: what they see. many: what all pixels see, by the same cameras (B,H,W).
        materials: (F,) int64 by triangle, :attr:`Geometry.material`.
        wanted: (B,H,W) bool, pixels that are asked for; the others become zero. None: all.

    Raises:
        InputError: shapes that do not fit.
    """
    if wanted is not None:
        check_tensor("wanted", wanted, tuple(many.triangle.shape))
    asked = np.ones(many.triangle.shape, np.bool_) if wanted is None else view(wanted, np.bool_)
    check_tensor("radiance", radiance, (*few.triangle.shape, "C"))
    if len(few.triangle) != len(many.triangle):
        raise InputError(f"few and many must be of as many cameras, got {len(few.triangle)} and {len(many.triangle)}")
    rough, fine = _arrays(few), _arrays(many)
    limits = (SAME_SURFACE, OTHER_SURFACE, LEFT_OVER)

    def spread(image: Tensor) -> Tensor:
        colors = view(image, np.float32)
        out = np.zeros((*many.triangle.shape, colors.shape[-1]), np.float32)
        for k in range(len(out)):
            views = tuple(a[k] for a in rough), tuple(a[k] for a in fine)
            spread_colors(colors[k], *views, view(materials, np.int64), limits, asked[k], out[k])
        return torch.from_numpy(out)

    made: Tensor = _Spread.apply(radiance, spread) if radiance.requires_grad else spread(radiance)
    return made


class _Spread(torch.autograd.Function):
    """A mean of a few neighbours, which is linear: its gradient goes back with the same weights."""

    @staticmethod
    def forward(ctx: Any, radiance: Tensor, spread: Callable[[Tensor], Tensor]) -> Tensor:
        ctx.spread, ctx.shape = spread, radiance.shape
        return spread(radiance.detach())

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        count, height, width, channels = ctx.shape
        rows, columns = torch.arange(height) % WINDOW, torch.arange(width) % WINDOW
        number = rows[:, None] * WINDOW + columns
        # No two of a window's pixels have the same number: what each channel becomes is the weight of one of them.
        single = torch.nn.functional.one_hot(number, WINDOW**2).float().expand(count, -1, -1, -1).contiguous()
        weights = ctx.spread(single)
        at_rows, at_columns = (
            _windows(*sizes) for sizes in ((gradient.shape[1], height), (gradient.shape[2], width))
        )  # fmt: skip
        back = torch.zeros(count, height * width, channels)
        for k in range(WINDOW**2):
            place = at_rows[:, k // WINDOW, None] * width + at_columns[:, k % WINDOW]
            back.index_add_(1, place.reshape(-1), (weights[..., k, None] * gradient).flatten(1, 2))
        return back.reshape(ctx.shape), None


def _windows(many: int, few: int) -> Tensor:
    """(many,WINDOW) int64: by their rest of the division by ``WINDOW``, the rows that count for each one."""
    first = ((torch.arange(many, dtype=torch.float64) + 0.5) * (few / many) - 0.5).floor().long() + 1 - WINDOW // 2
    rest = torch.arange(WINDOW)
    return (first[:, None] + (rest - first[:, None]) % WINDOW).clamp(0, few - 1)


def _arrays(seen: VisibilityBuffer) -> tuple[np.ndarray, ...]:
    return view(seen.depth, np.float32), view(seen.triangle, np.int64), view(seen.object_id, np.int64)
