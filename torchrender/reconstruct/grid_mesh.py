"""Grid reconstruction: two triangles for each 2 x 2 block of pixel centres, cut where the surface breaks.

Source: specification 02, section 3.5.
"""

from __future__ import annotations

import numpy as np
import torch

from torchrender.arrays import view
from torchrender.buffers import DepthImages
from torchrender.checks import options_of
from torchrender.errors import InputError
from torchrender.kernels.warp.depth_grid import fit_blocks
from torchrender.reconstruct.corners import (
    ReconstructOptions,
    SampleQuads,
    block_planes,
    corner_limits,
    pixel_normals,
)


def fit_grid(images: DepthImages, options: ReconstructOptions | None = None) -> SampleQuads:
    """Quads between the centres of neighbouring pixels of B images (B,H,W): (B,H-1,W-1).

    A triangle is left out if one of its samples is missing, or does not lie on another one's tangent plane within the
    tolerances of ``options`` (``match_id``: or shows another object); ``adaptive_split`` chooses the diagonal.

    Raises:
        InputError: orthographic cameras.
    """
    options = options_of(options, ReconstructOptions)
    if images.cameras.orthographic:
        raise InputError("images must come from perspective cameras")
    count, height, width = images.depth.shape
    ids = view(images.object_id, np.int64) if options.match_id else np.zeros((count, 0, 0), np.int64)
    corner = np.full((count, max(height - 1, 0), 4, max(width - 1, 0)), np.inf, np.float32)
    shape = np.zeros((count, max(height - 1, 0), max(width - 1, 0)), np.uint8)
    joined = np.zeros((count, height + 1, width + 1), np.int32)
    source = (view(images.depth, np.float32), view(images.normal, np.float32), ids)
    fit_blocks(
        source, pixel_normals(images), corner_limits(images, options), options.adaptive_split, corner, shape, joined
    )
    depth, bits, words = (torch.from_numpy(a) for a in (corner, shape, joined))
    return SampleQuads(images, depth, bits, words, block_planes(corner, shape, 0.5), centred=True)
