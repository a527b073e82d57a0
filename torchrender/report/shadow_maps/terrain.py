"""Four kilometres of hills with houses in front, which maps of shadows find hard: large, far, full of small things."""

from __future__ import annotations

import math

import numpy as np
import torch

from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

EXTENT = 4000.0  # metres
_OCTAVES = 7
_HOUSES = 60
_BOX = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (0.0, 1.0) for z in (-0.5, 0.5)])
_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def terrain(cells: int = 256, seed: int = 0) -> Scene:
    """Hills of ``cells`` x ``cells`` squares, houses of ten metres, and a low sun, seen from sixty metres up."""
    random = np.random.default_rng(seed)
    waves = [
        (
            random.uniform(0.0, math.tau),
            random.uniform(0.0, math.tau),
            random.uniform(0.0, math.pi),
            1.6 * EXTENT / 2**k,
        )
        for k in range(1, _OCTAVES + 1)
    ]

    def height(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        total = np.zeros_like(x)
        for first, second, turn, length in waves:
            a, b = math.cos(turn) * x + math.sin(turn) * z, math.cos(turn) * z - math.sin(turn) * x
            total += 0.06 * length * np.sin(math.tau * a / length + first) * np.sin(math.tau * b / length + second)
        return total

    line = (np.arange(cells + 1) / cells - 0.5) * EXTENT
    x, z = np.meshgrid(line, line, indexing="xy")
    corner = np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)
    a, b, c, d = (v.ravel() for v in (corner, corner + 1, corner + cells + 2, corner + cells + 1))
    hills = _mesh(np.stack([x, height(x, z), z], axis=-1).reshape(-1, 3), np.stack([[a, d, c], [a, c, b]], 0), "hills")
    place = np.stack([random.uniform(-260.0, 260.0, _HOUSES), random.uniform(700.0, 1250.0, _HOUSES)], axis=-1)
    size = random.uniform((6.0, 5.0, 6.0), (14.0, 14.0, 14.0), (_HOUSES, 3))
    foot = np.stack([place[:, 0], height(place[:, 0], place[:, 1]) - 1.5, place[:, 1]], axis=-1)
    corners = (_BOX * size[:, None] + foot[:, None]).reshape(-1, 3)
    faces = np.array([t for p, q, r, s in _SIDES for t in ((p, q, r), (p, r, s))])
    houses = _mesh(corners, (faces + 8 * np.arange(_HOUSES)[:, None, None]).reshape(-1, 3), "houses")
    eye = np.array([0.0, float(height(np.zeros(1), np.full(1, 1400.0))[0]) + 60.0, 1400.0])
    camera = Cameras.look_at(
        eye.tolist(), [0.0, float(eye[1]) - 130.0, 700.0], width=480, height=360, fov_deg=50.0, near=1.0
    )
    sun = DirectionalLight(direction=torch.tensor([-0.8, -0.42, -0.35]), irradiance=torch.full((3,), 3.0), name="sun")
    grass = Material(name="grass", diffuse=torch.tensor([0.30, 0.36, 0.18]))
    wall = Material(name="wall", diffuse=torch.tensor([0.72, 0.68, 0.60]))
    return Scene(
        meshes=(hills, houses), materials=(grass, wall), lights=(sun,), cameras={"main": camera}, name="terrain"
    )


def _mesh(vertices: np.ndarray, faces: np.ndarray, name: str) -> Mesh:
    order = faces.transpose(0, 2, 1).reshape(-1, 3) if faces.ndim == 3 else faces
    return Mesh(
        vertices=torch.from_numpy(vertices), faces=torch.from_numpy(order), name=name, material=int(name == "houses")
    )
