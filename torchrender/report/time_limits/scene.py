"""A scene that every renderer understands: plain diffuse meshes as PLY files, lights and a camera as JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene


def plain_scene(scene: Scene) -> Scene:
    """The scene with one diffuse colour per mesh: no textures, no mirrors, nothing that shines but its lights."""
    materials = tuple(
        Material(name=f"{number}", diffuse=_mean_color(mesh, scene)) for number, mesh in enumerate(scene.meshes)
    )
    meshes = tuple(replace(m, uv=None, colors=None, material=number) for number, m in enumerate(scene.meshes))
    return replace(scene, meshes=meshes, materials=materials)


def _mean_color(mesh: Mesh, scene: Scene) -> Tensor:
    material = scene.materials[mesh.material]
    color = material.diffuse
    if material.diffuse_texture is not None:
        color = color * material.diffuse_texture[..., :3].mean(dim=(0, 1))
    if mesh.colors is not None:
        color = color * mesh.colors.mean(dim=0)
    return color.clamp(0.0, 1.0)


def export_scene(scene: Scene, camera: Cameras, folder: Path) -> None:
    """``scene.json`` and a PLY file per mesh of a plain scene seen by one centred perspective camera, in ``folder``."""
    meshes = []
    for number, mesh in enumerate(scene.meshes):
        if len(mesh.faces):
            write_ply(folder / f"{number}.ply", mesh)
            meshes.append({"file": f"{number}.ply", "color": scene.materials[mesh.material].diffuse.tolist()})
    record = {
        "meshes": meshes,
        "lights": [_light(light) for light in scene.lights],
        "surroundings": scene.ambient.tolist(),
        "size": [camera.width, camera.height],
        "world_from_camera": camera.world_from_camera[0].tolist(),
        "fov_deg": float(2 * torch.rad2deg(torch.atan(camera.height / 2 / camera.intrinsics[0, 1, 1]))),
    }
    (folder / "scene.json").write_text(json.dumps(record))


def write_ply(path: Path, mesh: Mesh) -> None:
    """Vertices and faces as binary PLY."""
    vertices = mesh.vertices.detach().numpy().astype("<f4")
    faces = np.zeros(len(mesh.faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, mesh.faces.numpy()
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())


def _light(light: Light) -> dict[str, Any]:
    if isinstance(light, RectLight):
        names: tuple[str, ...] = ("corner", "edge_u", "edge_v", "radiance")
        kind = "rectangle"
    elif isinstance(light, SpotLight):
        names, kind = ("position", "direction", "intensity"), "spot"
    elif isinstance(light, PointLight):
        names, kind = ("position", "intensity"), "point"
    else:
        names, kind = ("direction", "irradiance"), "directional"
    record: dict[str, Any] = {"kind": kind, **{name: getattr(light, name).tolist() for name in names}}
    if isinstance(light, SpotLight):
        record |= {"inner_deg": light.inner_deg, "outer_deg": light.outer_deg}
    return record
