"""glTF 2.0 meshes: primitives with their materials, read once and placed for every node."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.files.choice import PLAIN_CHOICE, FileChoice
from torchrender.scene.files.gltf.accessors import Accessors
from torchrender.scene.files.gltf.container import Array, GltfFile, object_of
from torchrender.scene.files.gltf.materials import GltfMaterials
from torchrender.scene.files.gltf.primitives import POINTS, SURFACES, TRIANGLES, Primitive, PrimitiveReader, taken
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.motion.deform import placed
from torchrender.scene.motion.records import Motion, Part, Shape
from torchrender.scene.place import place_arrays, place_tangents

VARIANTS = "KHR_materials_variants"

Maker = Callable[[Part, Motion], Mesh]
"""Makes the mesh of a part in the present state of a motion."""


def primitives_of(file: GltfFile, index: object) -> list[dict[str, Any]]:
    """The primitives of a mesh.

    Raises:
        SceneFileError: they are no array of objects.
    """
    entries = file.item("meshes", index).get("primitives")
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise SceneFileError(file.path, "must be an array of objects", key=f"meshes[{index}].primitives")
    return entries


def surface_count(file: GltfFile, index: object) -> int:
    """Triangles that mesh ``index`` declares, from its accessors' counts alone."""
    accessors, total = Accessors(file), 0
    for entry in primitives_of(file, index):
        position = object_of(entry.get("attributes")).get("POSITION")
        count = accessors.count(entry.get("indices", position))
        mode = entry.get("mode", TRIANGLES)
        if mode in SURFACES:
            total += count // 3 if mode == TRIANGLES else max(count - 2, 0)
    return total


