"""OBJ, PLY and STL files through trimesh's readers.

Face order and winding stay as they are in the file. Meshes without normals get smooth ones, split at sharp edges.
Colours stored as integers are sRGB, colours stored as floats are linear.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from trimesh.exchange.obj import load_obj
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl
from trimesh.resolvers import Resolver

from torchrender.errors import SceneFileError
from torchrender.numerics.color import linear_from_srgb
from torchrender.scene.files.plain.mtl import read_materials
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.smooth import crease_normals

Array = np.ndarray[Any, Any]
_PLY_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "float", "int32", "uint32", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}


class _Materials(Resolver):
    """Stands in for the MTL file, so that trimesh splits the faces by every material name the OBJ uses."""

    def __init__(self, names: list[str]) -> None:
        self._text = "".join(f"newmtl {name}\n" for name in names).encode()

    def get(self, name: str) -> bytes:  # noqa: ARG002
        return self._text

    def write(self, name: str, data: bytes) -> None:
        raise NotImplementedError

    def keys(self) -> list[str]:
        return []

    def namespaced(self, namespace: str) -> Resolver:  # noqa: ARG002
        return self


def read_mesh_file(path: Path, data: bytes, *, drop_invalid: bool = False) -> Scene:
    """The meshes of an ``.obj``, ``.ply`` or ``.stl`` file, one per material and object.

    Raises:
        SceneFileError: damaged, cut off, or without triangles.
        MeshError: vertices that are NaN or infinite, or faces that name missing vertices.
    """
    suffix = path.suffix.lower()
    try:
        with warnings.catch_warnings():
            # numpy only warns where text is no number; the numbers after it would be lost silently.
            warnings.simplefilter("error", DeprecationWarning)
            if suffix == ".obj":
                meshes, materials = _read_obj(path, data)
            elif suffix == ".ply":
                meshes, materials = _read_ply(path, data)
            else:
                parts = load_stl(io.BytesIO(data))
                meshes, materials = [_mesh(p, path.stem, 0, 0) for p in _parts(parts)], [Material(name="default")]
    except (SceneFileError, MemoryError):
        raise
    # trimesh raises whatever its parsing runs into: IndexError, KeyError, UnicodeDecodeError, its own HeaderError ...
    except Exception as error:
        if type(error).__module__.startswith("torchrender"):
            raise
        raise SceneFileError(path, f"damaged or no {suffix[1:].upper()} file ({error})") from error
    meshes = [m for m in meshes if len(m.faces)]
    if not meshes:
        raise SceneFileError(path, "holds no triangles")
    return Scene(meshes=tuple(meshes), materials=tuple(materials), name=path.stem)


def _parts(loaded: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The meshes of what a trimesh reader gives: one, or several by name."""
    if "geometry" in loaded:
        yield from loaded["geometry"].values()
    elif "vertices" in loaded:
        yield loaded
    else:
        yield from (v for v in loaded.values() if isinstance(v, dict) and "vertices" in v)


def _read_obj(path: Path, data: bytes) -> tuple[list[Mesh], list[Material]]:
    text = data.decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    # trimesh takes a comment behind numbers for more numbers.
    text = re.sub(r"(?m)^((?:v|vt|vn|f)[ \t][^#\n]*)#.*$", r"\1", text)
    libraries = re.findall(r"(?m)^mtllib[ \t]+(.+?)[ \t]*$", text)
    names = list(dict.fromkeys(re.findall(r"(?m)^usemtl[ \t]+(.+?)[ \t]*$", text))) if libraries else []
    loaded = load_obj(io.BytesIO(text.encode()), resolver=_Materials(names), split_objects=True)
    known = read_materials(path, libraries, names)
    materials: list[Material] = []
    rows: dict[str | None, int] = {}
    objects: dict[str, int] = {}
    meshes = []
    # trimesh hands the groups out last first.
    parts = loaded.get("geometry", {})
    for name, part in reversed(list(parts.items())):
        visual = part.get("visual")
        material = getattr(getattr(visual, "material", None), "name", None)
        material = material if material in known else None
        if material not in rows:
            rows[material] = len(materials)
            materials.append(known[material] if material is not None else Material(name="default"))
        owner = name.removesuffix(f"_{material}") if len(names) > 1 and material else name
        number = objects.setdefault(owner, len(objects))
        meshes.append(_mesh(part, owner if "o " in text and owner else path.stem, rows[material], number))
    return meshes, materials


