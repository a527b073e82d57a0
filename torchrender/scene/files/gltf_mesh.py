"""glTF 2.0 primitives as :class:`~torchrender.scene.mesh.Mesh`: read once, then placed for every node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from torchrender.errors import SceneFileError
from torchrender.scene.files.gltf_file import Array, GltfFile
from torchrender.scene.files.gltf_material import GltfMaterials, TextureUse, transform_uv
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.place import place_arrays
from torchrender.scene.smooth import crease_normals

_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@dataclass(frozen=True, eq=False)
class Primitive:
    """One primitive in its own frame."""

    vertices: Array  # (V,3) float64
    faces: Array  # (F,3) int64
    normals: Array  # (V,3) float32
    uv: Array | None  # (V,2) float32, v up
    colors: Array | None  # (V,3) float32 linear


class GltfMeshes:
    """Meshes and materials of one file; primitives that share data and texture coordinates are read once."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._pictures = GltfMaterials(file)
        self._primitives: dict[object, Primitive] = {}
        self._materials: dict[int | None, tuple[int, TextureUse]] = {}
        self.materials: list[Material] = []

    def triangle_count(self, index: object) -> int:
        """Triangles that mesh ``index`` declares, from its accessors' counts alone."""
        total = 0
        for entry in self._entries(index):
            attributes = entry.get("attributes")
            position = attributes.get("POSITION") if isinstance(attributes, dict) else None
            count = self._file.item("accessors", entry.get("indices", position)).get("count")
            mode = entry.get("mode", _TRIANGLES)
            if isinstance(count, int) and mode in (_TRIANGLES, _STRIP, _FAN):
                total += count // 3 if mode == _TRIANGLES else max(count - 2, 0)
        return total

    def placed(self, index: object, world_from_local: Array, name: str, object_id: int) -> list[Mesh]:
        """The triangles of mesh ``index`` in world space, one :class:`Mesh` per primitive.

        Points and lines are left out. A mirroring transform turns the faces over, as the specification wants.

        Raises:
            SceneFileError: damaged data. MeshError: vertices that are NaN or infinite.
        """
        out = []
        for number, entry in enumerate(self._entries(index)):
            mode = entry.get("mode", _TRIANGLES)
            if mode not in (_TRIANGLES, _STRIP, _FAN):
                continue
            material, use = self._material(entry.get("material"))
            key = f"meshes[{index}].primitives[{number}]"
            part = self._primitive(entry, mode, use, key)
            if not len(part.faces):
                continue
            vertices, faces, normals = place_arrays(part.vertices, part.faces, part.normals, world_from_local)
            out.append(
                Mesh(
                    vertices=torch.from_numpy(vertices),
                    faces=torch.from_numpy(faces),
                    name=name,
                    normals=None if normals is None else torch.from_numpy(normals),
                    uv=None if part.uv is None else torch.from_numpy(part.uv),
                    colors=None if part.colors is None else torch.from_numpy(part.colors),
                    material=material,
                    object_id=object_id,
                )
            )
        return out

    def _entries(self, index: object) -> list[dict[str, Any]]:
        entries = self._file.item("meshes", index).get("primitives")
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise SceneFileError(self._file.path, "must be an array of objects", key=f"meshes[{index}].primitives")
        return entries

    def _material(self, index: int | None) -> tuple[int, TextureUse]:
        if index not in self._materials:
            if index is None:
                material, use = Material(name="default"), TextureUse()
            else:
                material, use = self._pictures.read(index)
            self._materials[index] = (len(self.materials), use)
            self.materials.append(material)
        return self._materials[index]

    def _primitive(self, entry: dict[str, Any], mode: int, use: TextureUse, key: str) -> Primitive:
        attributes = entry.get("attributes")
        if not isinstance(attributes, dict) or "POSITION" not in attributes:
            raise SceneFileError(self._file.path, "needs the attribute POSITION", key=key)
        for extension in ("KHR_draco_mesh_compression", "EXT_meshopt_compression"):
            if extension in (entry.get("extensions") or {}) and "POSITION" not in attributes:
                raise SceneFileError(self._file.path, f"{extension} is not supported", key=key)
        names = ("POSITION", "NORMAL", "COLOR_0", f"TEXCOORD_{use.set_index}")
        used = (entry.get("indices"), mode, use, *(attributes.get(n) for n in names))
        if used not in self._primitives:
            self._primitives[used] = self._read(attributes, entry.get("indices"), mode, use, key)
        return self._primitives[used]

    def _read(self, attributes: dict[str, Any], indices: Any, mode: int, use: TextureUse, key: str) -> Primitive:
        file = self._file
        vertices = file.accessor(attributes["POSITION"], ("VEC3",), f"{key}.POSITION").astype(np.float64)
        count = len(vertices)

        def attribute(name: str, kinds: tuple[str, ...]) -> Array | None:
            if name not in attributes:
                return None
            values = file.accessor(attributes[name], kinds, f"{key}.{name}")
            if len(values) != count:
                raise SceneFileError(file.path, f"has {len(values)} entries for {count} vertices", key=f"{key}.{name}")
            return values

        faces = _triangles(self._indices(indices, count, key), mode)
        if faces.size and int(faces.max()) >= count:
            raise SceneFileError(file.path, f"indices must be below {count}, got {int(faces.max())}", key=key)
        normals = attribute("NORMAL", ("VEC3",))
        uv = attribute(f"TEXCOORD_{use.set_index}", ("VEC2",))
        colors = attribute("COLOR_0", ("VEC3", "VEC4"))
        if uv is not None:
            uv = transform_uv(np.nan_to_num(uv), use).astype(np.float32)
            uv[:, 1] = 1.0 - uv[:, 1]
        if colors is not None:
            colors = np.ascontiguousarray(np.nan_to_num(colors[:, :3]), dtype=np.float32)
        if normals is None and np.isfinite(vertices).all():
            source, faces, normals = crease_normals(vertices, faces)
            vertices = vertices[source]
            uv = None if uv is None else uv[source]
            colors = None if colors is None else colors[source]
        if normals is None:
            normals = np.zeros_like(vertices)
        return Primitive(vertices, faces, np.nan_to_num(normals).astype(np.float32), uv, colors)

    def _indices(self, accessor: Any, count: int, key: str) -> Array:
        if accessor is None:
            return np.arange(count, dtype=np.int64)
        values = self._file.accessor(accessor, ("SCALAR",), f"{key}.indices")
        if values.dtype.kind != "u":
            raise SceneFileError(self._file.path, "must be unsigned integers", key=f"{key}.indices")
        return values.astype(np.int64)


def _triangles(indices: Array, mode: int) -> Array:
    """(F,3) from a list, strip or fan of indices; an incomplete last triangle is left out."""
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if len(indices) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    if mode == _FAN:
        return np.stack([np.broadcast_to(indices[0], len(indices) - 2), indices[1:-1], indices[2:]], axis=1)
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2, 1:] = faces[1::2, :0:-1]
    return faces