class GltfMeshes:
    """Meshes and materials of one file; primitives that share data and texture coordinates are read once."""

    def __init__(self, file: GltfFile, choice: FileChoice = PLAIN_CHOICE) -> None:
        self._file = file
        self._pictures = GltfMaterials(file)
        self._reader = PrimitiveReader(file)
        self._primitives: dict[object, Primitive] = {}
        self._materials: dict[int | None, tuple[int, tuple[int, ...]]] = {}
        self.materials: list[Material] = []
        self.points = 0
        self.variants = _variant_names(file)
        self._variant = self._chosen(choice.variant)
        self._drop = choice.drop_invalid

    def begin(self, meshes: Iterable[int]) -> None:
        """Decode the pictures of the materials of meshes that will be placed."""
        used = [e.get("material") for m in dict.fromkeys(meshes) for e in primitives_of(self._file, m)]
        self._pictures.begin(dict.fromkeys(m for m in used if isinstance(m, int)))

    def placed(self, index: object, name: str, object_id: int, copies: Array | None) -> Iterator[tuple[Maker, Shape]]:
        """The surfaces of mesh ``index``, one for each primitive: how to make its mesh, and its shape.

        Points and lines are left out and counted. A mirroring transform turns the faces over, as the specification
        wants. ``copies`` (I,4,4) shows each of them that often.

        Raises:
            SceneFileError: damaged data. MeshError: vertices that are NaN or infinite.
        """
        for number, entry in enumerate(primitives_of(self._file, index)):
            mode, key = entry.get("mode", TRIANGLES), f"meshes[{index}].primitives[{number}]"
            if mode not in SURFACES:
                self._say_other(entry, mode, key)
                continue
            material, sets = self._material(entry)
            part = self._primitive(entry, sets, key)
            if not len(part.faces):
                continue
            if copies is not None:
                part = _copied(part, copies)
            yield _maker(part, name, material, object_id), _shape(part)

    def _say_other(self, entry: dict[str, Any], mode: Any, key: str) -> None:
        position = object_of(entry.get("attributes")).get("POSITION")
        count = Accessors(self._file).count(entry.get("indices", position)) if position is not None else 0
        if mode == POINTS:
            self.points += count
        elif mode in (1, 2, 3):
            self._file.notes.not_used("lines", count // 2 if mode == 1 else max(count - (mode == 3), 0))
        else:
            raise SceneFileError(self._file.path, f"unknown mode {mode!r}", key=key)

    def _chosen(self, variant: str | None) -> int | None:
        if variant is None:
            return None
        if variant not in self.variants:
            raise InputError(f"there is no variant {variant!r}; known: {', '.join(self.variants) or 'none'}")
        return self.variants.index(variant)

    def _material(self, entry: dict[str, Any]) -> tuple[int, tuple[int, ...]]:
        """Row of the primitive's material, and the sets of texture coordinates that it reads."""
        index = entry.get("material")
        if self._variant is not None:
            mappings = object_of(object_of(entry.get("extensions")).get(VARIANTS)).get("mappings")
            for mapping in mappings if isinstance(mappings, list) else []:
                listed = object_of(mapping).get("variants")
                if isinstance(listed, list) and self._variant in listed:
                    index = object_of(mapping).get("material")
        if index is not None:
            self._file.item("materials", index)
        if index not in self._materials:
            material, sets = (Material(name="default"), ()) if index is None else self._pictures.read(index)
            self._materials[index] = (len(self.materials), sets)
            self.materials.append(material)
        return self._materials[index]

    def _primitive(self, entry: dict[str, Any], sets: tuple[int, ...], key: str) -> Primitive:
        used = repr([entry.get(n) for n in ("attributes", "indices", "mode", "targets", "extensions")] + [sets])
        if used not in self._primitives:
            part = self._reader.read(entry, sets, key)
            self._primitives[used] = self._without_invalid(part) if self._drop else part
        return self._primitives[used]

    def _without_invalid(self, part: Primitive) -> Primitive:
        lost = np.logical_not(np.isfinite(part.vertices).all(axis=1))
        if not lost.any():
            return part
        self._file.notes.repaired("vertices that are NaN or infinite: dropped with their faces", int(lost.sum()))
        keep = np.flatnonzero(~lost)
        new = np.cumsum(~lost) - 1
        faces = part.faces[~lost[part.faces].any(axis=1)]
        return replace(taken(part, keep), faces=new[faces])


def _variant_names(file: GltfFile) -> list[str]:
    entries = object_of(object_of(file.json.get("extensions")).get(VARIANTS)).get("variants")
    return [str(object_of(e).get("name", k)) for k, e in enumerate(entries if isinstance(entries, list) else [])]


def _shape(part: Primitive) -> Shape:
    def stack(name: str) -> Array | None:
        found = [getattr(t, name) for t in part.targets]
        if all(f is None for f in found):
            return None
        return np.stack([np.zeros((len(part.vertices), 3), np.float32) if f is None else f for f in found])

    positions = stack("position")
    if positions is None and part.targets:
        positions = np.zeros((len(part.targets), len(part.vertices), 3), np.float32)
    return Shape(
        vertices=part.vertices,
        faces=part.faces,
        normals=part.normals,
        own_normals=part.own_normals,
        tangents=part.tangents,
        joints=part.joints,
        weights=part.weights,
        target_positions=positions,
        target_normals=stack("normal"),
        target_tangents=stack("tangent"),
    )


def _maker(primitive: Primitive, name: str, material: int, object_id: int) -> Maker:
    def make(part: Part, motion: Motion) -> Mesh:
        assert motion.worlds is not None
        skin = None if part.skin is None else motion.skins[part.skin]
        weights = motion.weights.get(part.node)
        now = placed(part.shape, motion.worlds[part.node], weights, skin, motion.worlds)
        colors = primitive.colors
        return Mesh(
            vertices=torch.from_numpy(now.vertices),
            faces=torch.from_numpy(now.faces),
            name=name,
            normals=_tensor(now.normals),
            uv=_tensor(primitive.uv[0]),
            uv1=_tensor(primitive.uv[1]),
            tangents=_tensor(now.tangents),
            colors=None if colors is None else _tensor(np.ascontiguousarray(colors[:, :3])),
            alpha=None if colors is None or (colors[:, 3] == 1.0).all() else _tensor(colors[:, 3].copy()),
            material=material,
            object_id=object_id,
        )

    return make


def _tensor(values: Array | None) -> torch.Tensor | None:
    return None if values is None else torch.from_numpy(values)


def _copied(part: Primitive, copies: Array) -> Primitive:
    """The primitive once for each matrix (I,4,4), in the frame of its node; bones and targets do not go with copies."""
    count = len(part.vertices)
    vertices, faces, normals, tangents = [], [], [], []
    for number, matrix in enumerate(copies):
        v, f, n = place_arrays(part.vertices, part.faces, part.normals, matrix)
        vertices.append(v)
        faces.append(f + number * count)
        normals.append(np.zeros_like(part.normals) if n is None else n)
        tangents.append(place_tangents(part.tangents, matrix))
    rows = np.tile(np.arange(count), len(copies))
    whole = replace(taken(part, rows), joints=None, weights=None, targets=())
    return replace(
        whole,
        vertices=np.concatenate(vertices) if vertices else np.zeros((0, 3)),
        faces=np.concatenate(faces) if faces else np.zeros((0, 3), np.int64),
        normals=np.concatenate(normals) if normals else np.zeros((0, 3), np.float32),
        tangents=None if part.tangents is None or not tangents else np.concatenate(tangents),  # type: ignore[arg-type]
    )
