"""Colours of pictures that were rendered with fewer pixels than their depth has: edges follow the depth again."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.image import Image
from torchrender.kernels.compile import view
from torchrender.kernels.upscale import spread_colors
from torchrender.raster import rasterize_depth

SAME_SURFACE = 0.04
"""Difference of 1/z, as a share, from which a rendered pixel counts little for another one."""
LEFT_OVER = 1e-6
"""Weight of pixels of other surfaces: they are better than nothing."""


def surface_colors(image: Image) -> Tensor:
    """(H,W,3) linear radiance of a picture of one camera.

    Where fewer pixels were rendered, colours across an outline would stick to the wrong surface and part from it as
    soon as somebody looks from elsewhere. So each pixel takes the mean of the rendered pixels around it that lie at its
    depth, cut off at 1, which is as bright as a display gets: a lamp must not outshine what is beside it.
    """
    scale = 1.0 if image.plan is None else image.plan.options.supersample
    if scale >= 1.0:
        return image.radiance[0]
    rendered = rasterize_depth(image.scene.geometry, image.cameras.scaled(scale))[0]
    return upscaled(image.radiance[0].clamp(max=1.0), image.gbuffer.depth[0], rendered)


def upscaled(radiance: Tensor, depth: Tensor, rendered: Tensor) -> Tensor:
    """Means of rendered pixels, weighted by nearness in the picture and in inverse depth.

    Args:
        radiance: (H,W,3), scaled up in any way that keeps the colours at the centres of the rendered pixels.
        depth: (H,W), +inf for sky. rendered: (h,w) depth of the rendered pixels.
    """
    rows, columns = (
        ((torch.arange(few) + 0.5) * (many / few)).long() for many, few in zip(depth.shape, rendered.shape)
    )
    colors = np.ascontiguousarray(radiance[rows][:, columns].numpy(), np.float32)
    arrays = (view(rendered, np.float32), view(depth, np.float32))
    out = np.zeros((*depth.shape, 3), np.float32)
    spread_colors(colors, *arrays, SAME_SURFACE, LEFT_OVER, out)
    return torch.from_numpy(out)
