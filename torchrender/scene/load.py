"""One door for everything that is a scene: scene files, mesh files and built-in procedural scenes."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from torchrender.arrays import in_single_precision
from torchrender.errors import InputError, NotUsedWarning, OptionError, SceneFileError
from torchrender.scene.files.choice import FileChoice
from torchrender.scene.files.scene_file import load_scene_file
from torchrender.scene.files.source import MESH_SUFFIXES, SCENE_SUFFIX, SUPPORTED, build_procedural, load_mesh_file
from torchrender.scene.model import Scene
from torchrender.scene.motion.update import knows


@in_single_precision
def load(
    path_or_name: str | Path,
    *,
    size: int | None = None,
    time: float | None = None,
    animation: str | int | None = None,
    variant: str | None = None,
    subscene: str | int | None = None,
    drop_invalid: bool = False,
) -> Scene:
    """A scene from a TOML scene file, a mesh file, or the name of a built-in procedural scene.

    Mesh files: GLB, glTF, OBJ, PLY and STL with materials, textures, vertex colours, node transforms, skins and
    animations. Files are told from names by their suffix. ``Scene.report`` says what was read, repaired and not used;
    what was repaired or not used is also a warning (:class:`~torchrender.errors.RepairedWarning`,
    :class:`~torchrender.errors.NotUsedWarning`).

    Args:
        path_or_name: a path with a known suffix, or a name such as ``"city"``.
        size: triangles that a procedural scene should have, about; not for files.
        time: seconds into an animation; None: the pose that the file stands in, or the start of ``animation`` where
            one is named.
        animation: its name or number; None: the first one. :meth:`Scene.at` plays it on.
        variant: name of a variant of the materials (KHR_materials_variants).
        subscene: name or number of one of several scenes in a glTF file; None: its default one.
        drop_invalid: leave vertices that are NaN or infinite out, with their faces, in place of an error.

    Raises:
        SceneFileError: missing, empty, damaged or unsupported file, or a mesh file without triangles.
        MeshError: a mesh with NaN or infinite vertices; names the mesh.
        InputError: an unknown name (known ones are listed), animation, variant or subscene, ``size`` given for a file,
            or a choice that the file's kind does not know.
    """
    if not isinstance(path_or_name, str | Path):
        raise InputError(f"load takes a path or a name, got {type(path_or_name).__name__}")
    choice = FileChoice(time=time, animation=animation, variant=variant, subscene=subscene, drop_invalid=drop_invalid)
    if not isinstance(path_or_name, str | os.PathLike):
        raise InputError(f"path_or_name must be a path or a name, got {type(path_or_name).__name__}")
    if not str(path_or_name).strip():
        raise InputError("a scene is a path or a name, got an empty one")
    path = Path(path_or_name)
    suffix = path.suffix.lower()
    built_in = not suffix and len(path.parts) == 1 and not path.is_file()
    if (built_in or suffix == SCENE_SUFFIX) and (variant is not None or subscene is not None):
        raise InputError(f"variant and subscene are for glTF files, not for {path_or_name}")
    if built_in:
        return _at(build_procedural(str(path_or_name), size), time, animation)
    if suffix not in (*MESH_SUFFIXES, SCENE_SUFFIX):
        reason = f"cannot read {suffix or 'files without suffix'}; supported: {SUPPORTED}"
        if not suffix:
            reason = "is a folder, not a file" if path.is_dir() else reason if path.exists() else "no such file"
        raise SceneFileError(path, reason)
    if size is not None:
        raise OptionError(f"size must be left out where a file is read, as {path} is")
    return _at(load_scene_file(path), time, animation) if suffix == SCENE_SUFFIX else load_mesh_file(path, choice)


def _at(scene: Scene, time: float | None, animation: str | int | None) -> Scene:
    """The scene at a time of its animation, where one is asked for."""
    if time is None and animation is None:
        return scene
    if not scene.animations:
        raise InputError(f"time and animation are for scenes that move; {scene.name} has no animation")
    moved = scene.at(time, animation)
    played = [m.animation(animation) for m in scene.motions if knows(m, animation)]
    for told in dict.fromkeys(one.beyond(time) for one in played if one is not None and time is not None):
        if told:
            warnings.warn(f"{scene.name}: {told}", NotUsedWarning, stacklevel=3)
    return moved
