"""OBJ, PLY and STL files as scenes.

Face order and winding stay as they are in the file. Meshes without normals get smooth ones, split at sharp edges, or by
the file's smoothing groups. Colours stored as integers are sRGB, colours stored as floats are linear.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from torchrender.errors import SceneFileError, TorchRenderError
from torchrender.scene.files.content import read_bytes
from torchrender.scene.files.plain.build import Surface, build_mesh
from torchrender.scene.files.plain.mtl import picture_material, read_materials
from torchrender.scene.files.plain.obj import read_obj
from torchrender.scene.files.plain.ply import read_ply, surface_of
from torchrender.scene.files.plain.stl import read_stl
from torchrender.scene.files.report import Notes
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene


def read_mesh_file(path: Path, *, drop_invalid: bool = False) -> Scene:
    """The meshes of an ``.obj``, ``.ply`` or ``.stl`` file, one per material and object.

    Raises:
        SceneFileError: not readable, damaged, cut off, or without triangles.
        MeshError: vertices that are NaN or infinite, without ``drop_invalid``.
    """
    suffix, notes = path.suffix.lower(), Notes(path)
    read = {".obj": _obj, ".ply": _ply, ".stl": _stl}[suffix]
    try:
        meshes, materials = read(path, notes, drop_invalid)
    except (TorchRenderError, MemoryError):
        raise
    # What a damaged file may trip a reader over besides: bytes that are no text, numbers that are too large ...
    except (ValueError, OverflowError, IndexError, KeyError, TypeError) as error:
        raise SceneFileError(path, f"damaged or no {suffix[1:].upper()} file ({error})") from error
    meshes = [m for m in meshes if len(m.faces)]
    if not meshes:
        report = notes.report()
        told = "; ".join(map(str, (*report.repaired, *report.not_used)))
        raise SceneFileError(path, "holds no triangles" + (f" ({told})" if told else ""))
    notes.read("meshes", len(meshes))
    notes.read("materials", len(materials))
    return Scene(meshes=tuple(meshes), materials=tuple(materials), name=path.stem, report=notes.close())


def _obj(path: Path, notes: Notes, drop: bool) -> tuple[list[Mesh], list[Material]]:
    parts, libraries = read_obj(path, read_bytes(path), notes)
    wanted = list(dict.fromkeys(p.material for p in parts if p.material is not None)) if libraries else []
    known = read_materials(path, libraries, wanted, notes)
    rows: dict[str | None, int] = {}
    materials: list[Material] = []
    objects: dict[str | None, int] = {}
    meshes = []
    for part in parts:
        name = part.material if part.material in known else None
        if name not in rows:
            rows[name] = len(materials)
            materials.append(Material(name="default") if name is None else known[name])
        owner = objects.setdefault(part.name, len(objects))
        title = part.name or path.stem
        meshes.append(build_mesh(part.surface, title, notes, material=rows[name], object_id=owner, drop_invalid=drop))
    return meshes, materials


def _ply(path: Path, notes: Notes, drop: bool) -> tuple[list[Mesh], list[Material]]:
    # Nothing here holds the bytes any longer than they are needed: meshes of large files take as much again.
    model = read_ply(path, read_bytes(path), notes)
    if not len(model.counts):
        raise SceneFileError(path, f"holds {len(model.position)} points but no triangles")
    material = Material(name="default")
    if model.textures:
        material = picture_material(path, model.textures[0], notes)
        notes.not_used("further textures", len(model.textures) - 1)
    surface = surface_of(model, notes)
    del model
    return [build_mesh(surface, path.stem, notes, drop_invalid=drop)], [material]


def _stl(path: Path, notes: Notes, drop: bool) -> tuple[list[Mesh], list[Material]]:
    meshes = []
    for number, solid in enumerate(read_stl(path, read_bytes(path), notes)):
        count = len(solid.corners)
        surface = Surface(
            vertices=solid.corners.reshape(-1, 3),
            faces=np.arange(3 * count).reshape(-1, 3),
            colors=None if solid.colors is None else solid.colors.repeat(3, axis=0),
        )
        meshes.append(build_mesh(surface, solid.name, notes, object_id=number, drop_invalid=drop))
    return meshes, [Material(name="default")]
