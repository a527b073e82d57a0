"""Scenes as GLB files: meshes, metallic-roughness materials with their textures, cameras and punctual lights.

Every object becomes a node of its own name, at its middle, so that float32 vertices keep their precision far from the
world's origin. What :func:`~torchrender.scene.files.gltf.read.read_gltf` makes of the file looks as the scene did.

Media, and whether lights are in candela and lux, go to the ``extras`` of the scene, where other programs pass them by.
glTF knows no rectangle lights, environments or ambient light: a :class:`LossWarning` names what is left out.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.errors import SceneFileError, TorchRenderWarning
from torchrender.images.files import write_atomically
from torchrender.scene.camera import Cameras
from torchrender.scene.files.gltf.media import FLAGS
from torchrender.scene.files.gltf.out.document import GlbDocument
from torchrender.scene.files.gltf.out.materials import MaterialWriter
from torchrender.scene.light import DirectionalLight, Light, PointLight, SpotLight
from torchrender.scene.medium import EXTRAS, medium_values
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene


class LossWarning(TorchRenderWarning):
    """Something of a scene that a file cannot hold; names it."""


def write_glb(path: str | Path, scene: Scene) -> None:
    """Write a scene to a ``.glb`` file, which appears whole or not at all.

    Raises:
        SceneFileError: another suffix, missing folder, no triangles, more than 4 GiB, or it cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise SceneFileError(path, f"scenes are written to .glb, not {path.suffix or 'a file without suffix'}")
    data = glb_bytes(scene, path)
    write_atomically(path, lambda temporary: _store(temporary, data))


