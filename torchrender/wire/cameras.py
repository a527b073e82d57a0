"""Cameras of messages as cameras of the renderer, and back."""

from __future__ import annotations

import math
from urllib.parse import quote

import torch

from torchrender.errors import CameraError
from torchrender.scene.camera import Cameras
from torchrender.wire.messages import CameraHeader

RIGID_TOLERANCE = 1e-3
DIGITS = 8
AHEAD = 0.2
"""Of the diagonal: how far before the eye the point lies that an address names."""
LEAST_AHEAD = 1e-8
"""Of the eye's coordinates: nearer points are hardly told from the eye itself."""


def cameras_of(header: CameraHeader) -> Cameras:
    """One camera.

    Raises:
        CameraError: ``world_from_camera`` is no rotation and translation.
    """
    matrix = torch.tensor(header.world_from_camera, dtype=torch.float64).reshape(4, 4)
    rotation = matrix[:3, :3]
    off = float((rotation @ rotation.T - torch.eye(3, dtype=torch.float64)).abs().max())
    last = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64)
    if not off <= RIGID_TOLERANCE or float(torch.linalg.det(rotation)) < 0 or not torch.equal(matrix[3], last):
        raise CameraError("world_from_camera must be a rotation and a translation, row by row")
    # Clients compute in single precision: the nearest rotation makes it exact again.
    u, _, v = torch.linalg.svd(rotation)
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = (u @ v).T
    pose[:3, 3] = -(u @ v).T @ matrix[:3, 3]
    k = torch.tensor([[header.fx, 0.0, header.cx], [0.0, header.fy, header.cy], [0.0, 0.0, 1.0]], dtype=torch.float64)
    near, far = torch.tensor(header.near, dtype=torch.float64), torch.tensor(torch.inf, dtype=torch.float64)
    return Cameras(pose[None], k[None], header.width, header.height, near, far)


def is_skewed(camera: Cameras) -> bool:
    """Whether a single camera's columns of pixels are not perpendicular to its rows."""
    return float(camera.intrinsics[0, 0, 1]) != 0.0


def header_of(camera: Cameras) -> CameraHeader:
    """The header of a single perspective camera.

    Raises:
        CameraError: its pixels are skewed, which no message can tell.
    """
    k = camera.intrinsics[0]
    if is_skewed(camera):
        raise CameraError(f"camera: messages tell no skew, intrinsics[0, 1] must be 0, got {float(k[0, 1]):g}")
    return CameraHeader(
        world_from_camera=tuple(camera.world_from_camera[0].reshape(-1).tolist()),
        fx=float(k[0, 0]),
        fy=float(k[1, 1]),
        cx=float(k[0, 2]),
        cy=float(k[1, 2]),
        width=camera.width,
        height=camera.height,
        near=float(camera.near[0]),
    )


def view_text(camera: CameraHeader, diagonal: float) -> str:
    """Eye and target as an address has them, with as many digits as the direction needs; ``js/address.js`` does it
    alike."""
    matrix = torch.tensor(camera.world_from_camera, dtype=torch.float64).reshape(4, 4)
    eye, forward = matrix[:3, 3], matrix[:3, 2]
    size = float(eye.abs().max())
    ahead = max(AHEAD * diagonal or 1.0, LEAST_AHEAD * size)
    digits = DIGITS + math.ceil(max(0.0, math.log10(max(size, 1e-300) / ahead)))
    numbers = (*eye.tolist(), *(eye + ahead * forward).tolist())
    return quote(",".join(f"{v:.{min(digits, 17)}g}" for v in numbers), safe=",")
