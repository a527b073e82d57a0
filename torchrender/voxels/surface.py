"""Surface voxels of triangle meshes, each triangle once. Source: specification 05, section 4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import overload

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_choice, check_finite, check_tensor, checked_fields, options_of
from torchrender.errors import InputError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.voxels.cells import Soup
from torchrender.kernels.voxels.surface import classify, mark_surface
from torchrender.scene.triangles import Shape
from torchrender.voxels.grid import WORD, VoxelGrid, Voxels, empty_words, flat
from torchrender.voxels.mesh_arguments import mesh_arguments

MODES = ("conservative", "thin")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SurfaceOptions:
    """``conservative`` marks every cell whose closed box meets a triangle: no leaks. ``thin`` samples the dominant axis
    at the centres of cell columns, as the source does: fewer cells, and triangles smaller than a column may vanish.

    Raises:
        OptionError: an unknown mode.
    """

    mode: str = "conservative"

    def __post_init__(self) -> None:
        check_choice("mode", self.mode, MODES)


@overload
def voxelize_surface(
    vertices: Tensor, faces: Tensor, grid: VoxelGrid | int, options: SurfaceOptions | None = None
) -> Voxels: ...
@overload
def voxelize_surface(shape: Shape, grid: VoxelGrid | int, /, *, options: SurfaceOptions | None = None) -> Voxels: ...
def voxelize_surface(
    vertices: Tensor | Shape,
    faces: Tensor | VoxelGrid | int,
    grid: VoxelGrid | int | None = None,
    options: SurfaceOptions | None = None,
) -> Voxels:
    """Cells that the triangles meet.

    Args:
        vertices: (B,V,3) float, scene units; or a scene, a mesh or a geometry, then without ``faces``.
        faces: (F,3) integer, shared by the batch.
        grid: B grids; parts of the mesh outside are left out. A number: a grid around it with so many cells along the
            longest side.

    Returns:
        Voxels, with ``stats``: ``pairs`` of triangle and cell, and ``flat`` triangles, which have no area and are
        skipped.

    Raises:
        InputError: wrong shapes, vertices that are not finite, faces that name missing vertices.
    """
    vertices, faces, grid = mesh_arguments(vertices, faces, grid)
    options = options_of(options, SurfaceOptions)
    points, triangles = checked_mesh(vertices, faces, grid)
    words = empty_words(grid)
    tally = np.zeros(3, np.int64)
    for b in range(len(grid)):
        tally[0] = 0
        thin = options.mode == "thin"
        soup = Soup(points[b], triangles, *place(grid, b), thin)
        mark_surface(soup, room(grid), thread_count(), flat(words[b]), tally)
    return Voxels(words, grid, {"pairs": int(tally[1]), "flat": int(tally[2])})


def dominant_axes(vertices: Tensor, faces: Tensor) -> Tensor:
    """(F,) int8 axis in which each triangle's projection is largest (the lowest wins ties), -1 without area."""
    points, triangles = _checked(vertices[None], faces)
    axes = np.zeros(len(triangles), np.int8)
    classify(points[0], triangles, axes)
    return torch.from_numpy(axes)


def checked_mesh(vertices: Tensor, faces: Tensor, grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray]:
    """(B,V,3) float64 and (F,3) int32 for the kernels.

    Raises:
        InputError: as in :func:`voxelize_surface`.
    """
    check_tensor("vertices", vertices, (len(grid), "V", 3))
    return _checked(vertices, faces)


def _checked(vertices: Tensor, faces: Tensor) -> tuple[np.ndarray, np.ndarray]:
    check_tensor("vertices", vertices, ("B", "V", 3))
    check_finite("vertices", vertices)
    check_tensor("faces", faces, ("F", 3))
    if faces.is_floating_point():
        raise InputError(f"faces must be integers, got {faces.dtype}")
    if faces.numel():
        low, high = (int(x) for x in torch.aminmax(faces))
        if low < 0 or high >= vertices.shape[1]:
            raise InputError(f"faces must index {vertices.shape[1]} vertices, got {low} to {high}")
    return view(vertices, np.float64), view(faces, np.int32)


def place(grid: VoxelGrid, batch: int) -> tuple[np.ndarray, float, np.ndarray]:
    """Origin, cells per unit, and nx, ny, nz and bits per row of one grid, for the kernels."""
    dims = np.array([*grid.dims, grid.words * WORD], np.int64)
    return grid.origin[batch].numpy(), 1.0 / float(grid.cell[batch]), dims


def room(grid: VoxelGrid) -> int:
    """Most cells that one triangle can meet: four in each column of its dominant axis, and some."""
    nx, ny, nz = grid.dims
    return 6 * max(nx * ny, ny * nz, nz * nx) + 64