def _read_ply(path: Path, data: bytes) -> tuple[list[Mesh], list[Material]]:
    header = check_ply(path, data)
    per_face = re.search(r"(?m)^property list \w+ \w+ texcoord\b", header) is not None
    loaded = load_ply(io.BytesIO(data), skip_materials=True, fix_texture=per_face)
    if per_face:
        # Vertices were split by texture coordinate; trimesh leaves the other attributes behind.
        loaded.pop("vertex_normals", None)
        loaded.pop("vertex_colors", None)
    if loaded.get("faces") is None:
        raise SceneFileError(path, f"holds {len(loaded.get('vertices', ()))} points but no triangles")
    textures = re.findall(r"(?m)^comment TextureFile (.+?)\s*$", header)
    material = Material(name="default")
    if textures:
        material = read_materials(path, [], [], texture=textures[0])[""]
    return [_mesh(loaded, path.stem, 0, 0)], [material]


def check_ply(path: Path, data: bytes) -> str:
    """The header's text, after comparing the declared counts with the bytes that are there."""
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise SceneFileError(path, "damaged or no PLY file: the header is not complete")
    header = data[:end].decode("ascii", errors="replace").replace("\r\n", "\n")
    ascii_text = re.search(r"(?m)^format ascii", header) is not None
    needed = 0
    for count, properties in re.findall(r"(?m)^element \w+ (\d+)[ \t]*((?:\n(?:property|comment).*)*)", header):
        # A number in text takes two bytes at least; a list may be empty and then is its count alone.
        sizes = [
            2 if ascii_text else _PLY_BYTES.get(words[1] if words[0] == "list" else words[0], 1)
            for words in (line.split()[1:] for line in properties.splitlines() if line.startswith("property"))
            if len(words) >= 2
        ]
        needed += int(count) * sum(sizes)
    have = len(data) - end - len(b"end_header")
    # The last line of a text file may lack its end.
    if needed > have + 1:
        raise SceneFileError(path, f"cut off: the header declares at least {needed} bytes of data, there are {have}")
    return header


def _mesh(part: dict[str, Any], name: str, material: int, object_id: int) -> Mesh:
    vertices = np.asarray(part["vertices"], dtype=np.float64)
    faces = _triangulated(part.get("faces"))
    normals = part.get("vertex_normals")
    uv = getattr(part.get("visual"), "uv", None)
    colors = linear_colors(part.get("vertex_colors"), len(vertices))
    face_colors = linear_colors(part.get("face_colors"), len(faces))
    if normals is not None and len(normals) != len(vertices):
        normals = None
    if uv is not None and (len(uv) != len(vertices) or not np.isfinite(uv).all()):
        uv = None
    usable = np.isfinite(vertices).all() and (not faces.size or 0 <= faces.min() <= faces.max() < len(vertices))
    source = np.arange(len(vertices))
    if colors is None and face_colors is not None and usable:
        source, colors = faces.reshape(-1), face_colors.repeat_interleave(3, dim=0)
        faces = np.arange(len(source)).reshape(-1, 3)
        vertices, normals = vertices[source], None if normals is None else normals[source]
        uv = None if uv is None else uv[source]
    if normals is None and usable:
        source, faces, normals = crease_normals(vertices, faces)
        vertices = vertices[source]
        uv = None if uv is None else uv[source]
        colors = None if colors is None else colors[torch.from_numpy(source)]
    return Mesh(
        vertices=torch.from_numpy(np.ascontiguousarray(vertices)),
        faces=torch.from_numpy(np.ascontiguousarray(faces)),
        name=name,
        normals=None if normals is None else _unit_or_zero(normals),
        uv=None if uv is None else torch.from_numpy(np.array(uv[:, :2], dtype=np.float32)),
        colors=colors,
        material=material,
        object_id=object_id,
    )


def _triangulated(faces: Any) -> Array:
    """(F,3) int64; polygons of one size become fans about their first corner."""
    if faces is None:
        return np.zeros((0, 3), dtype=np.int64)
    polygons = np.asarray(faces, dtype=np.int64)
    corners = polygons.shape[1]
    fans = [polygons[:, [0, k, k + 1]] for k in range(1, corners - 1)]
    return np.stack(fans, axis=1).reshape(-1, 3) if fans else np.zeros((0, 3), dtype=np.int64)


def _unit_or_zero(normals: Any) -> Tensor:
    value = torch.from_numpy(np.nan_to_num(np.array(normals, dtype=np.float64), posinf=0.0, neginf=0.0))
    return torch.nn.functional.normalize(value, dim=1, eps=math.ulp(0.0)).float()


def linear_colors(colors: Any, count: int) -> Tensor | None:
    """(count,3) linear; integers are sRGB codes, floats are linear already."""
    if colors is None or not count or len(colors) != count:
        return None
    values = np.asarray(colors)[:, :3]
    if values.shape[1] != 3:
        return None
    if values.dtype.kind in "iu":
        return linear_from_srgb(torch.from_numpy(values / np.iinfo(values.dtype).max)).float()
    return torch.from_numpy(np.nan_to_num(values).clip(0.0, None).astype(np.float32))
