"""TOML scene files: what is in the scene, where it stands, what it is made of, what lights it and who looks at it.

A file holds ``name``, ``ambient``, ``photo_light`` (true: colours are of photos, which no ambient shadow darkens again)
and any number of ``[[geometry]]``, ``[[material]]``, ``[[light]]``, ``[[medium]]`` and ``[[camera]]`` tables, and at
most one ``[environment]``. Every key is checked; entries count from zero in messages.
Colours are linear RGB (one number or three) or sRGB ``"#rrggbb"``. Paths are relative to the scene file. The keys of
each table are documented at the function that reads it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from torchrender.errors import SceneFileError
from torchrender.images.files import read_image, read_texture
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.record import MAX_SIDE
from torchrender.scene.environment import Environment, sky_of
from torchrender.scene.files.content import read_bytes
from torchrender.scene.files.scene_geometry import read_geometry
from torchrender.scene.files.toml_table import Table, parse_toml
from torchrender.scene.files.volume_file import read_volume
from torchrender.scene.light import (
    NARROWEST_DEG,
    SHORTEST_RANGE,
    WIDEST_DEG,
    DirectionalLight,
    Light,
    PointLight,
    RectLight,
    SpotLight,
    usual_inner_deg,
)
from torchrender.scene.material import PHYSICAL, Material
from torchrender.scene.medium import SCALES, Medium
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene


def load_scene_file(path: str | Path) -> Scene:
    """The scene that a TOML file describes. A file without geometry gives an empty scene.

    Raises:
        SceneFileError: the file, a key in it or a file it names cannot be used; says which and why.
    """
    path = Path(path)
    table = parse_toml(path, read_bytes(path))
    name = table.text("name", path.stem)
    textures: dict[Path, Tensor] = {}
    materials = [_material(t, textures) for t in table.tables("material")]
    rows = {m.name: k for k, m in enumerate(materials)}
    if len(rows) < len(materials):
        double = next(k for k, m in enumerate(materials) if rows[m.name] != k)
        raise table.error(f"material[{rows[materials[double].name]}].name", "is used twice")
    lights = tuple(_light(t) for t in table.tables("light"))
    cameras = _cameras(table.tables("camera"))
    media = tuple(_medium(t) for t in table.tables("medium"))
    environment = _environment(table.table("environment"))
    names = {"light": "lights", "camera": "cameras", "medium": "media"}
    defined = frozenset(names.get(k, k) for k in (*names, "environment", "ambient") if k in table)
    scene = Scene(
        materials=tuple(materials),
        lights=lights,
        cameras=cameras,
        media=media,
        environment=environment,
        ambient=table.color("ambient", torch.zeros(3)),
        photo_light=table.flag("photo_light", False),
        photometric=table.flag("photometric", False),
        name=name,
    )
    for entry in table.tables("geometry"):
        part, override = read_geometry(entry, rows, defined)
        scene = _joined(scene, part, override)
    table.finish()
    return scene if scene.materials else replace(scene, materials=(Material(name="default"),))


def _joined(scene: Scene, part: Scene, override: int | None) -> Scene:
    """Both scenes in one: materials and objects of ``part`` come behind those of ``scene``, which wins elsewhere."""
    offset = len(scene.materials)
    first = 1 + max((_object(k, m) for k, m in enumerate(scene.meshes)), default=-1)
    meshes = [
        replace(m, material=m.material + offset if override is None else override, object_id=first + _object(k, m))
        for k, m in enumerate(part.meshes)
    ]
    return replace(
        scene,
        meshes=(*scene.meshes, *meshes),
        materials=scene.materials if override is not None else (*scene.materials, *part.materials),
        lights=(*scene.lights, *part.lights),
        media=(*scene.media, *part.media),
        cameras={**scene.cameras, **{k: v for k, v in part.cameras.items() if k not in scene.cameras}},
        environment=scene.environment or part.environment,
        ambient=scene.ambient if bool((scene.ambient > 0).any()) else part.ambient,
        motions=(*scene.motions, *(m.shifted(len(scene.meshes), len(scene.lights)) for m in part.motions)),
        photometric=scene.photometric or (part.photometric and bool(part.lights)),
        report=scene.report + part.report,
    )


def _object(index: int, mesh: Mesh) -> int:
    return index if mesh.object_id is None else mesh.object_id


def _material(table: Table, textures: dict[Path, Tensor]) -> Material:
    """Keys as :class:`~torchrender.scene.material.Material`; ``texture`` names a picture, ``name`` is required.

    A key of metallic-roughness materials alone makes one, as ``metallic`` does, which is 0 where it is left out.
    """
    name = table.text("name")
    path = table.file("texture", None)
    if path is not None and path not in textures:
        textures[path] = _picture(table, "texture", path, read_texture)
    with table.reporting():
        material = Material(
            name=name,
            # A texture is shown as it is unless a colour is given.
            diffuse=table.color("diffuse", torch.full((3,), 0.8 if path is None else 1.0)),
            diffuse_texture=None if path is None else textures[path],
            specular=table.number("specular", 0.0, 0.0, 1.0),
            specular_color=table.color("specular_color", torch.ones(3)),
            gloss=table.number("gloss", 0.0, 0.0, 1.0),
            shininess=table.number("shininess", 32.0, 0.0, 1e6),
            emission=table.color("emission", torch.zeros(3)),
            alpha_cutoff=table.number("alpha_cutoff", None, 0.0, 1.0),
            opacity=table.number("opacity", 1.0, 0.0, 1.0),
            blend=table.flag("blend", False),
            double_sided=table.flag("double_sided", True),
            unlit=table.flag("unlit", False),
            metallic=table.number("metallic", 0.0 if any(key in table for key in PHYSICAL) else None, 0.0, 1.0),
            sheen_color=table.color("sheen_color", torch.zeros(3)),
            **{key: table.number(key, value) for key, value in PHYSICAL.items() if key != "sheen_color"},
        )
    table.finish()
    return material


def _picture(table: Table, key: str, path: Path, read: Callable[[Path], Tensor] = read_image) -> Tensor:
    try:
        return read(path)
    except SceneFileError as error:
        raise table.error(key, str(error)) from error


def _light(table: Table) -> Light:
    """``type`` is point, directional, spot or rect; keys as in :mod:`~torchrender.scene.light`.

    Directional and spot lights take ``target`` in place of ``direction``; a directional light with a target also
    takes the ``position`` it looks from.
    """
    kind = table.choice("type", tuple(_LIGHTS))
    name = table.text("name", kind)
    with table.reporting():
        light = _LIGHTS[kind](table, name)
    table.finish()
    return light


def _direction(table: Table, position: Tensor | None) -> Tensor:
    if ("target" in table) == ("direction" in table):
        raise table.error("", "needs either direction or target")
    if "direction" in table:
        key, direction = "direction", table.vector("direction")
    else:
        if position is None:
            position = table.vector("position")
        key, direction = "target", table.vector("target") - position
    if not direction.norm() > 0:
        raise table.error(key, "gives no direction: its length is zero")
    return direction


def _point(table: Table, name: str) -> Light:
    return PointLight(
        position=table.vector("position"),
        intensity=table.color("intensity", torch.ones(3)),
        name=name,
        range=table.number("range", math.inf, SHORTEST_RANGE),
    )


def _directional(table: Table, name: str) -> Light:
    irradiance = table.color("irradiance", torch.ones(3))
    return DirectionalLight(direction=_direction(table, None), irradiance=irradiance, name=name)


def _spot(table: Table, name: str) -> Light:
    position = table.vector("position")
    outer = table.number("outer_deg", 30.0, NARROWEST_DEG, WIDEST_DEG)
    return SpotLight(
        position=position,
        direction=_direction(table, position),
        intensity=table.color("intensity", torch.ones(3)),
        inner_deg=table.number("inner_deg", usual_inner_deg(outer), 0.0, outer),
        outer_deg=outer,
        name=name,
        range=table.number("range", math.inf, SHORTEST_RANGE),
    )


def _rect(table: Table, name: str) -> Light:
    return RectLight(
        corner=table.vector("corner"),
        edge_u=table.vector("edge_u"),
        edge_v=table.vector("edge_v"),
        radiance=table.color("radiance", torch.ones(3)),
        name=name,
    )


_LIGHTS: dict[str, Callable[[Table, str], Light]] = {
    "point": _point,
    "directional": _directional,
    "spot": _spot,
    "rect": _rect,
}


def _environment(table: Table | None) -> Environment | None:
    """``file`` (latitude-longitude picture) or ``color``; ``intensity``, ``rotation_deg``."""
    if table is None:
        return None
    if ("file" in table) == ("color" in table):
        raise table.error("", "needs either file or color")
    intensity, rotation = table.number("intensity", 1.0, 0.0), table.number("rotation_deg", 0.0)
    if "color" in table:
        radiance, name = table.color("color").reshape(1, 1, 3), "constant"
    else:
        path = table.file("file")
        radiance, name = sky_of(_picture(table, "file", path)), path.stem
    table.finish()
    with table.reporting():
        return Environment(radiance=radiance, intensity=intensity, rotation_deg=rotation, name=name)


def _medium(table: Table) -> Medium:
    """Keys as :class:`~torchrender.scene.medium.Medium`; ``density`` is a number, ``density_file`` a grid file whose
    values it multiplies.
    """
    density = table.number("density", 1.0, 0.0)
    path = table.file("density_file", None)
    if path is not None:
        try:
            density = read_volume(path) * density
        except SceneFileError as error:
            raise table.error("density_file", str(error)) from error
    with table.reporting():
        medium = Medium(
            low=table.vector("low"),
            high=table.vector("high"),
            absorption=table.color("absorption", torch.zeros(3)),
            scattering=table.color("scattering", torch.full((3,), 0.1)),
            emission=table.color("emission", torch.zeros(3)),
            asymmetry=table.number("asymmetry", 0.0, -0.99, 0.99),
            density=density,
            falloff=table.number("falloff", 0.0, 0.0),
            floor=table.number("floor", None),
            density_scales=table.choice("density_scales", SCALES, "both"),
            name=table.text("name", "medium"),
        )
    table.finish()
    return medium


def _cameras(tables: list[Table]) -> dict[str, Cameras]:
    """``eye``, ``target``; ``name``, ``up``, ``near``, ``far``, ``width``, ``height``, and either ``fov_deg``
    (vertical) or, for an orthographic camera, ``view_height`` in scene units. The first camera is the default.
    """
    cameras: dict[str, Cameras] = {}
    for k, table in enumerate(tables):
        name = table.text("name", f"camera {k}")
        if name in cameras:
            raise table.error("name", f"{name!r} is used twice")
        cameras[name] = _camera(table)
        table.finish()
    return cameras


def _camera(table: Table) -> Cameras:
    eye, target = table.vector("eye"), table.vector("target")
    up = table.vector("up", 3, torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64))
    width, height = table.integer("width", 1280, 1, MAX_SIDE), table.integer("height", 720, 1, MAX_SIDE)
    flat = "view_height" in table
    if flat and "fov_deg" in table:
        raise table.error("fov_deg", "does not go with view_height: the camera is orthographic")
    near, far = table.number("near", 0.01), table.number("far", 1e6 if flat else math.inf)
    with table.reporting():
        if not flat:
            fov = table.number("fov_deg", 50.0, 0.01, 179.0)
            return Cameras.look_at(eye, target, width=width, height=height, fov_deg=fov, up=up, near=near, far=far)
        tall = table.number("view_height", low=1e-12)
        return Cameras.orthographic_view(
            eye, target, width=width, height=height, view_height=tall, up=up, near=near, far=far
        )
