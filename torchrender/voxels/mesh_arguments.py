"""Voxels of a shape on a grid of so many cells, and of vertices and faces on a grid: one set of arguments of both."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import as_array, check_no_gradient, is_whole
from torchrender.errors import InputError
from torchrender.scene.triangles import Shape, geometry_of
from torchrender.voxels.grid import VoxelGrid, make_grid


def mesh_arguments(
    vertices: Tensor | Shape, faces: Tensor | VoxelGrid | int, grid: VoxelGrid | int | None
) -> tuple[Tensor, Tensor, VoxelGrid]:
    """Vertices (B,V,3), faces (F,3) and B grids.

    Lists and arrays of NumPy are taken as tensors, vertices (V,3) of them as one mesh. A shape stands for vertices and
    faces, and what follows it is the grid; a number of cells along the longest side stands for a grid around the
    vertices.

    Raises:
        InputError: no shape, no tensors, or no grid. GradientError: vertices ask for gradients.
    """
    if isinstance(vertices, list | tuple | np.ndarray):
        vertices = as_array("vertices", vertices)
        vertices = vertices[None] if vertices.dim() == 2 else vertices
    if isinstance(faces, list | tuple | np.ndarray):
        faces = as_array("faces", faces, torch.int64)
    if not isinstance(vertices, Tensor):
        geometry = geometry_of("shape", vertices)
        if isinstance(faces, Tensor) or grid is not None:
            raise InputError("of a shape, the grid is all that follows; faces are for vertices given as a tensor")
        count = len(faces) if isinstance(faces, VoxelGrid) else 1
        points = geometry.vertices.expand(count, *geometry.vertices.shape)
        return points, geometry.faces, _grid(points, faces)
    check_no_gradient("voxelization", vertices=vertices)
    if not isinstance(faces, Tensor):
        raise InputError(f"faces must be a torch tensor, got {type(faces).__name__}")
    if grid is None:
        raise InputError("grid must be a VoxelGrid or a number of cells, got None")
    return vertices, faces, _grid(vertices, grid)


def _grid(points: Tensor, grid: object) -> VoxelGrid:
    if isinstance(grid, VoxelGrid):
        return grid
    if is_whole(grid):
        return make_grid(points, int(grid))
    raise InputError(f"grid must be a VoxelGrid or a number of cells, got {type(grid).__name__}")
