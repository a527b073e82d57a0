"""Closed metal objects on a floor under a sky: what they mirror, every way against rays."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import ReflectionLayer, ReflectionState
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.effects.reflections.traced import TraceOptions
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.metrics import flip_map
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, quad, torus

MODELS = ("suzanne.obj", "armadillo.ply", "stanford_dragon_res2.ply")
ROUGHNESS = {"chrome": 0.0, "rough metal": 0.4}
WAYS = {
    "auto": RenderOptions(),
    "traced": RenderOptions(reflections="traced"),
    "hybrid": RenderOptions(reflections="clustered", reflection=ClusterOptions(missing="trace")),
    "clustered": RenderOptions(reflections="clustered"),
    "environment": RenderOptions(reflections="environment"),
}
MANY = TraceOptions(glossy_rays=64, share_rays=False, bounces=8)
"""Of the reference: rays enough for rough metal, each pixel's its own, and metal in metal as often as it shows."""


def metal_objects(size: int, models: bool = True) -> list[dict[str, Any]]:
    """FLIP of each way against many rays, over the pixels that mirror, for each object and finish."""
    rows = []
    for name, mesh in objects(models):
        for finish, roughness in ROUGHNESS.items():
            scene, camera = metal_scene(mesh, roughness), metal_view(mesh, size)
            traced = RenderOptions(reflections="traced", tracing=MANY, buffers=("reflections",))
            reference = render(scene, camera, options=traced)
            layer = reference.buffers["reflections"]
            assert isinstance(layer, ReflectionLayer)
            mirrors = layer.state[0] != ReflectionState.NONE
            row: dict[str, Any] = {"object": name, "finish": finish, "triangles": scene.geometry.triangle_count}
            for way, options in WAYS.items():
                made = render(scene, camera, options=options)
                error = flip_map(made.displayed().float(), reference.displayed().float())[0]
                row[way] = float(error[mirrors].mean())
            rows.append(row)
    return rows


def objects(models: bool = True) -> Iterator[tuple[str, Mesh]]:
    """A box, a ring, and the models that are found, if they are wanted."""
    yield "box", box(torch.ones(3))
    yield "ring", torus(0.5, 0.2, 48)
    folder = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data")) / "meshes"
    for name in MODELS if models else ():
        if (folder / name).is_file():
            meshes = load(folder / name).meshes
            yield name.split(".")[0].replace("_", " "), max(meshes, key=lambda mesh: len(mesh.faces))


def metal_scene(mesh: Mesh, roughness: float) -> Scene:
    """A mesh of metal on a floor of checks, under a sky with a lamp in it."""
    low, high = _bounds(mesh)
    reach = 2.0 * float((high - low).norm())
    middle = (low + high) / 2
    corner = torch.stack([middle[0] - reach, low[1] - 0.01 * reach, middle[2] + reach])
    floor = quad(corner, torch.tensor([2 * reach, 0.0, 0.0]), torch.tensor([0.0, 0.0, -2 * reach]))
    board = ((torch.arange(16)[:, None] + torch.arange(16)) % 2).float()[..., None] * 0.7 + 0.1
    metal = Material(
        specular=0.95, gloss=roughness, diffuse=torch.zeros(3), specular_color=torch.tensor([1.0, 0.9, 0.8])
    )
    tiles = Material(diffuse=torch.ones(3), diffuse_texture=board.expand(16, 16, 3).contiguous())
    sun = DirectionalLight(direction=torch.tensor([0.5, -1.0, -0.4]), irradiance=torch.full((3,), 1.5))
    return Scene(
        meshes=(replace(mesh, material=0), replace(floor, material=1)),
        materials=(metal, tiles),
        lights=(sun,),
        environment=_sky(),
    )


def metal_view(mesh: Mesh, size: int) -> Cameras:
    """From above, a diagonal away."""
    low, high = _bounds(mesh)
    middle, reach = (low + high) / 2, float((high - low).norm())
    eye = middle + reach * torch.tensor([0.5, 0.35, 1.0])
    return Cameras.look_at(eye, middle, width=size, height=size, fov_deg=45.0, near=1e-3 * reach)


def _bounds(mesh: Mesh) -> tuple[Tensor, Tensor]:
    return mesh.vertices.float().amin(0), mesh.vertices.float().amax(0)


def _sky() -> Environment:
    height, width = 128, 256
    down = torch.linspace(0.0, 1.0, height)[:, None, None]
    picture = torch.lerp(torch.tensor([0.3, 0.5, 1.0]), torch.tensor([0.9, 0.9, 0.95]), (2.0 * down).clamp(0.0, 1.0))
    picture = torch.where(down > 0.5, torch.tensor([0.25, 0.2, 0.15]), picture).expand(height, width, 3).clone()
    picture[20:30, 60:80] = 8.0
    picture[70:90, 150:170] = torch.tensor([1.0, 0.1, 0.1])
    return Environment(radiance=picture)
