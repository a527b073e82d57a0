"""The test scenes of specification 09: T1, and T2 with a grille under a lamp and with sun through two windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight
from torchrender.scene.material import Material
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.place import place_mesh

KINDS = ("homogeneous", "height", "grid")
GRID = 64


def _moved(mesh: Mesh, place: Sequence[float]) -> Mesh:
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, 3] = torch.tensor(place, dtype=torch.float64)
    return place_mesh(mesh, matrix)


def _box(low: Sequence[float], high: Sequence[float]) -> Mesh:
    a, b = torch.tensor(low, dtype=torch.float64), torch.tensor(high, dtype=torch.float64)
    return _moved(shapes.box(b - a), ((a + b) / 2).tolist())


def _spheres() -> list[Mesh]:
    return [_moved(shapes.sphere(0.7), (0.3, -0.3, -4.0)), _moved(shapes.sphere(0.5), (-1.2, -0.5, -5.0))]


def medium(kind: str, low: Tensor, high: Tensor) -> Medium:
    """kappa_s 0.3, kappa_a 0.1; heights a = 1.5, b = 0.8; a grid of smooth noise around density 1."""
    how: dict[str, Any] = {}
    if kind == "height":
        how = {"density": 1.5, "falloff": 0.8}
    if kind == "grid":
        noise = torch.from_numpy(np.random.default_rng(0).random((1, 1, GRID, GRID, GRID)).astype(np.float32))
        for _ in range(3):
            noise = torch.nn.functional.avg_pool3d(noise, 7, stride=1, padding=3, count_include_pad=False)
        how = {"density": ((noise - noise.mean()) / noise.std() * 0.8 + 1.0).clamp_min(0.02)[0, 0]}
    return Medium(
        low=low, high=high, absorption=torch.full((3,), 0.1), scattering=torch.full((3,), 0.3), name=kind, **how
    )


def t1(kind: str = "homogeneous") -> Scene:
    """Floor, wall, two spheres, and a lamp between them."""
    meshes = [_box((-5.0, -1.2, -8.2), (5.0, -1.0, 0.6)), _box((-5.0, -1.2, -8.2), (5.0, 4.2, -8.0)), *_spheres()]
    box = torch.tensor([-4.8, -1.0, -8.0]), torch.tensor([4.8, 4.0, 0.5])
    return _scene("T1", meshes, (_lamp(),), medium(kind, *box))


def t2(light: str, kind: str = "homogeneous") -> Scene:
    """A room with two barred windows in its left wall, and a grille of bars below a lamp."""
    low, high, e = (-2.5, -1.0, -8.0), (3.0, 2.5, 1.0), 0.2
    meshes = [
        _box((low[0] - e, -1.0 - e, -8.0 - e), (high[0] + e, -1.0, 1.0 + e)),
        _box((low[0] - e, 2.5, -8.0 - e), (high[0] + e, 2.5 + e, 1.0 + e)),
        _box((low[0] - e, -1.0 - e, -8.0 - e), (high[0] + e, 2.5 + e, -8.0)),
        _box((low[0] - e, -1.0 - e, 1.0), (high[0] + e, 2.5 + e, 1.0 + e)),
        _box((high[0], -1.0 - e, -8.0 - e), (high[0] + e, 2.5 + e, 1.0 + e)),
        _box((low[0] - e, -1.0 - e, -8.0 - e), (low[0], 0.3, 1.0 + e)),
        _box((low[0] - e, 1.9, -8.0 - e), (low[0], 2.5 + e, 1.0 + e)),
    ]
    for first, last in ((-1.6, 1.0 + e), (-3.8, -2.8), (-8.0 - e, -5.0)):
        meshes.append(_box((low[0] - e, 0.3, first), (low[0], 1.9, last)))
    for z in (-1.6, -3.8):
        for k in range(1, 6):
            at = z - 0.2 * k
            meshes.append(_box((-2.6, 0.3, at - 0.02), (-2.56, 1.9, at + 0.02)))
            at = 0.3 + 0.267 * k
            meshes.append(_box((-2.6, at - 0.02, z - 1.2), (-2.56, at + 0.02, z)))
    for k in range(9):
        at = -3.7 - 0.2 * k
        meshes.append(_box((0.2, 0.6, at - 0.03), (1.8, 0.62, at + 0.03)))
        meshes.append(_box((0.17 + 0.2 * k, 0.6, -5.3), (0.23 + 0.2 * k, 0.62, -3.7)))
    sun = DirectionalLight(direction=torch.tensor([0.75, -0.55, -0.35]), irradiance=torch.full((3,), 3.0))
    lit: tuple[Light, ...] = (sun,) if light == "sun" else (_lamp(),)
    return _scene(f"T2 {light}", [*meshes, *_spheres()], lit, medium(kind, torch.tensor(low), torch.tensor(high)))


def _lamp() -> PointLight:
    return PointLight(position=torch.tensor([1.0, 1.0, -4.5]), intensity=torch.full((3,), 3.0))


def _scene(name: str, meshes: list[Mesh], lights: tuple[Light, ...], fog: Medium) -> Scene:
    return Scene(meshes=tuple(meshes), materials=(Material(name="white"),), lights=lights, media=(fog,), name=name)


def eye(width: int, height: int, focal: float | None = None) -> Cameras:
    """At the origin, along -z; ``focal``: of T1, 0.9 widths, by default."""
    fov = 2 * math.degrees(math.atan(height / 2 / (focal or 0.9 * width)))
    return Cameras.look_at((0, 0, 0), (0, 0, -1), width=width, height=height, fov_deg=fov)
