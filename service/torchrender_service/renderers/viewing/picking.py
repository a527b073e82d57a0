"""What a pixel shows: the ids that the rasterizer gives it, and the point on that triangle."""

from __future__ import annotations

from typing import Any

from torchrender.errors import InputError
from torchrender.raster import rasterize
from torchrender.scene.model import Scene
from torchrender.wire.cameras import cameras_of
from torchrender_service.renderers.jobs import FindPixel


def find_pixel(scene: Scene, job: FindPixel) -> dict[str, Any]:
    """Fields of PICKED without ``seq``; ``triangle`` -1 alone where the pixel shows no surface.

    The pixel is drawn by itself, with the camera cut to it, so that it has the ids that it has in the whole picture.

    Raises:
        InputError: the pixel lies outside the picture.
    """
    camera = cameras_of(job.camera)
    column, row = int(job.x // 1), int(job.y // 1)
    if not (0 <= column < camera.width and 0 <= row < camera.height):
        size = f"{camera.width} x {camera.height}"
        raise InputError(f"x and y must lie in a picture of {size}, got {job.x:g}, {job.y:g}")
    if job.scene_s is not None:
        scene = scene.at(scene.looped(job.scene_s))
    seen = rasterize(scene, camera.sub_camera(column, row, 1, 1))
    triangle = int(seen.triangle[0, 0, 0])
    if triangle < 0:
        return {"triangle": -1}
    number, before = _mesh_of(scene, triangle)
    mesh = scene.meshes[number]
    return {
        "triangle": triangle,
        "object": number,
        "face": triangle - before,
        "name": mesh.name[:200],
        "material": scene.materials[mesh.material].name[:200],
        "point": seen.position[0, 0, 0].tolist(),
        "normal": seen.normal[0, 0, 0].tolist(),
        "depth": float(seen.depth[0, 0, 0]),
    }


def _mesh_of(scene: Scene, triangle: int) -> tuple[int, int]:
    """The number of a triangle's mesh, and how many triangles come before that mesh."""
    before = 0
    for number, mesh in enumerate(scene.meshes):
        if triangle < before + len(mesh.faces):
            return number, before
        before += len(mesh.faces)
    raise InputError(f"there is no triangle {triangle}")
