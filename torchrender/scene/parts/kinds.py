"""What the parts of a scene must be, and whether their arrays are still what they were."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from torch import Tensor

from torchrender.checks import check_name
from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import Light
from torchrender.scene.material import Material
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import Mesh
from torchrender.scene.motion.records import Motion

ARRAYS = ("vertices", "faces", "normals", "uv", "uv1", "tangents", "colors", "alpha")
"""Of a mesh."""
KINDS: Mapping[str, tuple[type, ...]] = {
    "meshes": (Mesh,),
    "materials": (Material,),
    "lights": get_args(Light),
    "media": (Medium,),
    "motions": (Motion,),
}


def versions(meshes: Sequence[Mesh]) -> tuple[int, ...]:
    """How often each array of each mesh was written to, as PyTorch counts it; -1 where it does not."""
    tensors = [getattr(mesh, name) for mesh in meshes for name in ARRAYS]
    return tuple(-1 if one is None or one.is_inference() else one._version for one in tensors)


def color_versions(materials: Sequence[Material]) -> tuple[int, ...]:
    """How often each colour of each material was written to, as PyTorch counts it; -1 where it does not."""
    colors = [c for m in materials for c in (m.diffuse, m.specular_color, m.emission, m.sheen_color)]
    return tuple([-1 if c.is_inference() else c._version for c in colors])


def several(name: str, value: object, kinds: tuple[type, ...]) -> tuple[Any, ...]:
    """The parts of a scene as a tuple, also where one is given alone."""
    parts = (value,) if isinstance(value, kinds) else tuple(value) if isinstance(value, Iterable) else (value,)
    for one in parts:
        if not isinstance(one, kinds):
            wanted = " or ".join(kind.__name__ for kind in kinds)
            raise InputError(f"{name} must be {wanted}, one or several, got {type(one).__name__}")
    return parts


def check_parts(meshes: Sequence[Mesh], materials: int, environment: object, cameras: object) -> None:
    """Whether the parts of a scene go together, and what surrounds its meshes is what its name says.

    Args:
        materials: how many there are.

    Raises:
        InputError: they do not; names what.
    """
    for mesh in meshes:
        if not materials:
            raise InputError(f"materials must not be empty: mesh {mesh.name!r} has number {mesh.material} of them")
        if not 0 <= mesh.material < materials:
            raise InputError(f"mesh {mesh.name!r}: material must be in [0, {materials - 1}], got {mesh.material}")
    _check_environment(environment)
    _check_cameras(cameras)


def _check_cameras(value: object) -> None:
    """Whether the cameras of a scene have names, and are cameras."""
    if not isinstance(value, Mapping):
        how = "{'front': camera}"
        raise InputError(f"cameras must be a mapping of names to Cameras, such as {how}, got {type(value).__name__}")
    for name, camera in value.items():
        check_name("name of a camera", name)
        if not isinstance(camera, Cameras):
            raise InputError(f"camera {name!r} must be Cameras, got {type(camera).__name__}")


def _check_environment(value: object) -> None:
    """Whether it is one, or none; else it is said what to give in place of it."""
    if value is None or isinstance(value, Environment):
        return
    if isinstance(value, str | Path):
        raise InputError(f"environment must be an Environment: take Environment.load({str(value)!r})")
    if isinstance(value, Tensor):
        raise InputError("environment must be an Environment: take Environment(radiance=...)")
    raise InputError(f"environment must be an Environment, got {type(value).__name__}")


MOST_NAMED = 8
"""Objects that a message lists."""


def nearest_names(name: str, known: Sequence[str]) -> str:
    """Those that are spelt alike, else the first ones, as text."""
    near = get_close_matches(name, known, 5) or known
    more = f" … ({len(near)} in all)" if len(near) > MOST_NAMED else ""
    return (", ".join(near[:MOST_NAMED]) + more) or "none"


def check_unchanged(name: str, meshes: Sequence[Mesh], known: tuple[int, ...] | None) -> None:
    """Refuse arrays of the meshes of a scene that were written to since ``known`` was read.

    Raises:
        InputError: names the mesh and the array.
    """
    now = None if known is None else versions(meshes)
    if known is None or now is None or now == known:
        return
    place = next(k for k, (was, new) in enumerate(zip(known, now, strict=True)) if was != new)
    mesh, array = meshes[place // len(ARRAYS)].name, ARRAYS[place % len(ARRAYS)]
    told = f"{array} of mesh {mesh!r} were changed in place after scene {name!r} had been drawn, which would not show"
    how = "mesh.with_vertices(...)" if array == "vertices" else f"dataclasses.replace(mesh, {array}=...)"
    raise InputError(f"{told}: make a new mesh, {how}, and scene.replace(meshes=...)")
