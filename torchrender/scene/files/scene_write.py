"""Scenes as files: GLB alone, or TOML for what GLB cannot hold, with the meshes in a GLB file beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_class
from torchrender.errors import SceneFileError
from torchrender.images.files import write_atomically, write_image
from torchrender.scene.camera import Cameras
from torchrender.scene.files.beside import Beside
from torchrender.scene.files.gltf.out.write import glb_bytes, write_glb
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.medium import Medium
from torchrender.scene.model import Scene

SUFFIXES = (".glb", ".toml")


def write_scene(path: str | Path, scene: Scene) -> list[Path]:
    """Write a scene that :func:`~torchrender.scene.load.load` reads back; returns the files, the named one first.

    ``.glb`` holds meshes, materials, textures, cameras, punctual lights and media. ``.toml`` holds lights of every
    kind, cameras, environment, ambient light and media, and names the files beside it: the meshes (GLB), the
    environment (EXR), grids of densities (NPY). Every file appears whole or not at all, the scene file last. What
    stands beside it is written over only if an earlier call for the same scene file made it: else names are numbered.

    Raises:
        SceneFileError: another suffix, missing folder, no triangles, or a file that cannot be written.
    """
    check_class("path", path, str, Path)
    check_class("scene", scene, Scene)
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneFileError(path, f"the output must be {', '.join(SUFFIXES)}, not {suffix or 'without suffix'}")
    if suffix == ".glb":
        write_glb(path, scene)
        return [path]
    if not path.parent.is_dir():
        raise SceneFileError(path, f"folder {path.parent} does not exist")
    bare = replace(scene, lights=(), cameras={}, environment=None, ambient=torch.zeros(3), media=(), photo_light=False)
    beside = Beside(path)
    body = beside.place(".glb")
    data = glb_bytes(bare, body)
    write_atomically(body, _bytes(data))
    tables: list[tuple[str, dict[str, object]]] = [("geometry", {"file": body.name})]
    tables += [("light", _light(light)) for light in scene.lights]
    tables += [("camera", _camera(name, camera)) for name, camera in scene.cameras.items()]
    for number, medium in enumerate(scene.media):
        table = _medium(medium)
        if isinstance(medium.density, Tensor):
            grid = beside.place(f"_density{number}.npy")
            write_atomically(grid, _array(medium.density.float().numpy()))
            table |= {"density_file": grid.name}
        tables.append(("medium", table))
    lines = [f"name = {_text(scene.name)}", f"ambient = {_value(scene.ambient)}"]
    lines += [f"{key} = true" for key in ("photo_light", "photometric") if getattr(scene, key)]
    lines += [""]
    if scene.environment is not None:
        sky = beside.place("_environment.exr")
        write_image(sky, scene.environment.radiance)
        own: dict[str, object] = {
            "file": sky.name,
            "intensity": scene.environment.intensity,
            "rotation_deg": scene.environment.rotation_deg,
        }
        lines += ["[environment]", *_entries(own), ""]
    for name, table in tables:
        lines += [f"[[{name}]]", *_entries(table), ""]
    write_atomically(path, _bytes("\n".join([*beside.lines(), *lines]).encode()))
    return [path, *beside.files]


def _bytes(data: bytes) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_bytes(data)

    return write


def _array(values: np.ndarray) -> Callable[[Path], None]:
    return lambda path: np.save(path, values)


def _light(light: Light) -> dict[str, object]:
    if isinstance(light, RectLight):
        return {
            "type": "rect", "name": light.name, "corner": light.corner, "edge_u": light.edge_u,
            "edge_v": light.edge_v, "radiance": light.radiance,
        }  # fmt: skip
    if isinstance(light, DirectionalLight):
        return {
            "type": "directional",
            "name": light.name,
            "direction": light.direction,
            "irradiance": light.irradiance,
        }
    out: dict[str, object] = {"type": "point", "name": light.name, "position": light.position}
    out["intensity"] = light.intensity
    assert not isinstance(light, RectLight | DirectionalLight)
    if math.isfinite(light.range):
        out["range"] = light.range
    if isinstance(light, SpotLight):
        out |= {"type": "spot", "direction": light.direction}
        out |= {"inner_deg": light.inner_deg, "outer_deg": light.outer_deg}
    else:
        assert isinstance(light, PointLight)
    return out


def _camera(name: str, camera: Cameras) -> dict[str, object]:
    """The first of a batch."""
    pose = camera.world_from_camera[0]
    eye = pose[:3, 3]
    out: dict[str, object] = {
        "name": name, "eye": eye, "target": eye + pose[:3, 2], "up": -pose[:3, 1],
        "near": float(camera.near[0]), "width": camera.width, "height": camera.height,
    }  # fmt: skip
    if math.isfinite(float(camera.far[0])):
        out["far"] = float(camera.far[0])
    focal = float(camera.intrinsics[0, 1, 1])
    if camera.orthographic:
        return out | {"view_height": camera.height / focal}
    return out | {"fov_deg": math.degrees(2 * math.atan2(camera.height / 2, focal))}


def _medium(medium: Medium) -> dict[str, object]:
    out: dict[str, object] = {
        "name": medium.name, "low": medium.low, "high": medium.high, "absorption": medium.absorption,
        "scattering": medium.scattering, "emission": medium.emission, "asymmetry": medium.asymmetry,
        "density_scales": medium.density_scales,
    }  # fmt: skip
    if medium.falloff:
        out["falloff"] = medium.falloff
    if medium.floor is not None:
        out["floor"] = medium.floor
    return out if isinstance(medium.density, Tensor) else out | {"density": float(medium.density)}


def _entries(table: dict[str, object]) -> Iterable[str]:
    return [f"{key} = {_value(value)}" for key, value in table.items()]


def _value(value: object) -> str:
    if isinstance(value, Tensor):
        return "[" + ", ".join(repr(float(v)) for v in value) + "]"
    if isinstance(value, str):
        return _text(value)
    return repr(float(value)) if isinstance(value, float) else str(value)


def _text(value: str) -> str:
    """A TOML string: JSON's rules, and DEL is escaped, too."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
