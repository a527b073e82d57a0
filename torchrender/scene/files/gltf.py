"""glTF 2.0 scenes: meshes, materials, cameras and punctual lights with their node transforms.

Differences from the glTF specification, on purpose: primitives without normals are shaded smooth over edges below
``CREASE_DEG`` instead of flat, and alpha blending becomes a cutoff at one half.

Lights (KHR_lights_punctual): intensities are taken over as numbers, one candela as power per solid angle 1 and one lux
as irradiance 1, so that a light of 1 cd gives a facing wall one unit away irradiance 1. ``range`` is not used, and a
spot's falloff is that of :class:`~torchrender.scene.light.SpotLight`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.camera import MAX_SIDE, Cameras, pinhole_matrix
from torchrender.scene.files.gltf_file import Array, GltfFile
from torchrender.scene.files.gltf_mesh import GltfMeshes
from torchrender.scene.light import DirectionalLight, Light, PointLight, SpotLight
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

MAX_TRIANGLES = 50_000_000
"""A small file can place one mesh many times; more triangles than this are refused."""
CAMERA_HEIGHT = 720
"""Image height of cameras from glTF files, which say nothing about pixels; ``Scene.camera`` changes it."""
_LIGHTS = "KHR_lights_punctual"


def read_gltf(path: Path, data: bytes) -> Scene:
    """The default scene of a ``.glb`` or ``.gltf`` file. Every node that shows a mesh is one object.

    Raises:
        SceneFileError: damaged, cut off, not supported, too large, or without triangles.
        MeshError: vertices that are NaN or infinite; names the mesh.
    """
    file = GltfFile(path, data)
    placed = _nodes(file)
    reader = GltfMeshes(file)
    total = sum(reader.triangle_count(n["mesh"]) for _, n, _ in placed if "mesh" in n)
    if total > MAX_TRIANGLES:
        raise SceneFileError(path, f"declares {total} triangles, the limit is {MAX_TRIANGLES}")
    meshes: list[Mesh] = []
    lights: list[Light] = []
    cameras: dict[str, Cameras] = {}
    objects = 0
    for index, node, matrix in placed:
        name = str(node.get("name", f"node {index}"))
        try:
            if "mesh" in node:
                meshes += reader.placed(node["mesh"], matrix, name, objects)
                objects += 1
            if "camera" in node:
                cameras[_unused(name, cameras)] = _camera(file, node["camera"], matrix)
            used = _member(_member(node, "extensions"), _LIGHTS)
            if "light" in used:
                lights.append(_light(file, used["light"], matrix, name))
        except OverflowError as error:
            raise SceneFileError(path, f"a number is too large ({error})", key=f"nodes[{index}]") from error
    if not meshes:
        raise SceneFileError(path, "holds no triangles")
    return Scene(
        meshes=tuple(meshes), materials=tuple(reader.materials), lights=tuple(lights), cameras=cameras, name=path.stem
    )


def _nodes(file: GltfFile) -> list[tuple[int, dict[str, Any], Array]]:
    """Index, node and ``world_from_local`` of every node of the default scene, parents first."""
    if file.entries("scenes"):
        roots = file.item("scenes", file.json.get("scene", 0)).get("nodes", [])
    else:
        children = {c for n in file.entries("nodes") if isinstance(n, dict) for c in n.get("children", [])}
        roots = [k for k in range(len(file.entries("nodes"))) if k not in children]
    waiting = [(index, np.eye(4)) for index in reversed(roots)]
    seen: set[int] = set()
    found = []
    while waiting:
        index, parent = waiting.pop()
        node = file.item("nodes", index)
        if index in seen:
            raise SceneFileError(file.path, "is reached twice; nodes must form trees", key=f"nodes[{index}]")
        seen.add(index)
        matrix = parent @ _local_matrix(file, node, f"nodes[{index}]")
        found.append((index, node, matrix))
        waiting += [(child, matrix) for child in reversed(node.get("children", []))]
    return found


def _local_matrix(file: GltfFile, node: dict[str, Any], key: str) -> Array:
    """``parent_from_local`` (4,4): the node's matrix (stored by columns), or translation, rotation, scale."""
    if "matrix" in node:
        return file.numbers(node, "matrix", np.eye(4).reshape(-1).tolist(), key).reshape(4, 4).T
    matrix = np.eye(4)
    quaternion = file.numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0], key)
    scale = file.numbers(node, "scale", [1.0, 1.0, 1.0], key)
    matrix[:3, :3] = _rotation(quaternion) * scale
    matrix[:3, 3] = file.numbers(node, "translation", [0.0, 0.0, 0.0], key)
    return matrix


