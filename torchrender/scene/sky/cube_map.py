"""Cube maps in world axes: directions, exact solid angles, the texel of a direction.

Texels are (6,S,S): face, row, column; the faces look along +x, -x, +y, -y, +z, -z, oriented as in OpenGL. Within a face
u grows with the column and v with the row, both from -1 to 1. Source: specification 08, sections 2 and 3.
"""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor
from torch.nn.functional import normalize


def face_directions(u: Tensor, v: Tensor) -> Tensor:
    """(6,...,3) not normalised, at coordinates (...) in [-1,1] of the faces; the largest component is one."""
    one = torch.ones_like(u)
    faces = ((one, -v, -u), (-one, -v, u), (u, one, v), (u, -one, -v), (u, -v, one), (-u, -v, -one))
    return torch.stack([torch.stack(face, dim=-1) for face in faces])


def texel_centres(side: int) -> Tensor:
    """(S,) float64 coordinates of columns or rows."""
    return 2.0 * (torch.arange(side, dtype=torch.float64) + 0.5) / side - 1.0


@cache
def texel_directions(side: int) -> Tensor:
    """(6,S,S,3) float64 unit directions of texel centres."""
    v, u = torch.meshgrid(texel_centres(side), texel_centres(side), indexing="ij")
    return normalize(face_directions(u, v), dim=-1)


@cache
def node_directions(cells: int) -> Tensor:
    """(6,C+1,C+1,3) float64 unit directions of the corners of C x C cells: faces share those on their edges."""
    line = torch.linspace(-1.0, 1.0, cells + 1, dtype=torch.float64)
    v, u = torch.meshgrid(line, line, indexing="ij")
    return normalize(face_directions(u, v), dim=-1)


@cache
def solid_angles(side: int) -> Tensor:
    """(S,S) float64 steradians of the texels of a face; those of six faces sum to 4 pi."""
    line = torch.linspace(-1.0, 1.0, side + 1, dtype=torch.float64)
    a, b = torch.meshgrid(line, line, indexing="ij")
    corner = torch.atan2(a * b, (a * a + b * b + 1.0).sqrt())
    return corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1]


def face_place(directions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Face (...) int64 and coordinates u, v (...) in [-1,1] of directions (...,3); of equal axes the first counts."""
    x, y, z = directions.unbind(-1)
    size = directions.abs()
    # argmax may return any of several maxima: say which.
    axis = torch.where(
        (size[..., 0] >= size[..., 1]) & (size[..., 0] >= size[..., 2]),
        0,
        torch.where(size[..., 1] >= size[..., 2], 1, 2),
    )
    major = directions.gather(-1, axis[..., None])[..., 0]
    sign = torch.where(major < 0, -1.0, 1.0).to(directions.dtype)
    u = torch.where(axis == 0, -sign * z, torch.where(axis == 1, x, sign * x))
    v = torch.where(axis == 1, sign * z, -y)
    scale = major.abs().clamp_min(1e-300 if directions.dtype == torch.float64 else 1e-37)
    return 2 * axis + (major < 0).long(), u / scale, v / scale


def texel_of(directions: Tensor, side: int) -> Tensor:
    """(...) int64 number of the texel that directions (...,3) point into."""
    face, u, v = face_place(directions)
    column, row = (((c + 1.0) * (0.5 * side)).floor().long().clamp(0, side - 1) for c in (u, v))
    return (face * side + row) * side + column
