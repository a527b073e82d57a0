"""glTF 2.0 primitives in their own frame: attributes, triangles, joints and morph targets."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.gltf import draco
from torchrender.scene.files.gltf.accessors import Accessors
from torchrender.scene.files.gltf.container import Array, GltfFile, object_of
from torchrender.scene.smooth import crease_normals

POINTS, LINES, LINE_LOOP, LINE_STRIP, TRIANGLES, STRIP, FAN = range(7)
SURFACES = (TRIANGLES, STRIP, FAN)
MAX_WORK = 400_000_000
"""Vertices and corners that all primitives of a file may declare, each counted as often as it is named."""
MAX_JOINT_SETS = 4


@dataclass(frozen=True, eq=False)
class Target:
    """Displacements of one morph target; None: it does not move them."""

    position: Array | None  # (V,3) float32
    normal: Array | None  # (V,3) float32
    tangent: Array | None  # (V,3) float32


@dataclass(frozen=True, eq=False)
class Primitive:
    """One primitive in its own frame."""

    vertices: Array  # (V,3) float64
    faces: Array  # (F,3) int64
    normals: Array  # (V,3) float32
    own_normals: bool  # they are the file's; else derived
    uv: tuple[Array | None, Array | None]  # (V,2) float32 each, v up
    tangents: Array | None  # (V,4) float32
    colors: Array | None  # (V,4) float32 linear, and opacity
    joints: Array | None = None  # (V,J) int64
    weights: Array | None = None  # (V,J) float64, each row adds up to 1
    targets: tuple[Target, ...] = field(default=())


class PrimitiveReader:
    """Primitives of one file."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._accessors = Accessors(file)
        self._work = 0

    def read(self, entry: dict[str, Any], sets: tuple[int, ...], key: str) -> Primitive:
        """A primitive of triangles; ``sets`` are those of texture coordinates that are wanted.

        Raises:
            SceneFileError: damaged data; names it.
        """
        source = _Source(self._file, self._accessors, entry, key)
        source.open()
        count = len(source.vertices)
        faces = triangles(source.indices, entry.get("mode", TRIANGLES))
        self._count(count + faces.size, key)
        if faces.size and int(faces.max()) >= count:
            raise SceneFileError(self._file.path, f"indices must be below {count}, got {int(faces.max())}", key=key)
        normals, joints = source.get("NORMAL", ("VEC3",)), source.joints()
        part = Primitive(
            vertices=source.vertices,
            faces=faces,
            normals=np.zeros((count, 3), np.float32) if normals is None else self._normals(normals),
            own_normals=normals is not None,
            uv=(source.uv(sets, 0), source.uv(sets, 1)),
            tangents=source.tangents(),
            colors=source.colors(),
            joints=None if joints is None else joints[0],
            weights=None if joints is None else joints[1],
            targets=source.targets(self._count),
        )
        part = _compact(part)
        if part.own_normals or not np.isfinite(part.vertices).all():
            return part
        rows, faces, smooth = crease_normals(part.vertices, part.faces)
        return replace(taken(part, rows), faces=faces, normals=smooth)

    def points(self, entry: dict[str, Any], key: str) -> tuple[Array, Array | None, Array | None]:
        """Positions (P,3) float64, normals (P,3) and colours (P,4) of a primitive of points."""
        source = _Source(self._file, self._accessors, entry, key)
        source.open()
        rows = source.indices
        self._count(len(source.vertices) + len(rows), key)
        if rows.size and int(rows.max()) >= len(source.vertices):
            raise SceneFileError(self._file.path, f"indices must be below {len(source.vertices)}", key=key)
        normals, colors = source.get("NORMAL", ("VEC3",)), source.colors()
        return (
            source.vertices[rows],
            None if normals is None else self._normals(normals)[rows],
            None if colors is None else colors[rows],
        )

    def _normals(self, values: Array) -> Array:
        """(V,3) float32, zero where they are not finite, which is noted."""
        return self._file.notes.known_normals(values.astype(np.float32))

    def _count(self, work: int, key: str) -> None:
        self._work += work
        if self._work > MAX_WORK:
            raise SceneFileError(self._file.path, f"declares more than {MAX_WORK} vertices and corners in all", key=key)


