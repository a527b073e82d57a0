"""Simple shapes about the origin as meshes, y up, with normals and texture coordinates; faces turn outwards."""

from __future__ import annotations

from torch import Tensor

from torchrender.scene.mesh import Mesh
from torchrender.scene.primitives import arrays


def box(size: Tensor) -> Mesh:
    """Box with edge lengths ``size`` (3,); each side has its own vertices and the whole texture."""
    return Mesh(**arrays.box(size)._asdict(), name="box")


def plane(size: Tensor, segments: int = 1, tiles: float = 1.0) -> Mesh:
    """Horizontal rectangle ``size`` (2,) along x and z that faces up; see :func:`arrays.plane`."""
    return Mesh(**arrays.plane(size, segments, tiles)._asdict(), name="plane")


def quad(corner: Tensor, edge_u: Tensor, edge_v: Tensor) -> Mesh:
    """Parallelogram from a corner and two edges (3,); it faces ``edge_u x edge_v``."""
    return Mesh(**arrays.quad(corner, edge_u, edge_v)._asdict(), name="quad")


def sphere(radius: float = 1.0, segments: int = 64) -> Mesh:
    """Sphere of ``segments`` meridians and half as many parallels; u runs around, v from pole to pole."""
    return Mesh(**arrays.sphere(radius, segments)._asdict(), name="sphere")


def cylinder(radius: float = 1.0, height: float = 1.0, segments: int = 64) -> Mesh:
    """Closed upright cylinder about the origin, with hard edges at its caps."""
    return Mesh(**arrays.cylinder(radius, height, segments)._asdict(), name="cylinder")


def cone(radius: float = 1.0, height: float = 1.0, segments: int = 64) -> Mesh:
    """Closed upright cone; the origin is half-way up its axis."""
    return Mesh(**arrays.cone(radius, height, segments)._asdict(), name="cone")


def torus(radius: float = 1.0, tube: float = 0.3, segments: int = 64) -> Mesh:
    """Ring about the y axis: ``radius`` to the middle of a tube of radius ``tube``."""
    return Mesh(**arrays.torus(radius, tube, segments)._asdict(), name="torus")
