"""Smooth outlines at one sample a pixel: every triangle tells where between two pixels it ends.

Geometry buffer anti-aliasing (Persson, *Geometry Buffer Anti-Aliasing*, 2011): along the line from a pixel to its
neighbour of another object the nearer one's triangle ends somewhere, and the pixel that it ends in is shared by both.
Nothing is drawn or shaded again.

Within an object a mean over places in the pixel is a filter of the pixels around it: what is seen at a place is taken
bilinearly from them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import VisibilityBuffer
from torchrender.checks import check_no_gradient, check_tensor
from torchrender.errors import InputError
from torchrender.kernels.warp.outlines import blend_outlines, weigh_neighbours
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry


def smooth_outlines(geometry: Geometry, seen: VisibilityBuffer, light: Tensor) -> Tensor:
    """Light (H,W,3) of one perspective camera with smooth outlines between objects, and to the sky.

    Raises:
        InputError: several cameras, an orthographic one, or shapes that do not fit. GradientError: light that asks for
            gradients.
    """
    if seen.cameras.orthographic:
        raise InputError("seen must be of one perspective camera, got an orthographic one")
    _check("smooth_outlines", seen, light)
    own = view(seen.depth[0], np.float32), view(seen.triangle[0], np.int64), view(seen.object_id[0], np.int64)
    mesh = view(geometry.vertices, np.float64), view(geometry.faces, np.int32)
    shown = view(light, np.float32)
    out = np.empty_like(shown)
    blend_outlines(own, mesh, pixel_from_world(seen.cameras), shown, out)
    return torch.from_numpy(out)


def mean_of_places(seen: VisibilityBuffer, light: Tensor, places: Sequence[tuple[float, float]]) -> Tensor:
    """Light (H,W,3) of one camera as the mean over places in each pixel; across borders of objects every pixel keeps to
    its own.

    Args:
        places: pixels to the right of and below the middle, each at most one.

    Raises:
        InputError: several cameras, no place or one farther away, or shapes that do not fit. GradientError: light that
            asks for gradients.
    """
    _check("mean_of_places", seen, light)
    if not places or not all(abs(way) <= 1.0 for place in places for way in place):
        raise InputError(f"places must lie within a pixel of the middle, and be one at least, got {tuple(places)}")
    weights = np.zeros((3, 3))
    for right, down in places:
        across, along = (np.maximum(0.0, 1.0 - np.abs(np.arange(-1, 2) - way)) for way in (right, down))
        weights += np.outer(along, across) / len(places)
    shown = view(light, np.float32)
    out = np.empty_like(shown)
    weigh_neighbours(view(seen.object_id[0], np.int64), weights.astype(np.float32), shown, out)
    return torch.from_numpy(out)


def _check(name: str, seen: VisibilityBuffer, light: Tensor) -> None:
    if len(seen.triangle) != 1:
        raise InputError(f"seen must be of one camera, got {len(seen.triangle)}")
    check_tensor("light", light, (*seen.depth.shape[1:], 3))
    check_no_gradient(name, light=light)


def pixel_from_world(camera: Cameras) -> np.ndarray:
    """(3,4) float64: homogeneous pixel of a single perspective camera = matrix (point, 1)."""
    made = (camera.intrinsics[0].double() @ camera.camera_from_world[0, :3].double()).numpy()
    return np.ascontiguousarray(made)
