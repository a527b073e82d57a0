"""Pictures of the voxel study: cubes, attributes, Boolean operations, functions, and voxels in a CT volume."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.numerics.color import srgb_from_linear
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.report.gallery.study import sheet
from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene
from torchrender.voxels.attributes import voxelize_scene
from torchrender.voxels.collision import CollisionOptions, collide
from torchrender.voxels.functions import voxelize_implicit
from torchrender.voxels.grid import VoxelGrid, Voxels, make_grid
from torchrender.voxels.mesh import voxel_mesh
from torchrender.voxels.solid import SolidOptions, voxelize_solid
from torchrender.voxels.volume import (
    VolumeLayer,
    density_layer,
    over_background,
    render_volume,
    surface_layer,
    voxel_layer,
)

BACKGROUND = (0.09, 0.1, 0.12)
CT_SPACING = (3.2, 3.2, 1.5)  # millimetres
TISSUE = (  # value, colour, opacity over 1.5 mm
    (500.0, (0.85, 0.50, 0.38), 0.0),
    (900.0, (0.85, 0.50, 0.38), 0.018),
    (1250.0, (0.85, 0.50, 0.38), 0.018),
    (1500.0, (1.0, 0.95, 0.85), 0.05),
    (2600.0, (1.0, 0.98, 0.92), 0.2),
)


def tangle(points: Tensor) -> Tensor:
    """The source's implicit surface: six tubes that meet."""
    return (points**4 - 5 * points**2).sum(dim=1) + 11.8


def sphere_points(uv: Tensor) -> Tensor:
    """Unit sphere from longitude and polar angle."""
    u, v = uv.unbind(1)
    return torch.stack([u.cos() * v.sin(), v.cos(), u.sin() * v.sin()], dim=1)


def draw_pictures(folder: Path, size: int) -> dict[str, Any]:
    """Write ``voxels.jpg`` and return the milliseconds of the transparent pictures."""
    data = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))
    tiles: list[tuple[str, Tensor]] = []
    times: dict[str, Any] = {}
    spot = data / "meshes" / "spot_textured.glb"
    if spot.is_file():
        scene = load(spot)
        surface = voxelize_scene(scene, make_grid(scene.bounds[None], 96))
        mesh = voxel_mesh(surface.voxels, surface.color)
        tiles.append(("Surface voxels with colour, 96 cells", _cubes(mesh, (0.9, 0.5, 1.2), size)))
        image, times["surface alone"] = _timed(
            [surface_layer(surface, 0.12)], _around(scene.bounds, (0.9, 0.5, 1.2), size)
        )
        tiles.append(("The same, transparent", _flat(image)))
    tiles.append(("Box and ball less three cylinders, 128 cells", _cubes(_carved(128), (0.9, 0.7, 1.1), size)))
    grid = VoxelGrid(torch.full((1, 3), -2.5), torch.tensor([5 / 96]), (96, 96, 96))
    tiles.append(
        ("Implicit surface, 96 cells", _cubes(voxel_mesh(voxelize_implicit(tangle, grid)), (0.8, 0.6, 1.2), size))
    )
    tiles.append(("Voxels that two rings share, red", _shared(size)))
    dragon = data / "meshes" / "stanford_dragon_res2.ply"
    if dragon.is_file():
        tiles.append(("Solid dragon cut open, 192 cells", _cut(load(dragon), 192, size)))
    ct = data / "volumes" / "head_ct_64x64x93.npy"
    if ct.is_file():
        head = density_layer(torch.from_numpy(np.load(ct).astype(np.float32)), TISSUE, spacing=CT_SPACING)
        box = torch.stack([head.origin, head.origin + head.spacing * torch.tensor(head.dims)])
        camera = _around(box, (-0.8, -1.5, -0.25), size, up=(0.0, 0.0, -1.0))
        image, times["CT alone"] = _timed([head], camera)
        tiles.append(("CT head", _flat(image)))
        image, times["CT with voxels"] = _timed([head, _implant(box)], camera)
        tiles.append(("CT head with a voxelized ring inside", _flat(image)))
    picture = sheet(tiles)
    write_atomically(folder / "voxels.jpg", lambda p: picture.save(p, format="JPEG", quality=85))
    return times


def _cubes(mesh: Mesh, toward: tuple[float, float, float], size: int) -> Tensor:
    scene = Scene(meshes=(mesh,))
    image = render(scene, _around(scene.bounds, toward, size), options=RenderOptions(supersample=2))
    return image.to_srgb()[0]