def _rotation(quaternion: Array) -> Array:
    """(3,3) of a quaternion (x, y, z, w); it is normalised, and zero means no rotation."""
    length = np.linalg.norm(quaternion)
    if not length > 0:
        return np.eye(3)
    x, y, z, w = quaternion / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _axes(file: GltfFile, matrix: Array, key: str) -> Array:
    """(3,3) orthonormal right-handed axes of a node as columns; scale and mirroring do not count for cameras."""
    z = matrix[:3, 2]
    x = np.cross(matrix[:3, 1], z)
    lengths = np.linalg.norm(z), np.linalg.norm(x)
    if not min(lengths) > 0 or not np.isfinite(lengths).all():
        raise SceneFileError(file.path, "its node has no orientation: the transform is singular", key=key)
    z, x = z / lengths[0], x / lengths[1]
    return np.stack([x, np.cross(z, x), z], axis=1)


def _camera(file: GltfFile, index: object, matrix: Array) -> Cameras:
    entry, key = file.item("cameras", index), f"cameras[{index}]"
    axes = _axes(file, matrix, key)
    # glTF cameras look along -z with y up, ours along z with y down.
    rotation = (axes * np.array([1.0, -1.0, -1.0])).T
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ matrix[:3, 3]
    kind = entry.get("type")
    if kind not in ("perspective", "orthographic"):
        raise SceneFileError(file.path, f"unknown camera type {kind!r}", key=key)
    lens, key = _member(entry, str(kind)), f"{key}.{kind}"
    height = CAMERA_HEIGHT
    near = file.number(lens, "znear", 0.01, key)
    if kind == "perspective":
        half = math.tan(_inside(file, file.number(lens, "yfov", 0.8, key), 1e-3, math.pi - 1e-3, f"{key}.yfov") / 2)
        aspect = file.number(lens, "aspectRatio", 16 / 9, key)
        far = file.number(lens, "zfar", math.inf, key) if "zfar" in lens else math.inf
        focal = [0.5 * height / half] * 2
    else:
        size = [_inside(file, abs(file.number(lens, n, 1.0, key)), 1e-9, 1e9, f"{key}.{n}") for n in ("xmag", "ymag")]
        aspect, far = size[0] / size[1], file.number(lens, "zfar", 100.0, key)
        focal = [0.5 * height / size[1]] * 2
    width = min(max(round(height * _inside(file, aspect, 1e-3, 1e3, f"{key}.aspectRatio")), 1), MAX_SIDE)
    k = pinhole_matrix(focal[0], focal[1], width / 2, height / 2)[None]
    low, high = (torch.tensor(v, dtype=torch.float64) for v in (near, far))
    try:
        return Cameras(torch.from_numpy(pose)[None], k, width, height, low, high, orthographic=kind == "orthographic")
    except InputError as error:
        raise SceneFileError(file.path, str(error), key=key) from error


def _light(file: GltfFile, index: object, matrix: Array, name: str) -> Light:
    lights = _member(_member(file.json, "extensions"), _LIGHTS).get("lights", [])
    key = f"extensions.{_LIGHTS}.lights[{index}]"
    if not isinstance(lights, list) or not isinstance(index, int) or not 0 <= index < len(lights):
        raise SceneFileError(file.path, "there is no such light", key=key)
    entry = lights[index]
    color = file.numbers(entry, "color", [1.0, 1.0, 1.0], key) * file.number(entry, "intensity", 1.0, key)
    if (color < 0).any():
        raise SceneFileError(file.path, "color and intensity must not be negative", key=key)
    intensity = torch.from_numpy(color)
    position = torch.from_numpy(matrix[:3, 3].copy())
    kind, name = entry.get("type"), str(entry.get("name", name))
    if kind == "point":
        return PointLight(position=position, intensity=intensity, name=name)
    direction = torch.from_numpy(-_axes(file, matrix, key)[:, 2].copy())
    if kind == "directional":
        return DirectionalLight(direction=direction, irradiance=intensity, name=name)
    if kind != "spot":
        raise SceneFileError(file.path, f"unknown light type {kind!r}", key=key)
    cone = _member(entry, "spot")
    outer = math.degrees(file.number(cone, "outerConeAngle", math.pi / 4, key))
    inner = math.degrees(file.number(cone, "innerConeAngle", 0.0, key))
    outer = min(max(_inside(file, outer, 0.0, 90.0, f"{key}.spot.outerConeAngle"), 0.1), 89.0)
    return SpotLight(
        position=position,
        direction=direction,
        intensity=intensity,
        inner_deg=min(max(inner, 0.0), outer),
        outer_deg=outer,
        name=name,
    )


def _inside(file: GltfFile, value: float, low: float, high: float, key: str) -> float:
    if not low <= value <= high:
        raise SceneFileError(file.path, f"must be in [{low:g}, {high:g}], got {value:g}", key=key)
    return value


def _member(holder: Any, name: str) -> dict[str, Any]:
    value = holder.get(name) if isinstance(holder, dict) else None
    return value if isinstance(value, dict) else {}


def _unused(name: str, taken: dict[str, Cameras]) -> str:
    """The name, with a number if it is taken already."""
    return next(n for n in (name, *(f"{name}.{k}" for k in range(1, len(taken) + 2))) if n not in taken)
