"""The visible sides of voxels as triangles, so that they can be rendered, saved and shadowed like any mesh."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.checks import check_class, check_tensor
from torchrender.errors import InputError
from torchrender.scene.mesh import Mesh
from torchrender.voxels.grid import WORD, Voxels

# Corners of the side of a unit cell towards +a in cyclic coordinates (a, b, c), counter-clockwise seen from outside.
_SQUARE = ((1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1))


def voxel_mesh(voxels: Voxels, color: Tensor | None = None, *, normals: Tensor | None = None) -> Mesh:
    """Sides of the cells of one grid that face an empty cell or the outside of the grid, two triangles each.

    Args:
        color: (N,3) linear colour of each cell, in the order of ``voxels.cells()``; None: white.
        normals: (N,3) shading normals of each cell; None: those of the sides.

    Raises:
        InputError: several grids, or values of another shape.
    """
    check_class("voxels", voxels, Voxels)
    if len(voxels.grid) != 1:
        raise InputError(f"voxels must be of one grid, got {len(voxels.grid)}")
    numbers = voxels.numbers()
    for name, value in (("color", color), ("normals", normals)):
        if value is not None:
            check_tensor(name, value, (len(numbers), 3))
    corners, rows, facing = [], [], []
    for axis in range(3):
        for sign in (1, -1):
            side = Voxels(voxels.words & ~_neighbours(voxels.words, axis, sign), voxels.grid)
            shown = side.numbers()
            corners.append(side.indices(shown)[:, None] + _side(axis, sign))
            rows.append(torch.searchsorted(numbers, shown))
            facing.append(sign * torch.eye(3)[axis].expand(len(shown), 3))
    at, row = torch.cat(corners), torch.cat(rows).repeat_interleave(4)
    vertices = voxels.grid.origin[0] + at.reshape(-1, 3).double() * voxels.grid.cell[0]
    quads = torch.tensor([[0, 1, 2], [0, 2, 3]]) + torch.arange(len(at))[:, None, None] * 4
    shading = torch.cat(facing).repeat_interleave(4, dim=0) if normals is None else normals[row]
    return Mesh(
        vertices=vertices,
        faces=quads.reshape(-1, 3),
        normals=shading,
        colors=None if color is None else color[row].float(),
        name="voxels",
    )


def _side(axis: int, sign: int) -> Tensor:
    """(4,3) corners of a cell's side."""
    square = torch.tensor(_SQUARE)
    if sign < 0:
        square = square.flip(0)
        square[:, 0] = 0
    return square.roll(axis, dims=1)


def _neighbours(words: Tensor, axis: int, sign: int) -> Tensor:
    """Bits of the next cell along an axis (sign 1) or of the one before, in each cell's place."""
    out = torch.zeros_like(words)
    if axis > 0:
        dim, n = 3 - axis, words.shape[3 - axis] - 1
        out.narrow(dim, 0 if sign > 0 else 1, n).copy_(words.narrow(dim, 1 if sign > 0 else 0, n))
        return out
    if sign > 0:
        out[..., :-1] = words[..., 1:] << (WORD - 1)
        return out | ((words >> 1) & (2 ** (WORD - 1) - 1))
    out[..., 1:] = (words[..., :-1] >> (WORD - 1)) & 1
    return out | (words << 1)
