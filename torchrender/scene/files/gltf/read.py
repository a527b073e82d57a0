"""glTF 2.0 scenes: meshes, materials, cameras, lights, and how they move.

Differences from the glTF specification, on purpose: primitives without normals are shaded smooth over edges below
``CREASE_DEG`` instead of flat, and primitives without a material are grey and matt.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.camera import Cameras
from torchrender.scene.files.choice import PLAIN_CHOICE, FileChoice
from torchrender.scene.files.gltf.animations import GltfMotion
from torchrender.scene.files.gltf.container import GltfFile, object_of
from torchrender.scene.files.gltf.extensions import unused_extensions
from torchrender.scene.files.gltf.lenses import LIGHTS, read_camera, read_light
from torchrender.scene.files.gltf.media import read_flags, read_media
from torchrender.scene.files.gltf.meshes import GltfMeshes, surface_count
from torchrender.scene.files.gltf.nodes import chosen_scene, instance_count, instances, read_nodes
from torchrender.scene.light import Light
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.motion.attach import camera_at, light_at
from torchrender.scene.motion.pose import posed
from torchrender.scene.motion.records import Animation, Array, Motion, Nodes, Part

MAX_TRIANGLES = 50_000_000
"""A small file can place one mesh many times; more triangles than this are refused."""
GENERATOR = "torchrender"
"""Files that this package wrote: their lights are plain numbers, not candela and lux, where they do not say so."""

_SHOWN = ("mesh", "camera", "extensions")


def read_gltf(path: Path, data: bytes, choice: FileChoice = PLAIN_CHOICE) -> Scene:
    """A scene of a ``.glb`` or ``.gltf`` file. Every node that shows a mesh is one object.

    Raises:
        SceneFileError: damaged, cut off, not supported, too large, or without triangles.
        MeshError: vertices that are NaN or infinite; names the mesh.
        InputError: an animation, variant or scene that the file does not have.
    """
    file = GltfFile(path, data)
    roots, number = chosen_scene(file, choice.subscene)
    nodes, order = read_nodes(file, roots)
    total = triangle_total(file, order)
    if total > MAX_TRIANGLES:
        raise SceneFileError(path, f"declares {total} triangles, the limit is {MAX_TRIANGLES}")
    moving = GltfMotion(file)
    motion = Motion(nodes=nodes, skins=tuple(moving.skins()), animations=tuple(moving.animations()))
    motion = motion.choosing(choice.animation)
    animation = motion.animation(None)
    if choice.time is not None and animation is None:
        file.notes.not_used("time: the file has no animation")
    elif choice.time is not None and animation is not None and (told := animation.beyond(choice.time)):
        file.notes.not_used(told)
    # Who names an animation wants to see it, be it at its start.
    time = 0.0 if choice.time is None and choice.animation is not None else choice.time
    worlds, weights = posed(nodes, animation, time, motion.root)
    draft = _Draft(file, replace(motion, worlds=worlds, weights=weights), choice)
    entries = file.entries("nodes")
    draft.begin([m for m in (entries[index].get("mesh") for index in order) if isinstance(m, int)])
    for index in order:
        if not entries[index].keys().isdisjoint(_SHOWN):
            draft.node(index)
    return draft.scene(read_media(file, number), read_flags(file, number))


def triangle_total(file: GltfFile, order: list[int]) -> int:
    """Triangles that the nodes of these numbers show, from their accessors' counts alone."""
    counts: dict[Any, int] = {}
    total = 0
    entries = file.entries("nodes")
    for index in order:
        node = entries[index]
        if "mesh" in node:
            mesh = node["mesh"]
            if not isinstance(mesh, int) or mesh not in counts:
                counts[mesh] = surface_count(file, mesh)
            total += counts[mesh] * instance_count(file, node)
    return total