def _around(
    bounds: Tensor, toward: tuple[float, float, float], size: int, up: tuple[float, float, float] = (0.0, 1.0, 0.0)
) -> Cameras:
    """A camera that sees a whole box from a direction."""
    centre, diagonal = bounds.double().mean(dim=0), float((bounds[1] - bounds[0]).norm())
    away = torch.nn.functional.normalize(torch.tensor(toward, dtype=torch.float64), dim=0) * diagonal * 1.45
    return Cameras.look_at((centre + away).tolist(), centre.tolist(), width=size, height=size, fov_deg=38, up=up)


def _timed(layers: list[VolumeLayer], camera: Cameras) -> tuple[Tensor, float]:
    render_volume(layers, camera)
    begin = time.perf_counter()
    image = render_volume(layers, camera)
    return image, 1e3 * (time.perf_counter() - begin)


def _flat(image: Tensor) -> Tensor:
    return srgb_from_linear(over_background(image, BACKGROUND)[0].clamp(0, 1))


def _carved(cells: int) -> Mesh:
    """Boolean operations on solids: a box and a ball in common, less three cylinders."""
    grid = VoxelGrid(torch.full((1, 3), -1.1), torch.tensor([2.2 / cells]), (cells, cells, cells))

    def solid(mesh: Mesh, turn: int = 0) -> Voxels:
        return voxelize_solid(mesh.vertices.roll(turn, dims=1)[None], mesh.faces, grid, SolidOptions())[0]

    body = solid(shapes.box(torch.tensor([2.0, 2.0, 2.0]))) & solid(shapes.sphere(1.3, 128))
    for turn in range(3):
        body = body - solid(shapes.cylinder(0.62, 3.0, 96), turn)
    return voxel_mesh(body)


def _cut(scene: Scene, cells: int, size: int) -> Tensor:
    """The far half of a solid; the cut shows that it is filled."""
    grid = make_grid(scene.bounds[None], cells)
    solid, _ = voxelize_solid(scene.geometry.vertices[None], scene.geometry.faces, grid, SolidOptions(warn=False))
    dense = solid.dense()
    dense[:, dense.shape[1] // 2 :] = False
    half = Voxels.from_dense(dense, grid)
    low, high = scene.bounds[:, 2]
    depth = ((half.cells()[:, 2:] + 0.5) * grid.cell[0] + grid.origin[0, 2] - low) / (high - low)
    color = torch.where(depth > 0.47, torch.tensor([0.75, 0.25, 0.12]), torch.tensor([0.35, 0.5, 0.4]))
    return _cubes(voxel_mesh(half, color.float()), (0.35, 0.35, 1.4), size)


def _shared(size: int) -> Tensor:
    """Two linked rings, transparent, and the voxels that both hold."""
    ring = concatenate([shapes.torus(1.0, 0.3, 128)])
    away = torch.eye(4, dtype=torch.float64)
    away[:3, :3] = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    away[0, 3] = 0.5
    found = collide(ring, ring, CollisionOptions(resolution=96), world_from_second=away)
    layers = [] if found.shared is None else [voxel_layer(found.shared, (0.9, 0.04, 0.02), 0.6)]
    both = [ring.vertices, ring.vertices @ away[:3, :3].T + away[:3, 3]]
    for vertices, color in zip(both, ((0.3, 0.5, 0.9), (0.9, 0.75, 0.3)), strict=True):
        scene = Scene(meshes=(Mesh(vertices=vertices, faces=ring.faces.long()),))
        surface = voxelize_scene(scene, make_grid(scene.bounds[None], 128))
        layers.append(surface_layer(surface, 0.08, color=color))
    box = torch.stack([torch.cat(both).amin(0), torch.cat(both).amax(0)])
    return _flat(render_volume(layers, _around(box, (0.6, 0.7, 1.3), size)))


def _implant(box: Tensor) -> VolumeLayer:
    centre = box.double().mean(dim=0)
    ring = shapes.torus(42.0, 11.0, 96)
    scene = Scene(meshes=(Mesh(vertices=ring.vertices[:, [0, 2, 1]] + centre, faces=ring.faces.flip(1)),))
    surface = voxelize_scene(scene, make_grid(scene.bounds[None], 96))
    return surface_layer(surface, 0.35, color=(0.05, 0.35, 1.0))
