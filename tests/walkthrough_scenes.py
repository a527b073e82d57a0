"""Small captures with exact depth, drawn here: a box room with a table, textured so that every place is told apart."""

from __future__ import annotations

import numpy as np
import torch

from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere
from torchrender.walkthrough.frames.record import RgbdSequence


def quad(corners, object_id: int = 0) -> Mesh:
    vertices = torch.tensor(corners, dtype=torch.float64)
    return Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), object_id=object_id)


def room(ball: bool = True) -> Scene:
    """A closed room with a table top, and a ball on it."""
    meshes = [
        quad([[-2, 0, -2], [-2, 0, 2], [2, 0, 2], [2, 0, -2]], 0),
        quad([[-2, 0, 2], [2, 0, 2], [2, 2.5, 2], [-2, 2.5, 2]], 1),
        quad([[-2, 0, -2], [-2, 0, 2], [-2, 2.5, 2], [-2, 2.5, -2]], 2),
        quad([[2, 0, 2], [2, 0, -2], [2, 2.5, -2], [2, 2.5, 2]], 3),
        quad([[-2, 0, -2], [-2, 2.5, -2], [2, 2.5, -2], [2, 0, -2]], 6),
        quad([[-2, 2.5, -2], [-2, 2.5, 2], [2, 2.5, 2], [2, 2.5, -2]], 7),
        quad([[-1, 0.5, 0], [-1, 0.5, 1.4], [1, 0.5, 1.4], [1, 0.5, 0]], 4),
    ]
    if ball:
        ball_ = sphere(radius=0.25, segments=48)
        place = torch.tensor([0.0, 0.76, 0.7], dtype=torch.float64)
        meshes.append(Mesh(vertices=ball_.vertices.double() + place, faces=ball_.faces, object_id=5))
    return Scene(meshes=tuple(meshes))


def pattern(position: torch.Tensor) -> torch.Tensor:
    """(...,3) linear colour of world positions: smooth waves."""
    x, y, z = position.unbind(-1)
    waves = [torch.sin(3 * x + 1.3 * z), torch.sin(2.1 * y - 2 * z + 1), torch.sin(1.7 * x + 2.9 * y + z)]
    return (0.4 + 0.25 * torch.stack(waves, dim=-1)).float()


def views(count: int, size: int = 96, seed: int = 3) -> Cameras:
    rng = np.random.default_rng(seed)
    made = []
    for n in range(count):
        eye = np.array([-0.9 + 1.8 * (n / max(count - 1, 1)), 1.75, -1.5]) + rng.normal(size=3) * 0.08
        target = np.array([0.3 - 0.6 * (n % 3) / 2, 0.5, 0.8]) + rng.normal(size=3) * 0.2
        made.append(Cameras.look_at(eye, target, width=size, height=size, fov_deg=70, near=0.01))
    return Cameras.cat(made)


def photos(scene: Scene, cameras: Cameras) -> RgbdSequence:
    seen = rasterize(scene, cameras)
    known = seen.triangle >= 0
    image = torch.where(known[..., None], pattern(torch.where(known[..., None], seen.position, 0.0)), 0.0)
    return RgbdSequence.from_tensors(
        image.permute(0, 3, 1, 2),
        seen.depth[:, None],
        cameras.intrinsics,
        cameras.rotation,
        cameras.camera_from_world[:, :3, 3],
    )


def capture(count: int = 6, size: int = 96, ball: bool = True) -> RgbdSequence:
    return photos(room(ball), views(count, size))
