"""Pictures of points where a scene might have been given: they need no plan, and take no wishes for one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torchrender.errors import InputError
from torchrender.points.cloud import PointCloud
from torchrender.points.draw import render_points
from torchrender.points.options import PointImage
from torchrender.points.tree import PatchSet
from torchrender.scene.camera import Cameras
from torchrender.scene.model import DEFAULT_SIZE, resized, sides


def picture(
    cloud: object, camera: Cameras | str | None, size: tuple[int | None, int | None], wishes: Mapping[str, Any]
) -> PointImage:
    """Pictures of points from these cameras, or from one that frames them.

    Args:
        size: width and height in pixels; None: those of the cameras, else the usual size.
        wishes: what scenes take, by name; points take none of it.

    Raises:
        InputError: no points, or a wish.
    """
    if not isinstance(cloud, PointCloud | PatchSet):
        raise InputError(
            "scene must be a Scene, the name or file of one, or points (PointCloud, PatchSet), "
            f"got {type(cloud).__name__}; a Mesh goes into Scene(meshes=[mesh])"
        )
    named = [name for name, wish in wishes.items() if wish is not None]
    if named:
        raise InputError(f"{', '.join(named)}: for scenes; points take SplatOptions, by render_points")
    if isinstance(camera, Cameras):
        return render_points(cloud, resized(camera, *sides(size, (camera.width, camera.height))))
    return render_points(cloud, cloud.camera(camera, **sides(size, DEFAULT_SIZE)._asdict()))
