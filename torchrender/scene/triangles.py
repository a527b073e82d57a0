"""Whatever has triangles, as their arrays."""

from __future__ import annotations

from operator import attrgetter
from pathlib import Path

from torchrender.checks import check_no_gradient
from torchrender.errors import GradientError, InputError
from torchrender.scene.mesh import Geometry, Mesh, concatenate
from torchrender.scene.model import Scene

Shape = Scene | Mesh | Geometry
"""What functions of triangles take."""

INSTEAD = "torchrender.held_surface gives depth and attributes theirs, with visibility held"
_FIELDS = ("vertices", "normals", "uv", "uv1", "tangents", "colors", "alpha")
_FIELDS_OF = attrgetter(*_FIELDS)


def check_fixed(function: str, shape: object) -> None:
    """Refuse meshes that ask for gradients: where things are is decided by compiled code, which gives none.

    Raises:
        GradientError: names the function, the mesh and its field.
    """
    if isinstance(shape, Scene):
        shape.check_unchanged()
    for mesh in shape.meshes if isinstance(shape, Scene) else (shape,) if isinstance(shape, Mesh) else ():
        values = _FIELDS_OF(mesh)
        # Scenes have thousands of meshes, and every picture asks: names are made for those that are refused.
        if any(value is not None and value.requires_grad for value in values):
            named = {f"{f} of mesh {mesh.name!r}": v for f, v in zip(_FIELDS, values)}
            try:
                check_no_gradient(function, **named)
            except GradientError as error:
                raise GradientError(f"{error}; {INSTEAD}") from None


def geometry_of(name: str, shape: object) -> Geometry:
    """The triangles of a scene, of a mesh, or as they are.

    Raises:
        InputError: something else; names the argument. GradientError: vertices that ask for gradients.
    """
    check_fixed("its triangles are read by compiled code, which", shape)
    if isinstance(shape, Geometry):
        return shape
    if isinstance(shape, Scene):
        return shape.geometry
    if isinstance(shape, Mesh):
        return concatenate([shape])
    raise InputError(f"{name} must be a Scene, a Mesh or a Geometry, got {_told(shape)}")


def check_scene(name: str, scene: object) -> Scene:
    """The scene itself.

    Raises:
        InputError: something else; names the argument, and says how a scene is made of it.
    """
    if isinstance(scene, Scene):
        return scene
    raise InputError(f"{name} must be a Scene, got {_told(scene)}")


def _told(shape: object) -> str:
    if isinstance(shape, str | Path):
        return f"the text {str(shape)!r}: load it first, torchrender.load({str(shape)!r})"
    hint = ": put it into one, Scene(meshes=[mesh])" if isinstance(shape, Mesh) else ""
    return f"{type(shape).__name__}{hint}"
