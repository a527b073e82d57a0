"""Colours of pictures that were rendered with fewer pixels than their depth has: edges follow the surfaces again."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer
from torchrender.image import Image
from torchrender.kernels.compile import view
from torchrender.kernels.upscale import spread_colors

SAME_SURFACE = 0.04
"""Difference of 1/z, as a share, from which a rendered pixel counts little for another one."""
OTHER_SURFACE = 1e-3
"""Weight of pixels of another object or material at the same depth."""
LEFT_OVER = 1e-6
"""Weight of pixels of other surfaces at other depths: they are better than nothing."""

Pixels = tuple[Tensor, Tensor]
"""Depth (H,W) float32, +inf for sky, and a number (H,W) int32 that pixels of one object and material share."""


def surface_colors(image: Image) -> Tensor:
    """(H,W,3) linear radiance of a picture of one camera.

    Where fewer pixels were rendered, colours across an outline would stick to the wrong surface and part from it as
    soon as somebody looks from elsewhere. So each pixel takes the mean of the rendered pixels around it that lie at its
    depth on its object and material, cut off at 1, which is as bright as a display gets: a lamp must not outshine what
    is beside it.
    """
    rendered, whole = image.rendered, image.visibility
    if rendered is None or rendered is whole:
        return image.radiance[0]
    pixels = (_pixels(seen, image.scene.geometry.material) for seen in (rendered, whole))
    return upscaled(image.radiance[0].clamp(max=1.0), *pixels)


def _pixels(seen: VisibilityBuffer, materials: Tensor) -> Pixels:
    triangle = seen.triangle[0]
    if not len(materials):
        return seen.depth[0], torch.full_like(triangle, -1, dtype=torch.int32)
    surface = seen.object_id[0].int() * (int(materials.max()) + 1) + materials.int()[triangle.clamp_min(0)]
    return seen.depth[0], torch.where(triangle < 0, -1, surface)


def upscaled(radiance: Tensor, few: Pixels, many: Pixels) -> Tensor:
    """Means of rendered pixels, weighted by nearness in the picture and in inverse depth, and by surface.

    Args:
        radiance: (H,W,3), scaled up in any way that keeps the colours at the centres of the rendered pixels.
        few: the rendered pixels (h,w). many: the pixels that are wanted (H,W).
    """
    (depth, surface), (rough_depth, rough_surface) = many, few
    rows, columns = (
        ((torch.arange(n) + 0.5) * (wanted / n)).long() for wanted, n in zip(depth.shape, rough_depth.shape)
    )
    colors = np.ascontiguousarray(radiance[rows][:, columns].numpy(), np.float32)
    rough = (view(rough_depth, np.float32), view(rough_surface, np.int32))
    fine = (view(depth, np.float32), view(surface, np.int32))
    out = np.zeros((*depth.shape, 3), np.float32)
    spread_colors(colors, rough, fine, SAME_SURFACE, OTHER_SURFACE, LEFT_OVER, out)
    return torch.from_numpy(out)
