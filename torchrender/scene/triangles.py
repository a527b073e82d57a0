"""Whatever has triangles, as their arrays."""

from __future__ import annotations

from torchrender.errors import InputError
from torchrender.scene.mesh import Geometry, Mesh, concatenate
from torchrender.scene.model import Scene

Shape = Scene | Mesh | Geometry
"""What functions of triangles take."""


def geometry_of(name: str, shape: object) -> Geometry:
    """The triangles of a scene, of a mesh, or as they are.

    Raises:
        InputError: something else; names the argument.
    """
    if isinstance(shape, Geometry):
        return shape
    if isinstance(shape, Scene):
        return shape.geometry
    if isinstance(shape, Mesh):
        return concatenate([shape])
    raise InputError(f"{name} must be a Scene, a Mesh or a Geometry, got {type(shape).__name__}")
