"""Cameras of messages and requests as cameras of the renderer, and back."""

from __future__ import annotations

from typing import Any

import torch

from service.jobs import View
from service.messages import CameraHeader
from torchrender.errors import CameraError
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

RIGID_TOLERANCE = 1e-3


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


def header_of(camera: Cameras) -> CameraHeader:
    """The header of a single perspective camera."""
    k = camera.intrinsics[0]
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


def camera_of_view(scene: Scene, view: View) -> Cameras:
    """The camera that a request describes.

    Raises:
        InputError: no camera of that name, or one that is not usable.
    """
    if view.pose is not None:
        return cameras_of(view.pose)
    if view.look_at is not None:
        return _looking(scene, view, view.look_at)
    return scene.camera(view.name, width=view.width, height=view.height)


def _looking(scene: Scene, view: View, given: dict[str, Any]) -> Cameras:
    diagonal = scene.diagonal or 1.0
    target = given.get("target")
    near = given.get("near")
    return Cameras.look_at(
        given["eye"],
        scene.bounds.mean(dim=0) if target is None else target,
        width=view.width,
        height=view.height,
        fov_deg=given.get("fov_deg", 50.0),
        up=given.get("up", (0.0, 1.0, 0.0)),
        near=1e-4 * diagonal if near is None else near,
    )
