"""Scenes in media that several tests share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.media.eye_rays import rays_of
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.scatter import Illumination, scatter
from torchrender.effects.shadows.shadow_map import ShadowOptions, render_shadow_map
from torchrender.raster import rasterize
from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight
from torchrender.scene.material import Material
from torchrender.scene.medium import Medium
from torchrender.scene.model import Scene
from torchrender.scene.place import place_mesh

LOW, HIGH = torch.tensor([-4.8, -1.0, -8.0]), torch.tensor([4.8, 4.0, 0.5])
LAMP = PointLight(position=torch.tensor([1.0, 1.0, -4.5]), intensity=torch.full((3,), 2.0))
SUN = DirectionalLight(direction=torch.tensor([0.75, -0.55, -0.35]), irradiance=torch.full((3,), 3.0))


def fog(**changes: Any) -> Medium:
    """The medium of specification 09's test scene, in world coordinates: y up, seen along -z."""
    usual: dict[str, Any] = {
        "low": LOW, "high": HIGH, "absorption": torch.full((3,), 0.1), "scattering": torch.full((3,), 0.3)
    }  # fmt: skip
    return Medium(**{**usual, **changes})


def eye(width: int = 200, height: int = 150) -> Cameras:
    """fx = fy = 180 at 200 x 150."""
    fov = 2 * math.degrees(math.atan(75 / 180))
    return Cameras.look_at((0, 0, 0), (0, 0, -1), width=width, height=height, fov_deg=fov)


def moved(mesh: Any, x: float, y: float, z: float) -> Any:
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, 3] = torch.tensor([x, y, z])
    return place_mesh(mesh, matrix)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Any:
    a, b = torch.tensor(low), torch.tensor(high)
    return moved(shapes.box(b - a), *((a + b) / 2).tolist())


def t1(*lights: Light, medium: Medium | None = None, grille: bool = False) -> Scene:
    """Floor, wall and two spheres; with ``grille`` nine bars between lamp and floor."""
    meshes = [box((-5.0, -1.2, -8.2), (5.0, -1.0, 0.6)), box((-5.0, -1.2, -8.2), (5.0, 4.2, -8.0))]
    meshes += [moved(shapes.sphere(0.7), 0.3, -0.3, -4.0), moved(shapes.sphere(0.5), -1.2, -0.5, -5.0)]
    if grille:
        meshes += [box((0.2, 0.6, -5.33 + 0.2 * k), (1.8, 0.62, -5.27 + 0.2 * k)) for k in range(9)]
    return Scene(
        meshes=meshes, materials=(Material(name="white"),), lights=lights or (LAMP,), media=(medium or fog(),),
        cameras={"default": eye()}, name="t1",
    )  # fmt: skip


def scattered(scene: Scene, camera: Cameras, *, shadows: bool = True, **options: Any) -> Any:
    """The layer, with shadow maps of 512 texels."""
    seen = rasterize(scene, camera)
    maps = ()
    if shadows:
        maps = tuple(render_shadow_map(scene, light, ShadowOptions(size=512)) for light in scene.lights)
    lit = Illumination(lights=scene.lights, shadow_maps=maps, size=scene.diagonal)
    return scatter(scene.media, camera, seen.depth, lit, ScatterOptions(**options), position=seen.position)


def rmse(found: Tensor, wanted: Tensor) -> float:
    """Relative to the mean of what is wanted."""
    return float((found - wanted).double().square().mean().sqrt() / wanted.double().mean())


def quadrature(
    direction: np.ndarray, ends: tuple[float, float], lamp: np.ndarray, extinction: Any, source: Any, count: int = 20000
) -> float:
    """Light of an isotropic unit lamp along one ray from the origin, by many steps of equal angle.

    Args:
        extinction: optical depth between two places. source: scattering coefficient at a place.
    """
    t0 = float(direction @ lamp)
    away = float(np.linalg.norm(direction * t0 - lamp))
    first, last = math.atan2(ends[0] - t0, away), math.atan2(ends[1] - t0, away)
    angle = first + (last - first) * (np.arange(count) + 0.5) / count
    t = t0 + away * np.tan(angle)
    places = direction * t[:, None]
    values = source(places) * np.exp(-extinction(np.zeros(3), places) - extinction(lamp, places))
    return float(values.sum() * (last - first) / count / away / (4 * math.pi))


__all__ = [
    "HIGH",
    "LAMP",
    "LOW",
    "SUN",
    "box",
    "eye",
    "fog",
    "moved",
    "quadrature",
    "rays_of",
    "rmse",
    "scattered",
    "t1",
]
