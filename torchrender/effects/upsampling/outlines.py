"""Smooth outlines at one sample a pixel: every triangle tells where between two pixels it ends.

Geometry buffer anti-aliasing (Persson, *Geometry Buffer Anti-Aliasing*, 2011): along the line from a pixel to its
neighbour of another object the nearer one's triangle ends somewhere, and the pixel that it ends in is shared by both.
Nothing is drawn or shaded again.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import VisibilityBuffer
from torchrender.checks import check_no_gradient, check_tensor
from torchrender.errors import InputError
from torchrender.kernels.warp.outlines import blend_outlines
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry


def smooth_outlines(geometry: Geometry, seen: VisibilityBuffer, light: Tensor) -> Tensor:
    """Light (H,W,3) of one perspective camera with smooth outlines between objects, and to the sky.

    Raises:
        InputError: several cameras, an orthographic one, or shapes that do not fit. GradientError: light that asks for
            gradients.
    """
    if len(seen.triangle) != 1 or seen.cameras.orthographic:
        raise InputError(f"seen must be of one perspective camera, got {len(seen.triangle)}")
    check_tensor("light", light, (*seen.depth.shape[1:], 3))
    check_no_gradient("smooth_outlines", light=light)
    own = view(seen.depth[0], np.float32), view(seen.triangle[0], np.int64), view(seen.object_id[0], np.int64)
    mesh = view(geometry.vertices, np.float64), view(geometry.faces, np.int32)
    shown = view(light, np.float32)
    out = np.empty_like(shown)
    blend_outlines(own, mesh, pixel_from_world(seen.cameras), shown, out)
    return torch.from_numpy(out)


def pixel_from_world(camera: Cameras) -> np.ndarray:
    """(3,4) float64: homogeneous pixel of a single perspective camera = matrix (point, 1)."""
    made = (camera.intrinsics[0].double() @ camera.camera_from_world[0, :3].double()).numpy()
    return np.ascontiguousarray(made)
