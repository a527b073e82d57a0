"""Pictures that were rendered with fewer pixels, scaled up along the surfaces that the whole picture shows.

Joint bilateral upsampling (Kopf et al., *Joint bilateral upsampling*, 2007) whose guide is what every pixel sees, which
is drawn much sooner than it is shaded: depth, object and material. Outlines stay as sharp as with all pixels.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

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


def joint_upsampled(
    radiance: Tensor,
    few: VisibilityBuffer,
    many: VisibilityBuffer,
    materials: Tensor,
    wanted: Tensor | None = None,
) -> Tensor:
    """Radiance (B,H,W,C) of all pixels: means of the rendered ones around, of the same surface where there are any.

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
    colors = view(radiance, np.float32)
    rough, fine = _arrays(few), _arrays(many)
    limits = (SAME_SURFACE, OTHER_SURFACE, LEFT_OVER)
    out = np.zeros((*many.triangle.shape, colors.shape[-1]), np.float32)
    for k in range(len(out)):
        views = tuple(a[k] for a in rough), tuple(a[k] for a in fine)
        spread_colors(colors[k], *views, view(materials, np.int64), limits, asked[k], out[k])
    return torch.from_numpy(out)


def _arrays(seen: VisibilityBuffer) -> tuple[np.ndarray, ...]:
    return view(seen.depth, np.float32), view(seen.triangle, np.int64), view(seen.object_id, np.int64)
