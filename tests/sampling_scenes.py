"""Small scenes and cameras for tests of depth-image sampling."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

HALF_PIXELS = 4.0  # the front camera maps x / depth to pixels by 8: u = 4 + 8 x / z


def front(width: int = 8, *, eye: Sequence[float] = (0.0, 0.0, 0.0), near: float = 0.01) -> Cameras:
    """Looks along -z; at depth 1 the image is one unit wide whatever its size in pixels."""
    target = (eye[0], eye[1], eye[2] - 1.0)
    return Cameras.look_at(eye, target, width=width, height=width, fov_deg=53.13010235415598, near=near)


def at_pixel(u: float, v: float, depth: float) -> tuple[float, float, float]:
    """World point that the 8 x 8 front camera at the origin sees at pixel (u, v)."""
    return (u - HALF_PIXELS) / 8.0 * depth, -(v - HALF_PIXELS) / 8.0 * depth, -depth


def wall(depth: float, *, half: float = 50.0, centre: Sequence[float] = (0.0, 0.0)) -> list[tuple[float, float, float]]:
    """Two triangles that face +z, as six corners."""
    x, y = centre
    a, b, c, d = ((x + i * half, y + j * half, -depth) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return [a, b, c, a, c, d]


def triangle(depth: float, *corners: tuple[float, float]) -> list[tuple[float, float, float]]:
    """A triangle at given pixels of the front camera, turned to face it."""
    points = [at_pixel(u, v, depth) for u, v in corners]
    (ax, ay, _), (bx, by, _), (cx, cy, _) = points
    return points if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0 else points[::-1]


def soup(*parts: Sequence[tuple[float, float, float]]) -> Scene:
    """A scene of loose triangles, ids in the order given."""
    points = torch.tensor([p for part in parts for p in part], dtype=torch.float64).reshape(-1, 3)
    return Scene(meshes=(Mesh(vertices=points, faces=torch.arange(len(points)).reshape(-1, 3)),))


def ring(scene: Scene, size: int, *, spread: float = 0.1, count: int = 3) -> Cameras:
    """Cameras around the scene's own view."""
    from torchrender.depth.viewpoints import viewpoints_around

    return viewpoints_around(scene, scene.camera(width=size, height=size), count, spread=spread)
