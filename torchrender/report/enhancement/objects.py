"""Objects of the study: the specification's own, scanned ones, a head from slices, a city."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import torch
import trimesh
from scipy.ndimage import distance_transform_cdt
from torch import Tensor

from torchrender.effects.enhancement.curvature import mesh_curvature
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.enhancement.surface_image import SurfaceImage
from torchrender.passes.picture.enhancement import seen_curvature
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

FILES = {"armadillo": "armadillo.ply", "dragon": "stanford_dragon_res2.ply", "rocker arm": "rocker-arm.obj"}


@dataclass(frozen=True, eq=False)
class Subject:
    """An object before a camera, white, with a light of no fall-off as the source has it."""

    name: str
    scene: Scene
    cameras: Cameras
    light: tuple[float, float, float]  # world space

    @cached_property
    def seen(self):  # type: ignore[no-untyped-def]
        """What the camera sees."""
        return rasterize(self.scene, self.cameras)

    @cached_property
    def surface(self) -> SurfaceImage:
        """The same, for enhancement."""
        return SurfaceImage.of(self.seen)

    def curvature(self, options: EnhanceOptions) -> Tensor:
        """(1,H,W) as the pass has it."""
        mesh = mesh_curvature(self.scene.geometry, options.limit, centred=options.centred)
        return seen_curvature(self.surface, self.seen, self.scene, mesh, options)

    @cached_property
    def lamp(self) -> PointLight:
        """Its brightness is undone by :attr:`square`."""
        return PointLight(position=torch.tensor(self.light), intensity=torch.full((3,), torch.pi))

    @cached_property
    def square(self) -> Tensor:
        """(1,H,W) squared distance to the light."""
        return (self.lamp.position.double() - self.seen.position).square().sum(-1).clamp_min(1e-12)

    @cached_property
    def plain(self) -> Tensor:
        """(1,H,W) cosine to the light."""
        away = self.lamp.position.double() - self.seen.position
        cosine = (away * self.seen.normal).sum(-1) / self.square.sqrt()
        return torch.where(self.seen.covered, cosine.clamp_min(0.0), 0.0)

    @cached_property
    def facing(self) -> Tensor:
        """(1,H,W) cosine to the eye; 0 where nothing is."""
        toward = torch.nn.functional.normalize(self.cameras.eye[0] - self.seen.position, dim=-1)
        return torch.where(self.seen.covered, (toward * self.seen.normal).sum(-1), 0.0)

    @cached_property
    def inner(self) -> Tensor:
        """(1,H,W) bool: more than six pixels from where nothing is, along rows, columns and diagonals."""
        return torch.from_numpy(distance_transform_cdt(self.seen.covered[0].numpy()) > 6)[None]


def bumps(light: tuple[float, float, float] = (-3.0, -3.0, 0.0)) -> Subject:
    """Section 8's sphere with bumps of 2 %."""
    made = trimesh.creation.icosphere(subdivisions=7)
    d = torch.nn.functional.normalize(torch.tensor(made.vertices, dtype=torch.float64), dim=-1)
    waves = torch.sin(14 * d[:, 0]) * torch.sin(14 * d[:, 1]) * torch.sin(14 * d[:, 2] + 1)
    v = d * (1.3 * (1 + 0.02 * waves))[:, None] + torch.tensor([0, 0, 4.0], dtype=torch.float64)
    k = torch.tensor([[[396.0, 0, 180], [0, 396, 180], [0, 0, 1]]])
    eye = torch.eye(4, dtype=torch.float64)[None]
    camera = Cameras(eye, k, 360, 360, torch.tensor(0.1), torch.tensor(100.0))
    return Subject("bumps", _scene(v, torch.tensor(made.faces.copy())), camera, light)


def _scene(vertices: Tensor, faces: Tensor) -> Scene:
    corners = vertices[faces]
    face = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(vertices).index_add(0, faces.reshape(-1), face.repeat_interleave(3, 0))
    normals = torch.nn.functional.normalize(normals / face.abs().max().clamp_min(1e-300), dim=-1, eps=1e-30)
    mesh = Mesh(vertices=vertices, faces=faces, normals=normals.float())
    return Scene(meshes=(mesh,), materials=(Material(diffuse=torch.ones(3)),))


def before_camera(name: str, scene: Scene, size: int) -> Subject:
    """Framed, lit from the upper left of the camera."""
    cameras = scene.camera(width=size, height=size)
    right, down = cameras.camera_from_world[0, 0, :3], cameras.camera_from_world[0, 1, :3]
    light = cameras.eye[0] - scene.diagonal * (0.7 * right + 0.7 * down)
    return Subject(name, scene, cameras, tuple(light.tolist()))


def subjects(data: Path, size: int) -> list[Subject]:
    """All objects that are there; those of files need the shared data."""
    makers: dict[str, Callable[[], Scene]] = {}
    for name, file in FILES.items():
        if (data / "meshes" / file).exists():
            makers[name] = partial(_file, data / "meshes" / file)
    head = data / "volumes" / "head_ct_64x64x93.npy"
    if head.exists():
        makers["CT head"] = lambda: _isosurface(np.load(head).astype(np.float32))
    makers["nest"] = lambda: _plain(load("nest"))
    makers["city"] = lambda: _plain(load("city"))
    return [before_camera(name, make(), size) for name, make in makers.items()]


def _file(path: Path) -> Scene:
    return _plain(load(path))


def _plain(scene: Scene) -> Scene:
    """The scene in white, without lights."""
    white = tuple(Material(diffuse=torch.ones(3)) for _ in scene.materials)
    return Scene(meshes=scene.meshes, materials=white, name=scene.name, cameras=scene.cameras)


def _isosurface(volume: np.ndarray) -> Scene:
    """Skin of a head of slices from the top down, rows from the face to the back."""
    from skimage.filters import gaussian, threshold_otsu
    from skimage.measure import marching_cubes

    smooth = gaussian(volume, 1.0)
    vertices, faces, _, _ = marching_cubes(smooth, threshold_otsu(smooth), spacing=(1.5, 3.2, 3.2))
    points = torch.tensor(vertices[:, [2, 0, 1]] * (1.0, -1.0, -1.0), dtype=torch.float64)
    return _scene(points, torch.tensor(faces.copy()).long())
