"""What the study of points draws: sampled meshes, scans, synthetic models, and references by supersampling."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from torchrender.points.cloud import PointCloud
from torchrender.points.load import load_points, sample_points
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene

SCANS = ("kitten_normals", "livingroom_fragment_colored", "room_scan1")


def data_folder() -> Path:
    """Where the real models are: ``TORCHRENDER_DATA``, or ``../shared/data`` beside the repository."""
    root = Path(__file__).resolve().parents[3]
    return Path(os.environ.get("TORCHRENDER_DATA", root.parent / "shared" / "data"))


def bumpy_sphere(count: int) -> PointCloud:
    """``count`` evenly spread points of a sphere with waves of a tenth of its radius, coloured by a checker."""
    k = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * k / count
    phi = torch.remainder(k * (math.pi * (3 - 5**0.5)), 2 * math.pi)
    ring = (1 - z * z).sqrt()
    unit = torch.stack([ring * phi.cos(), ring * phi.sin(), z], dim=1)
    height, waves = 0.05, 9.0
    sine, cosine = (waves * unit).sin(), (waves * unit).cos()
    bump = 1 + height * sine.prod(1)
    gradient = (
        height
        * waves
        * torch.stack([cosine[:, a] * sine[:, (a + 1) % 3] * sine[:, (a + 2) % 3] for a in range(3)], dim=1)
    )
    tangent = gradient - (gradient * unit).sum(1, keepdim=True) * unit
    light = ((unit * 6).floor().sum(1) % 2 == 0).float()[:, None]
    return PointCloud(
        position=bump[:, None] * unit,
        normal=(bump[:, None] * unit - tangent).float(),
        radius=torch.full((count,), 1.3 * math.sqrt(4 * math.pi / count)),
        color=light * torch.tensor([0.75, 0.7, 0.6]) + (1 - light) * torch.tensor([0.2, 0.35, 0.6]),
        name=f"bumpy sphere {count / 1e6:g} M",
    )


@dataclass(frozen=True, eq=False)
class Model:
    """A model of the study."""

    name: str
    scene: Scene | None  # what was sampled
    cloud: PointCloud


Maker = Callable[[], Model]


def models(meshes: Iterable[tuple[str, str, int]], scans: Iterable[str], otherwise: int) -> dict[str, Maker]:
    """By name, what makes them: sampled meshes (name, file, samples) and scans whose files are there.

    Without any there is a bumpy sphere of ``otherwise`` points, so that there is something to draw.
    """
    found: dict[str, Maker] = {}
    for name, file, samples in meshes:
        if (path := data_folder() / "meshes" / file).is_file():
            found[name] = partial(_mesh_model, name, path, samples)
    for name in scans:
        if (path := data_folder() / "points" / f"{name}.ply").is_file():
            found[name] = partial(_scan_model, name, path)
    return found or {"bumpy sphere": lambda: Model("bumpy sphere", None, bumpy_sphere(otherwise))}


def _scan_model(name: str, path: Path) -> Model:
    return Model(name, None, load_points(path))


def _mesh_model(name: str, path: Path, samples: int) -> Model:
    scene = load(path)
    return Model(name, scene, sample_points(scene, samples))


def close_camera(cloud: PointCloud, size: int) -> Cameras:
    """The model fills the picture: from half-way between its framing view and the middle of its box."""
    far = cloud.camera(width=size, height=size)
    centre = cloud.bounds.mean(0)
    eye = centre + 0.8 * (far.eye[0] - centre)
    return Cameras.look_at(eye, centre, width=size, height=size, fov_deg=40, near=1e-3 * cloud.diagonal)


def ground(spacing: float = 0.08) -> PointCloud:
    """A ground of unit checkers, 8 wide and 23 deep, seen along -z."""
    x = torch.arange(-4.0, 4.0, spacing, dtype=torch.float64) + spacing / 2
    z = -torch.arange(1.0, 24.0, spacing, dtype=torch.float64) - spacing / 2
    zz, xx = torch.meshgrid(z, x, indexing="ij")
    position = torch.stack([xx, torch.zeros_like(xx), zz], dim=-1).reshape(-1, 3)
    return PointCloud(
        position=position,
        normal=torch.tensor([0.0, 1.0, 0.0]).expand(len(position), 3),
        radius=torch.full((len(position),), spacing),
        color=checker(position[:, 0], position[:, 2])[:, None].expand(len(position), 3),
        name="checkered ground",
    )


def checker(x: Tensor, z: Tensor) -> Tensor:
    """1 on every second unit square, else 0."""
    return ((x.floor() + z.floor()) % 2 == 0).float()


def ground_reference(camera: Cameras, factor: int) -> tuple[Tensor, Tensor, Tensor]:
    """Brightness (H,W) of the ground by ``factor`` squared rays a pixel, its share of the pixel, and its depth."""
    _, rays = camera.scaled(factor).rays()
    t = -camera.eye[0, 1] / rays[0, ..., 1]
    hit = camera.eye[0] + t[..., None] * rays[0]
    inside = (t > 0) & (hit[..., 0].abs() < 4) & (hit[..., 2] < -1) & (hit[..., 2] > -24)
    planes = [checker(hit[..., 0], hit[..., 2]).double(), torch.ones_like(t), t]
    stacked = torch.stack([torch.where(inside, p, 0.0) for p in planes])
    blocks = stacked.reshape(3, camera.height, factor, camera.width, factor).mean(dim=(2, 4))
    return blocks[0], blocks[1], blocks[2]