class _Source:
    """Where the attributes of one primitive come from: accessors, or a Draco stream."""

    def __init__(self, file: GltfFile, accessors: Accessors, entry: dict[str, Any], key: str) -> None:
        self._file, self._accessors, self._entry, self._key = file, accessors, entry, key
        attributes = entry.get("attributes")
        if not isinstance(attributes, dict) or "POSITION" not in attributes:
            raise SceneFileError(file.path, "needs the attribute POSITION", key=key)
        self._names: dict[str, Any] = attributes
        self._decoded: dict[str, Array] = {}
        self.indices = np.zeros(0, np.int64)
        self.vertices = np.zeros((0, 3))

    def open(self) -> None:
        """Read positions and indices."""
        stream = object_of(self._entry.get("extensions")).get(draco.EXTENSION)
        if stream is not None:
            self._unfold(object_of(stream), f"{self._key}.extensions.{draco.EXTENSION}")
        position = self.get("POSITION", ("VEC3",))
        assert position is not None
        self.vertices = position.astype(np.float64)
        if stream is None:
            self.indices = self._plain_indices(len(self.vertices))

    def _unfold(self, stream: dict[str, Any], key: str) -> None:
        wanted = {str(n): i for n, i in object_of(stream.get("attributes")).items() if isinstance(i, int)}
        buffer, start, size, _ = self._file.view(stream.get("bufferView"))
        most = self._accessors.count(self._entry["indices"]) // 3 if "indices" in self._entry else MAX_WORK
        try:
            faces, decoded = draco.decode(buffer[start : start + size], wanted, most)
            for name, values in decoded.items():
                declared = self._file.item("accessors", self._names[name]) if name in self._names else {}
                self._file.take(values.nbytes, key)
                self._decoded[name] = draco.typed(values, declared)
        except ValueError as error:
            raise SceneFileError(self._file.path, str(error), key=key) from error
        if "POSITION" not in self._decoded:
            raise SceneFileError(self._file.path, "the Draco stream has no positions", key=key)
        self.indices = faces.reshape(-1)

    def _plain_indices(self, count: int) -> Array:
        if self._entry.get("indices") is None:
            return np.arange(count, dtype=np.int64)
        key = f"{self._key}.indices"
        values = self._accessors.read(self._entry["indices"], ("SCALAR",), key)
        if values.dtype.kind != "u":
            raise SceneFileError(self._file.path, "must be unsigned integers", key=key)
        return values.astype(np.int64)

    def get(self, name: str, kinds: tuple[str, ...]) -> Array | None:
        """The values of an attribute, one row for each vertex; None if there is none of that name."""
        if name not in self._names:
            return None
        key = f"{self._key}.{name}"
        values = self._decoded[name] if name in self._decoded else self._accessors.read(self._names[name], kinds, key)
        if name != "POSITION" and len(values) != len(self.vertices):
            raise SceneFileError(
                self._file.path, f"has {len(values)} entries for {len(self.vertices)} vertices", key=key
            )
        width = {"VEC2": 2, "VEC3": 3, "VEC4": 4}
        if values.ndim != 2 or values.shape[1] not in [width[k] for k in kinds]:
            raise SceneFileError(self._file.path, f"must be {' or '.join(kinds)}", key=key)
        return values

    def uv(self, sets: tuple[int, ...], own: int) -> Array | None:
        """Texture coordinates with v up."""
        number = sets[own] if own < len(sets) else own
        values = self.get(f"TEXCOORD_{number}", ("VEC2",))
        if values is None:
            return None
        out = _floats(values).copy()
        out[:, 1] = 1.0 - out[:, 1]
        return out

    def tangents(self) -> Array | None:
        """Unit tangents and the sign of the bitangent, which v down and v up share."""
        values = self.get("TANGENT", ("VEC4",))
        return None if values is None else _floats(values)

    def colors(self) -> Array | None:
        """Colours and opacity of the vertices."""
        values = self.get("COLOR_0", ("VEC3", "VEC4"))
        if values is None:
            return None
        if values.dtype.kind in "iu":  # the file forgot to say that they are normalised
            values = values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
        out = np.ones((len(values), 4), np.float32)
        out[:, : values.shape[1]] = _floats(values)
        out[:, 3] = out[:, 3].clip(0.0, 1.0)
        return out.clip(0.0, None)

    def joints(self) -> tuple[Array, Array] | None:
        """Joints and their weights, all sets side by side; rows without any weight hang on the first joint."""
        found = []
        for number in range(MAX_JOINT_SETS):
            joints, weights = (self.get(f"{n}_{number}", ("VEC4",)) for n in ("JOINTS", "WEIGHTS"))
            if joints is None or weights is None:
                if (joints is None) != (weights is None):
                    self._file.notes.not_used(f"{'joints' if weights is None else 'weights'} without their partner")
                break
            if joints.dtype.kind != "u":
                raise SceneFileError(self._file.path, "must be unsigned integers", key=f"{self._key}.JOINTS_{number}")
            if weights.dtype.kind in "iu":
                weights = weights.astype(np.float32) / np.float32(np.iinfo(weights.dtype).max)
            found.append((joints.astype(np.int64), np.nan_to_num(weights.astype(np.float64), posinf=0.0).clip(0.0)))
        if not found:
            return None
        joints, weights = (np.concatenate([f[k] for f in found], axis=1) for k in (0, 1))
        total = weights.sum(axis=1, keepdims=True)
        lost = total[:, 0] <= 0
        if lost.any():
            weights[lost, 0] = total[lost] = 1.0
            self._file.notes.repaired("vertices without weights: they follow their first joint", int(lost.sum()))
        return joints, weights / total

    def targets(self, count_work: Any) -> tuple[Target, ...]:
        """Morph targets of the primitive."""
        entries = self._entry.get("targets")
        if entries is None:
            return ()
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise SceneFileError(self._file.path, "must be an array of objects", key=f"{self._key}.targets")
        out = []
        for number, entry in enumerate(entries):
            count_work(len(self.vertices), f"{self._key}.targets[{number}]")
            out.append(Target(*(self._displacement(entry, n, number) for n in ("POSITION", "NORMAL", "TANGENT"))))
            others = [n for n in entry if n not in ("POSITION", "NORMAL", "TANGENT")]
            for name in others:
                self._file.notes.not_used(f"morph targets of {name}")
        return tuple(out)

    def _displacement(self, entry: dict[str, Any], name: str, number: int) -> Array | None:
        if name not in entry:
            return None
        key = f"{self._key}.targets[{number}].{name}"
        values = self._accessors.read(entry[name], ("VEC3",), key)
        if len(values) != len(self.vertices):
            raise SceneFileError(
                self._file.path, f"has {len(values)} entries for {len(self.vertices)} vertices", key=key
            )
        return _floats(values)