class _Draft:
    """A scene in the making."""

    def __init__(self, file: GltfFile, motion: Motion, choice: FileChoice) -> None:
        self._file, self._motion, self._choice = file, motion, choice
        self._reader = GltfMeshes(file, choice)
        self._moved = _moved_nodes(motion.nodes, motion.animations)
        self._meshes: list[Mesh] = []
        self._parts: list[Part] = []
        self._lights: list[Light] = []
        self._hung_lights: list[tuple[int, int, Light]] = []
        self._cameras: dict[str, Cameras] = {}
        self._hung_cameras: list[tuple[str, int, Cameras]] = []
        self._objects = 0

    def begin(self, meshes: list[int]) -> None:
        """What takes long and can be done side by side: pictures."""
        self._reader.begin(meshes)

    def node(self, index: int) -> None:
        """Everything that hangs on one node."""
        node, key = self._file.item("nodes", index), f"nodes[{index}]"
        name = str(node.get("name", f"node {index}"))
        world = self._world(index)
        try:
            if "mesh" in node:
                self._mesh(node, index, name, key)
            if "camera" in node:
                camera = read_camera(self._file, node["camera"])
                title = _unused(name, self._cameras)
                self._cameras[title] = camera_at(camera, world)
                self._hung_cameras.append((title, index, camera))
            used = object_of(object_of(node.get("extensions")).get(LIGHTS))
            if "light" in used:
                light = read_light(self._file, used["light"], name)
                self._hung_lights.append((len(self._lights), index, light))
                self._lights.append(light_at(light, world))
        except OverflowError as error:
            raise SceneFileError(self._file.path, f"a number is too large ({error})", key=key) from error
        except InputError as error:
            if type(error) is InputError and "orientation" in str(error):
                raise SceneFileError(self._file.path, str(error), key=key) from error
            raise

    def _world(self, index: int) -> Array:
        assert self._motion.worlds is not None
        world: Array = self._motion.worlds[index]
        return world

    def _mesh(self, node: dict[str, Any], index: int, name: str, key: str) -> None:
        skin = node.get("skin")
        if skin is not None:
            self._file.item("skins", skin)
        copies = instances(self._file, node, key)
        for mesh, part in self._reader.placed(node["mesh"], name, self._objects, copies):
            joints = part.joints
            own = skin if joints is not None else None
            if joints is not None and own is not None and joints.max(initial=0) >= len(self._motion.skins[own].joints):
                reason = f"joints must be below {len(self._motion.skins[own].joints)}"
                raise SceneFileError(self._file.path, reason, key=f"meshes[{node['mesh']}]")
            moving = Part(len(self._meshes), index, part, own)
            self._meshes.append(mesh(moving, self._motion))
            if own is not None or part.target_positions is not None or self._moved[index]:
                self._parts.append(moving)
        self._objects += 1

    def scene(self, media: tuple[Medium, ...], flags: dict[str, bool]) -> Scene:
        """What all nodes gave, with the media between them and what the file says of its light."""
        file, notes = self._file, self._file.notes
        for name, count in unused_extensions(file.json).items():
            notes.not_used(name, count)
        points = self._reader.points
        if not self._meshes:
            raise SceneFileError(
                file.path, f"holds {points} points but no triangles" if points else "holds no triangles"
            )
        notes.not_used("points; load_points and the command points read them", points)
        self._say_what_was_read()
        notes.read("media", len(media))
        generator = str(object_of(file.json.get("asset")).get("generator", ""))
        motion = replace(
            self._motion,
            parts=tuple(self._parts),
            lights=tuple(h for h in self._hung_lights if self._moved[h[1]]),
            cameras=tuple(h for h in self._hung_cameras if self._moved[h[1]]),
        )
        moves = bool(motion.parts or motion.lights or motion.cameras)
        return Scene(
            meshes=tuple(self._meshes),
            materials=tuple(self._reader.materials),
            lights=tuple(self._lights),
            cameras=self._cameras,
            media=media,
            name=file.path.stem,
            motions=(motion,) if moves else (),
            photometric=bool(self._lights) and flags.get("photometric", not generator.startswith(GENERATOR)),
            photo_light=flags.get("photo_light", False),
            report=notes.close(),
        )

    def _say_what_was_read(self) -> None:
        notes = self._file.notes
        notes.read("meshes", len(self._meshes))
        notes.read("materials", len(self._reader.materials))
        notes.read("lights", len(self._lights))
        notes.read("cameras", len(self._cameras))
        notes.read("skins", len(self._motion.skins))
        for animation in self._motion.animations:
            notes.read(f"animation {animation.name!r}, {animation.duration:.3g} s")
        variants = self._reader.variants
        if variants:
            notes.read(f"variants {', '.join(variants)[:300]}", len(variants))


def _moved_nodes(nodes: Nodes, animations: tuple[Animation, ...]) -> Array:
    """(N,) bool nodes that some animation moves, itself or by what they hang on."""
    moved = np.zeros(len(nodes.parents) + 1, bool)
    moved[[c.node for a in animations for c in a.channels]] = True
    for up in nodes.ancestors:
        moved |= moved[up]
    return moved[:-1]


def _unused(name: str, taken: dict[str, Cameras]) -> str:
    """The name, with a number if it is taken already."""
    return next(n for n in (name, *(f"{name}.{k}" for k in range(1, len(taken) + 2))) if n not in taken)
