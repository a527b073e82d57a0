"""One door for everything that is a scene: scene files, mesh files and built-in procedural scenes."""

from __future__ import annotations

from pathlib import Path

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.files.scene_file import load_scene_file
from torchrender.scene.files.source import MESH_SUFFIXES, SCENE_SUFFIX, SUPPORTED, build_procedural, load_mesh_file
from torchrender.scene.model import Scene


def load(path_or_name: str | Path, *, size: int | None = None) -> Scene:
    """A scene from a TOML scene file, a mesh file, or the name of a built-in procedural scene.

    Mesh files: GLB, glTF, OBJ, PLY and STL with materials, textures, vertex colours and node transforms. Files are
    told from names by their suffix.

    Args:
        path_or_name: a path with a known suffix, or a name such as ``"city"``.
        size: triangles that a procedural scene should have, about; not for files.

    Raises:
        SceneFileError: missing, empty, damaged or unsupported file, or a mesh file without triangles.
        MeshError: a mesh with NaN or infinite vertices; names the mesh.
        InputError: an unknown name (known ones are listed), or ``size`` given for a file.
    """
    path = Path(path_or_name)
    suffix = path.suffix.lower()
    if not suffix and len(path.parts) == 1 and not path.is_file():
        return build_procedural(str(path_or_name), size)
    if suffix not in (*MESH_SUFFIXES, SCENE_SUFFIX):
        reason = f"cannot read {suffix or 'files without suffix'}; supported: {SUPPORTED}"
        raise SceneFileError(path, reason if suffix or path.exists() else "no such file")
    if size is not None:
        raise InputError(f"size is for procedural scenes only, {path} is a file")
    return load_scene_file(path) if suffix == SCENE_SUFFIX else load_mesh_file(path)