def triangles(indices: Array, mode: Any) -> Array:
    """(F,3) from a list, strip or fan of indices; an incomplete last triangle is left out."""
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if len(indices) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    if mode == FAN:
        return np.stack([np.broadcast_to(indices[0], len(indices) - 2), indices[1:-1], indices[2:]], axis=1)
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2, 1:] = faces[1::2, :0:-1]
    return faces


def taken(part: Primitive, rows: Array) -> Primitive:
    """The primitive with these vertices (N,) of it; faces stay as they are."""

    def rows_of(values: Array | None) -> Array | None:
        return None if values is None else values[rows]

    return replace(
        part,
        vertices=part.vertices[rows],
        normals=part.normals[rows],
        uv=(rows_of(part.uv[0]), rows_of(part.uv[1])),
        tangents=rows_of(part.tangents),
        colors=rows_of(part.colors),
        joints=rows_of(part.joints),
        weights=rows_of(part.weights),
        targets=tuple(Target(rows_of(t.position), rows_of(t.normal), rows_of(t.tangent)) for t in part.targets),
    )


def _compact(part: Primitive) -> Primitive:
    """Without vertices that no face uses, where they are the most: primitives often share one set of attributes."""
    count = len(part.vertices)
    if 2 * part.faces.size >= count:
        return part
    rows, faces = np.unique(part.faces.reshape(-1), return_inverse=True)
    return replace(taken(part, rows), faces=faces.reshape(-1, 3))


def _floats(values: Array) -> Array:
    return np.nan_to_num(values.astype(np.float32), posinf=0.0, neginf=0.0)