def _store(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def glb_bytes(scene: Scene, name: str | Path = "scene.glb") -> bytes:
    """The content of a GLB file with the scene; ``name`` is for messages.

    Raises:
        SceneFileError: no triangles, or more than 4 GiB.
    """
    if not any(len(m.faces) for m in scene.meshes):
        raise SceneFileError(name, "the scene holds no triangles to write")
    out = _Writer(scene.name)
    _warn_losses(scene, out.materials(scene))
    out.objects(scene)
    for title, camera in scene.cameras.items():
        out.camera(title, camera)
    for light in scene.lights:
        out.light(light)
    out.extras(scene)
    return out.content(name)


def _warn_losses(scene: Scene, of_materials: list[str]) -> None:
    lost = [f"{type(x).__name__} {x.name!r}" for x in scene.lights if not isinstance(x, _PUNCTUAL)]
    if scene.environment is not None:
        lost.append(f"environment {scene.environment.name!r}")
    if bool((scene.ambient > 0).any()):
        lost.append("ambient light")
    lost += [f"the off-centre picture of camera {n!r}" for n, c in scene.cameras.items() if off_centre(c)]
    if scene.motions:
        lost.append("animations, skins and morph targets (the present pose is written)")
    lost += of_materials
    if lost:
        warnings.warn(f"GLB files are written without {', '.join(lost)}", LossWarning, stacklevel=4)


def off_centre(camera: Cameras) -> bool:
    """Whether a camera does not look through the middle of its picture, or has pixels that are not square."""
    k = camera.intrinsics[0]
    middle = torch.tensor([camera.width / 2, camera.height / 2], dtype=torch.float64)
    return bool(((k[:2, 2] - middle).abs() > 1e-6 * camera.height).any() or abs(k[0, 0] / k[1, 1] - 1) > 1e-9)


_MOST_NAMED = 8
"""Materials that a warning names for each thing that they lose."""
_PUNCTUAL = (PointLight, SpotLight, DirectionalLight)


class _Writer(GlbDocument):
    """What scenes hold, as entries of the document."""

    def __init__(self, name: str) -> None:
        super().__init__(name)

    def materials(self, scene: Scene) -> list[str]:
        """All materials, used or not: meshes name them by number. What they lose, in words."""
        writer = MaterialWriter(self)
        for material in scene.materials:
            self.add("materials", writer.entry(material))
        return [f"{what} of {_listed(list(names))}" for what, names in writer.lost.items()]

    # ---------------------------------------------------------------- meshes

    def objects(self, scene: Scene) -> None:
        """A node for each object; its meshes are the primitives."""
        groups: dict[int, list[Mesh]] = {}
        for number, mesh in enumerate(scene.meshes):
            if len(mesh.faces):
                groups.setdefault(number if mesh.object_id is None else mesh.object_id, []).append(mesh)
        for meshes in groups.values():
            corners = torch.cat([m.vertices.double() for m in meshes])
            middle = (corners.amin(dim=0) + corners.amax(dim=0)) / 2
            name = _shared_name(meshes)
            primitives = [self._primitive(m, middle) for m in meshes]
            mesh_index = self.add("meshes", {"name": name, "primitives": primitives})
            self.node({"name": name, "mesh": mesh_index, "translation": middle.tolist()})

    def _primitive(self, mesh: Mesh, middle: Tensor) -> dict[str, Any]:
        vertices, faces, normals = (mesh.vertices.double() - middle).numpy(), mesh.faces.numpy(), mesh.normals
        rows: np.ndarray | None = None
        if normals is None or bool((normals.norm(dim=1) < 0.5).any()):
            # Corners of their own for every face: files without normals are shaded smooth by some, flat by others.
            rows = faces.reshape(-1)
            own = _corner_normals(mesh, rows)
            vertices, faces = vertices[rows], np.arange(len(rows)).reshape(-1, 3)
        else:
            own = torch.nn.functional.normalize(normals.double(), dim=1).numpy()
        attributes = {
            "POSITION": self.accessor(vertices, "VEC3", limits=True),
            "NORMAL": self.accessor(own, "VEC3"),
        }
        if mesh.uv is not None:
            uv = mesh.uv.numpy() if rows is None else mesh.uv.numpy()[rows]
            attributes["TEXCOORD_0"] = self.accessor(np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1), "VEC2")
        if mesh.uv1 is not None:
            uv = mesh.uv1.numpy() if rows is None else mesh.uv1.numpy()[rows]
            attributes["TEXCOORD_1"] = self.accessor(np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1), "VEC2")
        if mesh.tangents is not None and bool((mesh.tangents.norm(dim=1) > 0.5).all()):
            tangents = mesh.tangents.numpy() if rows is None else mesh.tangents.numpy()[rows]
            attributes["TANGENT"] = self.accessor(tangents, "VEC4")
        colors = _vertex_colors(mesh)
        if colors is not None:
            colors = colors if rows is None else colors[rows]
            attributes["COLOR_0"] = self.accessor(colors, f"VEC{colors.shape[1]}")
        indices = self.accessor(faces.reshape(-1).astype(np.uint32), "SCALAR")
        return {"attributes": attributes, "indices": indices, "material": mesh.material, "mode": 4}

    # ---------------------------------------------------- cameras and lights

    def camera(self, name: str, camera: Cameras) -> None:
        """The first of a batch of cameras, with square pixels and its centre in the middle, as glTF knows them."""
        fx, fy = float(camera.intrinsics[0, 0, 0]), float(camera.intrinsics[0, 1, 1])
        lens: dict[str, Any] = {"znear": float(camera.near[0])}
        if math.isfinite(float(camera.far[0])):
            lens["zfar"] = float(camera.far[0])
        if camera.orthographic:
            lens |= {"xmag": camera.width / 2 / fx, "ymag": camera.height / 2 / fy}
            entry = {"type": "orthographic", "orthographic": lens}
        else:
            lens |= {"yfov": 2 * math.atan2(camera.height / 2, fy), "aspectRatio": camera.width / camera.height}
            entry = {"type": "perspective", "perspective": lens}
        index = self.add("cameras", entry)
        matrix = camera.world_from_camera[0].clone()
        matrix[:3, 1:3] *= -1.0
        self.node({"name": name, "camera": index, "matrix": matrix.T.reshape(-1).tolist()})

    def extras(self, scene: Scene) -> None:
        """Boxes of smoke and fog, and how light is meant, in the extras of the scene."""
        extras: dict[str, Any] = {name: True for name in FLAGS if getattr(scene, name)}
        if scene.media:
            extras[EXTRAS] = [medium_values(m) for m in scene.media]
        if extras:
            self.json["scenes"][0]["extras"] = extras

    def light(self, light: Light) -> None:
        """A punctual light at a node of its own; others are named in the warning."""
        if not isinstance(light, _PUNCTUAL):
            return
        color = light.irradiance if isinstance(light, DirectionalLight) else light.intensity
        strength = float(color.max())
        entry: dict[str, Any] = {
            "name": light.name,
            "color": _plain(color / strength if strength > 0 else color),
            "intensity": strength,
        }
        node: dict[str, Any] = {"name": light.name}
        if not isinstance(light, DirectionalLight):
            node["translation"] = light.position.double().tolist()
        if isinstance(light, PointLight):
            entry["type"] = "point"
        else:
            node["rotation"] = _turn_from_minus_z(light.direction.double().numpy())
            entry["type"] = "directional"
        if not isinstance(light, DirectionalLight) and math.isfinite(light.range):
            entry["range"] = light.range
        if isinstance(light, SpotLight):
            entry["type"] = "spot"
            entry["spot"] = {
                "innerConeAngle": math.radians(light.inner_deg),
                "outerConeAngle": math.radians(light.outer_deg),
            }
        self.extensions.add("KHR_lights_punctual")
        lights = self.json.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(entry)
        node["extensions"] = {"KHR_lights_punctual": {"light": len(lights) - 1}}
        self.node(node)


