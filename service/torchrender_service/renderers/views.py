"""Cameras that requests describe, as cameras of the renderer."""

from __future__ import annotations

from typing import Any

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
