"""Cameras that requests describe, as cameras of the renderer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.wire.cameras import cameras_of
from torchrender_service.renderers.jobs import View
from torchrender_service.renderers.scene_cache import shown


def camera_of_view(scene: Scene, view: View) -> Cameras:
    """The camera that a request describes.

    Raises:
        InputError: no camera of that name, or one that is not usable.
    """
    if view.pose is not None:
        return cameras_of(view.pose)
    if view.look_at is not None:
        return _looking(scene, view, view.look_at)
    return scene.camera(_whole_name(scene, view.name), width=view.width, height=view.height)


NARROWEST = 5 / 6
"""Width over height of a view from which on a narrower one shows no less from side to side: phones are held upright."""


def first_camera(scene: Scene, view: View) -> Cameras:
    """The camera that a stream begins with: as :func:`camera_of_view`, but no window shows less from side to side than
    one of the shape ``NARROWEST`` does, or than the scene's own camera where that is narrower.

    Raises:
        InputError: as :func:`camera_of_view`.
    """
    camera = camera_of_view(scene, view)
    name = _whole_name(scene, view.name)
    if view.pose is not None or view.look_at is not None or not scene.cameras or camera.orthographic:
        return camera  # framed as it is
    own = scene.cameras[name] if name is not None else next(iter(scene.cameras.values()))
    share = view.width / view.height / min(own.width / own.height, NARROWEST)
    if share >= 1.0:
        return camera
    k = camera.intrinsics.clone()
    k[:, :2, :2] *= share
    middle = 0.5 * torch.tensor([view.width, view.height], dtype=k.dtype)
    k[:, :2, 2] = middle + (k[:, :2, 2] - middle) * share
    return replace(camera, intrinsics=k)


def _whole_name(scene: Scene, name: str | None) -> str | None:
    """The name of a camera that clients know by its beginning."""
    if name is None or name in scene.cameras:
        return name
    return next((whole for whole in scene.cameras if shown(whole) == name), name)


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
