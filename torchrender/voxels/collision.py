"""Collision of two bodies by the voxels that they share. Source: specification 05, section 8."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import check_no_gradient, check_range, check_tensor, checked_fields, options_of
from torchrender.errors import InputError
from torchrender.scene.mesh import Geometry
from torchrender.scene.triangles import Shape, geometry_of
from torchrender.voxels.grid import MAX_SIDE, VoxelGrid, Voxels
from torchrender.voxels.solid import SolidOptions, voxelize_solid
from torchrender.voxels.surface import voxelize_surface

FINEST = 64  # times finer than the smaller body over the resolution: where bodies touch in a point
FARTHEST_CELL = 2**21  # cells that the larger body may be long


@dataclass(frozen=True, kw_only=True)
@checked_fields
class CollisionOptions:
    """``resolution``: cells along the longest side of the region where the bodies' boxes overlap.

    Raises:
        OptionError: a value outside its range.
    """

    resolution: int = 128
    cell: float | None = None  # edge of a cell, scene units; None: from the resolution
    solid: bool = True  # the insides meet, too; False: only the surfaces

    def __post_init__(self) -> None:
        check_range("resolution", self.resolution, 1, MAX_SIDE)
        if self.cell is not None:
            check_range("cell", self.cell, 1e-300)


@dataclass(frozen=True, eq=False)
class Collision:
    """Where two bodies share voxels.

    Contacts are never missed: cells that the surfaces touch count. Bodies are reported to touch while a gap of less
    than sqrt(3) cells is between them.
    """

    touching: bool
    count: int  # shared voxels
    bounds: Tensor  # (2,3) float64 box of the shared voxels, scene units; zeros if there are none
    centroid: Tensor | None  # (3,) float64 of the shared voxels; None if there are none
    cells: Tensor  # (N,3) int64 i, j, k
    shared: Voxels | None  # None where the boxes of the bodies are apart

    __repr__ = brief

    def __bool__(self) -> bool:
        return self.touching

    @property
    def cell(self) -> float:
        """Edge of a voxel, scene units; zero where the boxes are apart."""
        return 0.0 if self.shared is None else float(self.shared.grid.cell[0])


def collide(
    first: Shape,
    second: Shape,
    options: CollisionOptions | None = None,
    *,
    world_from_first: Tensor | None = None,
    world_from_second: Tensor | None = None,
) -> Collision:
    """Voxels that both bodies meet or hold, on a grid fitted to the overlap of their boxes.

    Args:
        first, second: scenes, meshes or triangles; closed where their insides are to count.
        world_from_first, world_from_second: (4,4) placement.

    Raises:
        InputError: placements of another shape, not finite or not affine.

    Warns:
        LeakWarning: a body is not closed.
    """
    options = options_of(options, CollisionOptions)
    check_no_gradient("collide", world_from_first=world_from_first, world_from_second=world_from_second)
    first, second = geometry_of("first", first), geometry_of("second", second)
    bodies = [
        (_placed("world_from_first", first, world_from_first), first.faces),
        (_placed("world_from_second", second, world_from_second), second.faces),
    ]
    if not first.triangle_count or not second.triangle_count:
        return _apart()
    boxes = [_box(vertices, faces) for vertices, faces in bodies]
    low, high = torch.maximum(boxes[0][0], boxes[1][0]), torch.minimum(boxes[0][1], boxes[1][1])
    if bool((low > high).any()):
        return _apart()
    grid = _grid(low, high, [float((box[1] - box[0]).max()) for box in boxes], options)
    sets = [_occupied(vertices, faces, grid, options) for vertices, faces in bodies]
    shared = sets[0] & sets[1]
    cells = shared.cells()
    if not len(cells):
        return _apart(shared)
    corners = grid.origin[0] + torch.stack([cells.amin(0), cells.amax(0) + 1]).double() * grid.cell[0]
    return Collision(True, len(cells), corners, grid.centres(cells).mean(dim=0), cells, shared)


def _apart(shared: Voxels | None = None) -> Collision:
    nothing = torch.zeros(2, 3, dtype=torch.float64)
    return Collision(False, 0, nothing, None, torch.zeros(0, 3, dtype=torch.int64), shared)


def _placed(name: str, body: Geometry, matrix: Tensor | None) -> Tensor:
    if matrix is None:
        return body.vertices
    check_tensor(name, matrix, (4, 4))
    m = matrix.detach().double()
    if not bool(torch.isfinite(m).all()) or bool((m[3] != torch.tensor([0, 0, 0, 1.0], dtype=torch.float64)).any()):
        raise InputError(f"{name} must be finite with the last row 0, 0, 0, 1, got {m.tolist()}")
    return body.vertices @ m[:3, :3].T + m[:3, 3]


def _box(vertices: Tensor, faces: Tensor) -> Tensor:
    used = vertices[faces.reshape(-1).long()]
    return torch.stack([used.amin(0), used.amax(0)])


def _grid(low: Tensor, high: Tensor, sizes: Sequence[float], options: CollisionOptions) -> VoxelGrid:
    """Cells over the overlap, one more on each side; where bodies only touch, of some size."""
    size, cell = high - low, options.cell
    if cell is None:
        coarsest = max(min(sizes) / (FINEST * options.resolution), max(sizes) / FARTHEST_CELL)
        cell = max(float(size.max()) / max(options.resolution - 2, 1), coarsest, 1e-300)
    counts = [int(n) for n in (size / cell - 1e-9).ceil() + 2]
    centre = (low + high) / 2 - cell * torch.tensor(counts, dtype=torch.float64) / 2
    return VoxelGrid(centre[None], torch.tensor([cell], dtype=torch.float64), (counts[0], counts[1], counts[2]))


def _occupied(vertices: Tensor, faces: Tensor, grid: VoxelGrid, options: CollisionOptions) -> Voxels:
    if not options.solid:
        return voxelize_surface(vertices[None], faces, grid)
    return voxelize_solid(vertices[None], faces, grid, SolidOptions(surface=True))[0]
