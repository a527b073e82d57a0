"""Rooms and photos for tests of the photo tools, small enough to be quick."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, sphere

ROOM = 4.0
WALLS = {
    "floor": ((ROOM, 0.1, ROOM), (0.0, -0.05, 0.0)),
    "ceiling": ((ROOM, 0.1, ROOM), (0.0, 2.75, 0.0)),
    "back wall": ((ROOM, 2.7, 0.1), (0.0, 1.35, -2.0)),
    "front wall": ((ROOM, 2.7, 0.1), (0.0, 1.35, 2.0)),
    "left wall": ((0.1, 2.7, ROOM), (-2.0, 1.35, 0.0)),
    "right wall": ((0.1, 2.7, ROOM), (2.0, 1.35, 0.0)),
}
THINGS = {
    "sofa": ((1.6, 0.7, 0.7), (-0.9, 0.35, -1.3)),
    "table": ((0.9, 0.5, 0.6), (0.3, 0.25, 0.0)),
    "shelf": ((0.4, 1.8, 1.0), (1.6, 0.9, -1.0)),
}


def placed(mesh: Mesh, middle: tuple[float, float, float], name: str, material: int) -> Mesh:
    shift = torch.tensor(middle, dtype=mesh.vertices.dtype)
    return replace(mesh, vertices=mesh.vertices + shift, name=name, material=material)


def room(colors: dict[str, tuple[float, float, float]] | None = None) -> Scene:
    """Nine boxes and a ball; every object has a material of its own."""
    meshes, materials = [], []
    for name, (size, middle) in {**WALLS, **THINGS}.items():
        meshes.append(placed(box(torch.tensor(size, dtype=torch.float64)), middle, name, len(materials)))
        materials.append(Material(name=name, diffuse=torch.tensor((colors or {}).get(name, (0.7, 0.7, 0.7)))))
    meshes.append(placed(sphere(0.3, 16), (0.3, 0.8, 0.0), "ball", len(materials)))
    materials.append(Material(name="ball", diffuse=torch.tensor((colors or {}).get("ball", (0.7, 0.7, 0.7)))))
    return Scene(meshes=tuple(meshes), materials=tuple(materials), name="room")


def around(count: int = 4, width: int = 64, height: int = 48) -> Cameras:
    """Views into the room from its corners."""
    angles = torch.arange(count, dtype=torch.float64) * (2 * torch.pi / count) + 0.6
    eyes = torch.stack([1.7 * angles.cos(), torch.full_like(angles, 1.5), 1.7 * angles.sin()], dim=1)
    return Cameras.look_at(eyes, [0.0, 1.0, 0.0], width=width, height=height, fov_deg=75.0)


def striped_photo(height: int = 60, width: int = 80) -> Tensor:
    """(H,W,3) linear: a light wall above, wood below, a blue thing on the left and a red one on the right."""
    photo = torch.zeros(height, width, 3)
    photo[: height // 2] = torch.tensor([0.7, 0.66, 0.58])
    photo[height // 2 :] = torch.tensor([0.30, 0.14, 0.06])
    photo[height // 3 : 3 * height // 4, : width // 4] = torch.tensor([0.05, 0.1, 0.45])
    photo[height // 3 : 3 * height // 4, 3 * width // 4 :] = torch.tensor([0.5, 0.03, 0.03])
    noise = torch.rand(photo.shape, generator=torch.Generator().manual_seed(1)) - 0.5
    return (photo * (1 + 0.1 * noise)).clamp(0, 1)
