"""Cameras and punctual lights of a glTF file, each in the frame of its node: it looks along -z.

Lights (KHR_lights_punctual): intensities are taken over as numbers, one candela as power per solid angle 1 and one lux
as irradiance 1, so that a light of 1 cd gives a facing wall one unit away irradiance 1. A spot's falloff is that of
:class:`~torchrender.scene.light.SpotLight`; the ``range`` of a light cuts it off as the extension says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.camera import Cameras, pinhole_matrix
from torchrender.scene.cameras.record import MAX_SIDE
from torchrender.scene.files.gltf.container import GltfFile, object_of
from torchrender.scene.light import (
    NARROWEST_DEG,
    SHORTEST_RANGE,
    WIDEST_DEG,
    DirectionalLight,
    Light,
    PointLight,
    SpotLight,
)

CAMERA_HEIGHT = 720
"""Image height of cameras from glTF files, which say nothing about pixels; ``Scene.camera`` changes it."""
LIGHTS = "KHR_lights_punctual"


def read_camera(file: GltfFile, index: object) -> Cameras:
    """Camera ``index`` at the origin.

    Raises:
        SceneFileError: a value of wrong type or out of range.
    """
    entry, key = file.item("cameras", index), f"cameras[{index}]"
    kind = entry.get("type")
    if kind not in ("perspective", "orthographic"):
        raise SceneFileError(file.path, f"unknown camera type {kind!r}", key=key)
    lens, key = object_of(entry.get(str(kind))), f"{key}.{kind}"
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
    pose = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0], dtype=torch.float64))[None]
    try:
        return Cameras(pose, k, width, height, low, high, orthographic=kind == "orthographic")
    except InputError as error:
        raise SceneFileError(file.path, str(error), key=key) from error


def read_light(file: GltfFile, index: object, name: str) -> Light:
    """Light ``index`` at the origin; ``name`` is its node's.

    Raises:
        SceneFileError: a value of wrong type or out of range.
    """
    lights = object_of(object_of(file.json.get("extensions")).get(LIGHTS)).get("lights", [])
    key = f"extensions.{LIGHTS}.lights[{index}]"
    if not isinstance(lights, list) or not isinstance(index, int) or not 0 <= index < len(lights):
        raise SceneFileError(file.path, "there is no such light", key=key)
    entry = object_of(lights[index])
    color = file.numbers(entry, "color", [1.0, 1.0, 1.0], key) * file.number(entry, "intensity", 1.0, key)
    if (color < 0).any():
        raise SceneFileError(file.path, "color and intensity must not be negative", key=key)
    kind, name = entry.get("type"), str(entry.get("name", name))
    values: dict[str, Any] = {"name": name}
    origin, ahead = torch.zeros(3, dtype=torch.float64), torch.tensor([0.0, 0.0, -1.0])
    try:
        if kind == "point":
            return PointLight(position=origin, intensity=torch.from_numpy(color), **_range(file, entry, key), **values)
        if kind == "directional":
            return DirectionalLight(direction=ahead, irradiance=torch.from_numpy(color), **values)
    except InputError as error:
        raise SceneFileError(file.path, str(error), key=key) from error
    if kind != "spot":
        raise SceneFileError(file.path, f"unknown light type {kind!r}", key=key)
    cone = object_of(entry.get("spot"))
    outer = math.degrees(file.number(cone, "outerConeAngle", math.pi / 4, key))
    inner = math.degrees(file.number(cone, "innerConeAngle", 0.0, key))
    outer = max(_inside(file, outer, 0.0, WIDEST_DEG, f"{key}.spot.outerConeAngle"), NARROWEST_DEG)
    return SpotLight(
        position=origin,
        direction=ahead,
        intensity=torch.from_numpy(color),
        inner_deg=min(max(inner, 0.0), outer),
        outer_deg=outer,
        **_range(file, entry, key),
        **values,
    )


def _range(file: GltfFile, entry: Mapping[str, Any], key: str) -> dict[str, float]:
    """The distance beyond which a light lights nothing, where it has one."""
    if "range" not in entry:
        return {}
    found = file.number(entry, "range", math.inf, key)
    if not found >= SHORTEST_RANGE:
        raise SceneFileError(file.path, f"must be greater than 0, got {found:g}", key=f"{key}.range")
    return {"range": found}


def _inside(file: GltfFile, value: float, low: float, high: float, key: str) -> float:
    if not low <= value <= high:
        raise SceneFileError(file.path, f"must be in [{low:g}, {high:g}], got {value:g}", key=key)
    return value
