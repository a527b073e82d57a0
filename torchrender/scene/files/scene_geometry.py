"""The ``[[geometry]]`` tables of a scene file: mesh files, built-in scenes and simple shapes, put in their place."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.errors import InputError, SceneFileError
from torchrender.scene import shapes
from torchrender.scene.files.choice import FileChoice
from torchrender.scene.files.source import MAX_SIZE, build_procedural, load_mesh_file
from torchrender.scene.files.toml_table import Table
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.motion.records import Motion
from torchrender.scene.place import place_cameras, place_light, place_medium, place_mesh
from torchrender.scene.primitives.arrays import MAX_SEGMENTS

KEPT = ("lights", "cameras", "environment", "ambient", "media")
"""What a geometry's own scene may bring along besides its meshes."""


def read_geometry(table: Table, materials: Mapping[str, int], defined: frozenset[str]) -> tuple[Scene, int | None]:
    """The scene of one ``[[geometry]]`` table in world space, and the row of the material that overrides its own.

    Keys: one of ``file`` (mesh file, with ``time``, ``animation`` and ``variant``), ``procedural`` (with
    ``triangles``, ``seed``) or ``shape`` (with the arguments of its function in :mod:`~torchrender.scene.shapes`);
    ``name``; ``scale`` (one number or three), then ``rotate_deg`` (about x, then y, then z), then ``translate``;
    ``material``; ``keep``, a list out of ``KEPT``: without it everything stays that the scene file does not define
    itself (``defined``).

    Raises:
        SceneFileError: names the key; also for a mesh file that cannot be read.
    """
    kinds = [k for k in ("file", "procedural", "shape") if k in table]
    if len(kinds) != 1:
        given = " and ".join(kinds) or "none"
        raise table.error("", f"needs exactly one of file, procedural and shape, has {given}")
    scene = _SOURCES[kinds[0]](table)
    name = table.text("name", None)
    if name is not None:
        scene = replace(scene, meshes=tuple(replace(m, name=name) for m in scene.meshes))
    kept = table.words("keep", KEPT, [k for k in KEPT if k not in defined])
    matrix = _placement(table)
    override = table.text("material", None)
    if override is not None and override not in materials:
        known = ", ".join(materials) or "none"
        raise table.error("material", f"no material is named {override!r}; known: {known}")
    table.finish()
    return _placed(table, scene, matrix, kept), None if override is None else materials[override]


def _from_file(table: Table) -> Scene:
    path = table.file("file")
    time, animation = table.number("time", None), table.text("animation", None)
    variant = table.text("variant", None)
    try:
        with table.reporting("file"):
            return load_mesh_file(path, FileChoice(time=time, animation=animation, variant=variant))
    except SceneFileError as error:
        raise table.error("file", str(error)) from error


def _from_procedural(table: Table) -> Scene:
    name = table.text("procedural")
    triangles, seed = table.integer("triangles", None, 1, MAX_SIZE), table.integer("seed", 0, 0, 2**31 - 1)
    with table.reporting("procedural"):
        return build_procedural(name, triangles, seed)


def _from_shape(table: Table) -> Scene:
    name = table.choice("shape", tuple(_SHAPES))
    with table.reporting():
        mesh = _SHAPES[name](table)
    return Scene(meshes=(mesh,), name=name)


def _segments(table: Table, default: int = 64) -> int:
    return int(table.integer("segments", default, 1, MAX_SEGMENTS))


def _unit(size: int) -> Tensor:
    return torch.ones(size, dtype=torch.float64)


_SHAPES: dict[str, Callable[[Table], Mesh]] = {
    "box": lambda t: shapes.box(t.vector("size", 3, _unit(3), repeat=True)),
    "plane": lambda t: shapes.plane(
        t.vector("size", 2, _unit(2), repeat=True), _segments(t, 1), t.number("tiles", 1.0, 1e-6)
    ),
    "quad": lambda t: shapes.quad(t.vector("corner"), t.vector("edge_u"), t.vector("edge_v")),
    "sphere": lambda t: shapes.sphere(t.number("radius", 1.0), _segments(t)),
    "cylinder": lambda t: shapes.cylinder(t.number("radius", 1.0), t.number("height", 1.0), _segments(t)),
    "cone": lambda t: shapes.cone(t.number("radius", 1.0), t.number("height", 1.0), _segments(t)),
    "torus": lambda t: shapes.torus(t.number("radius", 1.0), t.number("tube", 0.3), _segments(t)),
}

_SOURCES: dict[str, Callable[[Table], Scene]] = {
    "file": _from_file,
    "procedural": _from_procedural,
    "shape": _from_shape,
}


def _placement(table: Table) -> Tensor | None:
    """``world_from_local`` (4,4) float64; None where the table does not move anything."""
    scale = table.vector("scale", 3, _unit(3), repeat=True)
    turn, shift = (table.vector(k, 3, torch.zeros(3, dtype=torch.float64)) for k in ("rotate_deg", "translate"))
    if not any(k in table for k in ("translate", "rotate_deg", "scale")):
        return None
    if bool((scale == 0).any()):
        raise table.error("scale", "must not be zero")
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = rotation_xyz(turn) * scale
    matrix[:3, 3] = shift
    return matrix


def rotation_xyz(degrees: Tensor) -> Tensor:
    """(3,3) float64 rotation about x, then y, then z, angles (3,) in degrees, counter-clockwise seen from the tip."""
    matrix = torch.eye(3, dtype=torch.float64)
    for axis, angle in enumerate(degrees.tolist()):
        turn = torch.eye(3, dtype=torch.float64)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = cosine, -sine, sine, cosine
        matrix = turn @ matrix
    return matrix


def _kept_motion(motion: Motion, kept: list[str]) -> Motion:
    """Without what hangs on its nodes but does not stay in the scene."""
    lights = motion.lights if "lights" in kept else ()
    return replace(motion, lights=lights, cameras=motion.cameras if "cameras" in kept else ())


def _placed(table: Table, scene: Scene, matrix: Tensor | None, kept: list[str]) -> Scene:
    """The scene after ``matrix``, without what is not kept. The environment is infinitely far and stays."""
    lights = scene.lights if "lights" in kept else ()
    cameras = dict(scene.cameras) if "cameras" in kept else {}
    media = scene.media if "media" in kept else ()
    meshes, motions = scene.meshes, tuple(_kept_motion(m, kept) for m in scene.motions)
    if matrix is not None:
        motions = tuple(replace(m, root=matrix.numpy() @ m.root, worlds=None) for m in motions)
        try:
            meshes = tuple(place_mesh(m, matrix) for m in meshes)
            lights = tuple(place_light(light, matrix) for light in lights)
            cameras = {name: place_cameras(c, matrix) for name, c in cameras.items()}
            media = tuple(place_medium(m, matrix) for m in media)
        except InputError as error:
            raise table.error("", f"{error}; see the key 'keep'") from error
    return replace(
        scene,
        meshes=meshes,
        lights=lights,
        cameras=cameras,
        media=media,
        motions=motions,
        photometric=scene.photometric and bool(lights),
        environment=scene.environment if "environment" in kept else None,
        ambient=scene.ambient if "ambient" in kept else torch.zeros(3),
    )
