"""Where scenes come from: mesh files by suffix, built-in procedural scenes by name."""

from __future__ import annotations

import difflib
from pathlib import Path

from torchrender.checks import check_range
from torchrender.errors import InputError, SceneFileError
from torchrender.scene.files.choice import PLAIN_CHOICE, FileChoice
from torchrender.scene.files.content import read_bytes
from torchrender.scene.model import Scene

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
SCENE_SUFFIX = ".toml"
SUPPORTED = f"{', '.join((SCENE_SUFFIX, *MESH_SUFFIXES))}; drawn, but no scenes: .trw (walkthroughs), .trp (points)"
MAX_SIZE = 50_000_000


def load_mesh_file(path: Path, choice: FileChoice = PLAIN_CHOICE) -> Scene:
    """A GLB, glTF, OBJ, PLY or STL file as a scene; errors as :func:`~torchrender.scene.load.load`."""
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise SceneFileError(path, f"no mesh file; supported: {', '.join(MESH_SUFFIXES)}")
    # Each reader brings libraries that take a visible share of a program's start: only the one wanted is loaded.
    if suffix in (".glb", ".gltf"):
        from torchrender.scene.files.gltf.read import read_gltf

        return read_gltf(path, read_bytes(path), choice)
    from torchrender.scene.files.plain.read import read_mesh_file

    if not choice.is_plain:
        raise InputError(f"time, animation, variant and subscene are for glTF files only, {path} is none")
    return read_mesh_file(path, drop_invalid=choice.drop_invalid)


def build_procedural(name: str, triangles: int | None = None, seed: int = 0) -> Scene:
    """A built-in scene by name.

    Raises:
        InputError: unknown name; the message lists the known ones.
    """
    # Building scenes is slower to import than reading files, and not every program needs it.
    from torchrender.scene.procedural import SCENES, build

    if name not in SCENES:
        near = difflib.get_close_matches(name, SCENES, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise InputError(f"no scene is named {name!r}; known: {', '.join(sorted(SCENES))}; files: {SUPPORTED}{hint}")
    if triangles is not None:
        check_range("size", triangles, 1, MAX_SIZE)
    return build(name, triangles=triangles, seed=seed)
