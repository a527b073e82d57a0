"""Pictures of Mitsuba's own test suite, which come with their scenes: diffuse surfaces under small lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.images.files import read_image
from torchrender.pipeline.options import RenderOptions, shadow_choices
from torchrender.quality.metrics import psnr
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.load import load
from torchrender.scene.material import Material, Sampler
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import quad

FINER = 8
"""Of our pixels on each of theirs, a side."""
FILM = 2 * math.degrees(math.atan(math.hypot(36.0, 24.0) / 100.0 / math.sqrt(2.0)))
"""Opening angle of a square picture where a file names none: that of 50 mm before 35 mm film."""


@dataclass(frozen=True)
class Reference:
    """A scene and the picture that Mitsuba made of it."""

    name: str
    what: str
    picture: str  # below the folder of the references
    make: Callable[[Path, int], tuple[Scene, Cameras]]
    blurred: bool = False  # pixels are weighted by a Gaussian, not by their own square


def references(folder: Path) -> list[dict[str, Any]]:
    """Mean ratio and PSNR against the brightest pixel of every picture that is there."""
    rows = []
    for one in ALL:
        file = folder / "mitsuba_tests" / one.picture
        if not file.is_file():
            continue
        wanted = read_image(file)[..., :3]
        side = wanted.shape[0]
        scene, camera = one.make(folder, side * FINER)
        options = RenderOptions(reflections="off", background=(0.0, 0.0, 0.0), **shadow_choices("traced"))
        fine = render(scene, camera, options=options).radiance[0]
        found = _filtered(fine, side) if one.blurred else fine.reshape(side, FINER, side, FINER, 3).mean(dim=(1, 3))
        rows.append(
            {
                "name": one.name,
                "what": one.what,
                "ratio": float(found.mean() / wanted.mean()),
                "psnr": float(psnr(found[None], wanted[None], peak=float(wanted.max()))),
            }
        )
    return rows


def _filtered(fine: Tensor, side: int) -> Tensor:
    """Mitsuba's Gaussian of half a pixel's deviation, cut off at two pixels, minus its value there."""
    reach = 2 * FINER
    place = (torch.arange(-reach, reach) + 0.5) / FINER
    weight = ((-2.0 * place.square()).exp() - math.exp(-8.0)).clamp_min(0.0)

    def along(image: Tensor) -> Tensor:
        """Rows of (N,side*FINER,C) to (N,side,C)."""
        padded = torch.nn.functional.pad(image.permute(0, 2, 1), (reach - FINER // 2, reach - FINER // 2))
        inside = torch.nn.functional.pad(torch.ones(1, 1, image.shape[1]), (reach - FINER // 2, reach - FINER // 2))
        kernel = weight.reshape(1, 1, -1)
        rows = torch.nn.functional.conv1d(padded.reshape(-1, 1, padded.shape[-1]), kernel, stride=FINER)
        norm = torch.nn.functional.conv1d(inside, kernel, stride=FINER)
        return (rows / norm).reshape(len(image), -1, side).permute(0, 2, 1)

    down = along(fine)
    return along(down.permute(1, 0, 2)).permute(1, 0, 2)


def _floating_sphere(folder: Path, side: int) -> tuple[Scene, Cameras]:
    ground = quad(torch.tensor((-1.0, -1.0, 0.0)), torch.tensor((2.0, 0.0, 0.0)), torch.tensor((0.0, 2.0, 0.0)))
    ball = load(folder / "common" / "meshes" / "sphere.obj").meshes[0]
    ball = replace(ball, vertices=0.1 * ball.vertices.double() + torch.tensor((0.0, 0.0, 1.0)), material=0)
    sun = DirectionalLight(direction=torch.tensor((0.0, 0.0, -1.0)), irradiance=torch.ones(3))
    scene = Scene(meshes=(ground, ball), materials=(_matt(),), lights=(sun,))
    view = Cameras.look_at((0, -5, 1), (0, 0, 0.5), up=(0, 0, 1), fov_deg=FILM, width=side, height=side)
    return scene, view


def _matt(**more: Any) -> Material:
    return Material(diffuse=torch.ones(3), double_sided=False, **more)


def _vertex_colors(folder: Path, side: int) -> tuple[Scene, Cameras]:
    data = (folder / "mitsuba_tests" / "mesh_attributes" / "meshes" / "sphere_attribute.ply").read_bytes()
    data = data[data.index(b"end_header\n") + len(b"end_header\n") :]
    vertices = np.frombuffer(data, "<f4", 1192 * 11).reshape(-1, 11)
    faces = np.frombuffer(data, [("n", "u1"), ("v", "<i4", 3), ("more", "<f4", 4)], 528, offset=vertices.nbytes)
    mesh = Mesh(
        vertices=torch.from_numpy(vertices[:, :3].astype(np.float64)) + torch.tensor((0.0, 0.0, 1.0)),
        faces=torch.from_numpy(faces["v"].astype(np.int64)),
        normals=torch.from_numpy(vertices[:, 3:6].copy()),
        colors=torch.from_numpy(vertices[:, 8:11].copy()),
    )
    sun = DirectionalLight(direction=torch.tensor((0.0, 0.0, 1.0)), irradiance=torch.ones(3))
    view = Cameras.look_at((0, 0, -5), (0, 0, 0), fov_deg=FILM, width=side, height=side)
    return Scene(meshes=(mesh,), materials=(_matt(),), lights=(sun,)), view


def _textures(folder: Path, side: int) -> tuple[Scene, Cameras]:
    picture = read_image(folder / "common" / "textures" / "carrot.png")[..., :3].flip(0).contiguous()
    lay = torch.tensor([[2.0, 0.0, -0.5], [0.0, 2.0, -0.5]])
    meshes, materials = [], []
    for row, kind in ((-1.1, "bilinear"), (1.1, "nearest")):
        for column, wrap in ((-2.2, "repeat"), (0.0, "mirror"), (2.2, "clamp")):
            sampler = Sampler(transform=lay, wrap_u=wrap, wrap_v=wrap, filter=kind)
            materials.append(_matt(diffuse_texture=picture, samplers={"diffuse_texture": sampler}))
            corner = torch.tensor((column - 1.0, row - 1.0, 0.0))
            sheet = quad(corner, torch.tensor((2.0, 0.0, 0.0)), torch.tensor((0.0, 2.0, 0.0)))
            uv = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
            meshes.append(replace(sheet, uv=uv, material=len(materials) - 1))
    lamp = PointLight(position=torch.tensor((0.0, 0.0, 10.0)), intensity=torch.full((3,), 100.0))
    view = Cameras.look_at((0, 0, 8), (0, 0, 0), fov_deg=45.0, width=side, height=side)
    return Scene(meshes=tuple(meshes), materials=tuple(materials), lights=(lamp,)), view


ALL = (
    Reference(
        "floating sphere", "parallel light, a shadow", "floating_sphere/refs/test_directional_ref_rgb.exr",
        _floating_sphere,
    ),
    Reference(
        "mesh attributes", "colours of vertices", "mesh_attributes/refs/test_mesh_attributes_3_vertex_ref_rgb.exr",
        _vertex_colors,
    ),
    Reference(
        "texture interpolation", "wrap modes, bilinear and nearest, a point light",
        "texture_interp/refs/test_texture_interp_ref_rgb.exr", _textures, blurred=True,
    ),
)  # fmt: skip
NOT_COMPARED: Mapping[str, str] = {
    "spot light": "it projects a picture, and smooths its edge otherwise",
    "mesh attributes of faces": "colours of whole faces are no attribute of glTF",
    "participating media": "compared in scattering.md's terms",
    "orthographic sensor": "a constant surrounding on matt squares: a furnace test",
}