def _listed(names: list[str]) -> str:
    more = [f"{len(names) - _MOST_NAMED} more"] if len(names) > _MOST_NAMED else []
    return ", ".join([*(repr(name) for name in names[:_MOST_NAMED]), *more])


def _vertex_colors(mesh: Mesh) -> np.ndarray | None:
    """(V,3) colours, or (V,4) with opacity."""
    if mesh.alpha is None:
        return None if mesh.colors is None else mesh.colors.numpy()
    colors = torch.ones(len(mesh.vertices), 3) if mesh.colors is None else mesh.colors
    return torch.cat([colors, mesh.alpha[:, None]], dim=1).numpy()


def _corner_normals(mesh: Mesh, rows: np.ndarray) -> np.ndarray:
    """(3F,3) normal of each corner of each face: its own where it has one, else that of the face."""
    corners = mesh.vertices.double()[mesh.faces]
    cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    scale = cross.abs().amax(dim=1, keepdim=True).clamp_min(1e-300)
    flat = torch.nn.functional.normalize(cross / scale, dim=1).repeat_interleave(3, dim=0)
    # A triangle without area has no normal; files must name one.
    flat[flat.norm(dim=1) < 0.5] = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    if mesh.normals is None:
        return flat.numpy()
    own = mesh.normals.double()[torch.from_numpy(rows)]
    length = own.norm(dim=1, keepdim=True)
    return torch.where(length >= 0.5, own / length.clamp_min(1e-12), flat).numpy()


def _turn_from_minus_z(direction: np.ndarray) -> list[float]:
    """Quaternion (x,y,z,w) that turns -z to a unit direction."""
    w = 1.0 - float(direction[2])
    if w < 1e-12:
        return [0.0, 1.0, 0.0, 0.0]
    axis = np.cross([0.0, 0.0, -1.0], direction)
    quaternion = np.array([*axis, w])
    return [float(v) for v in quaternion / np.linalg.norm(quaternion)]


def _shared_name(meshes: list[Mesh]) -> str:
    head = meshes[0].name.split("/")[0]
    shared = len(meshes) > 1 and all(m.name.split("/")[0] == head for m in meshes)
    return head if shared else meshes[0].name


def _plain(values: Tensor) -> list[float]:
    return [float(v) for v in values]
