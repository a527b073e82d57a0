"""The rays of a picture, from the eye to what it sees: of a G-buffer, or of any depth image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_tensor
from torchrender.effects.media.light_images import Sight
from torchrender.effects.media.tables import MediaTable
from torchrender.kernels.media.records import Beams
from torchrender.kernels.media.ways import clip_rays, eye_rays
from torchrender.scene.camera import Cameras


@dataclass(frozen=True, eq=False)
class EyeRays:
    """Rays of one picture with H x W pixels, relative to the eye, and where they may meet a medium."""

    beams: Beams
    shape: tuple[int, int]
    camera: Cameras | None  # None: they are no picture
    sight: Sight | None  # None: they have no eye in common

    @property
    def length(self) -> Tensor:
        """(H,W) float32 length between where a ray enters the media and where it ends or leaves them; 0 for none."""
        span = torch.from_numpy(self.beams.span)
        return (span[:, 1] - span[:, 0]).clamp_min(0.0).reshape(self.shape)


def eye_of(camera: Cameras) -> Tensor:
    """(3,) float64 origin that media and lights are moved to."""
    return camera.eye[0]


def rays_of(camera: Cameras, depth: Tensor, table: MediaTable, position: Tensor | None = None) -> EyeRays:
    """The rays of one camera.

    Args:
        depth: (H,W) camera z of what it sees; +inf where that is nothing.
        table: media relative to :func:`eye_of` the camera.
        position: (H,W,3) float64 places of what it sees, where they are known; pixels need not be at their place then.
    """
    check_tensor("depth", depth, (camera.height, camera.width))
    count = depth.numel()
    direction, span = np.empty((count, 3), np.float32), np.empty((count, 2), np.float32)
    beams = Beams(np.zeros((1, 3), np.float32), direction, span)
    if camera.orthographic:
        return _parallel_rays(camera, depth, table)
    k, rotation = camera.intrinsics[0], camera.rotation[0]
    matrix = rotation.T @ torch.linalg.inv(k)
    where = np.zeros((0, 0, 3)) if position is None else view(position, np.float64)
    given = view(matrix, np.float32), view(eye_of(camera), np.float64)
    eye_rays(table.arrays, given, view(depth, np.float32), where, beams)
    w, h = float(camera.width), float(camera.height)
    corners = torch.tensor([[0, 0, 1], [w, 0, 1], [w, h, 1], [0, h, 1]], dtype=torch.float64) @ matrix.T
    longest = float(span[:, 1].max(initial=0.0))
    sight = Sight(corners, matrix, longest, 1.0 / float(torch.maximum(k[0, 0], k[1, 1])))
    return EyeRays(beams, (camera.height, camera.width), camera, sight)


def rays_along(origins: Tensor, directions: Tensor, lengths: Tensor, table: MediaTable) -> EyeRays:
    """Any N rays, as an image of one row.

    Args:
        origins: (N,3) float64 world space. directions: (N,3) unit. lengths: (N,), +inf where they do not end.
        table: media relative to any origin.
    """
    count = len(origins)
    beams = Beams(
        view((origins - table.origin), np.float32), view(directions, np.float32), np.empty((count, 2), np.float32)
    )
    clip_rays(table.arrays, beams, view(lengths.double().clamp_max(1e30), np.float32))
    return EyeRays(beams, (1, count), None, None)


def _parallel_rays(camera: Cameras, depth: Tensor, table: MediaTable) -> EyeRays:
    origins, directions = camera.rays()
    length = directions.norm(dim=-1)
    lengths = (depth.double() * length[0]).clamp_max(1e30)
    beams = Beams(
        view((origins[0] - eye_of(camera)).reshape(-1, 3), np.float32),
        view((directions[0] / length[0, ..., None]).reshape(-1, 3), np.float32),
        np.empty((depth.numel(), 2), np.float32),
    )
    clip_rays(table.arrays, beams, view(lengths.reshape(-1), np.float32))
    return EyeRays(beams, (camera.height, camera.width), camera, None)
