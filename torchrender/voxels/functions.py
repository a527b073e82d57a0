"""Voxels of implicit and parametric surfaces. Source: specification 05, section 7."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import check_choice, check_finite, check_no_gradient, check_range
from torchrender.errors import InputError
from torchrender.voxels.grid import VoxelGrid, Voxels

KINDS = ("solid", "surface", "corners")
COARSE = 16  # parameter cells per side from which refinement starts
STEP = 0.5  # cells that neighbouring samples may be apart


def voxelize_implicit(function: Callable[[Tensor], Tensor], grid: VoxelGrid, kind: str = "solid") -> Voxels:
    """Cells of ``f(points) <= 0``, or of the surface where f changes its sign.

    Args:
        function: maps (P,3) float64 points, scene units, to (P,) values. Called once for each z slice.
        grid: B grids.
        kind: ``solid``: f <= 0 at the centre; ``surface``: solid cells with one of six neighbours outside;
            ``corners``: the eight corners do not agree.

    Raises:
        InputError: values of another shape, or NaN.
        OptionError: an unknown kind.
    """
    check_choice("kind", kind, KINDS)
    corners = kind == "corners"
    inside = torch.stack([_inside(function, grid, b, corners) for b in range(len(grid))])
    if corners:
        found, every = inside, inside
        for axis in (1, 2, 3):
            n = inside.shape[axis] - 1
            found = found.narrow(axis, 0, n) | found.narrow(axis, 1, n)
            every = every.narrow(axis, 0, n) & every.narrow(axis, 1, n)
        return Voxels.from_dense(found & ~every, grid)
    solid = Voxels.from_dense(inside, grid)
    return solid if kind == "solid" else solid - Voxels.from_dense(_interior(inside), grid)


def _inside(function: Callable[[Tensor], Tensor], grid: VoxelGrid, batch: int, corners: bool) -> Tensor:
    """(nz,ny,nx) bool; one more along each axis for corners."""
    more, shift = (1, 0.0) if corners else (0, 0.5)
    nx, ny, nz = (d + more for d in grid.dims)
    x, y, z = (
        grid.origin[batch, a] + (torch.arange(n, dtype=torch.float64) + shift) * grid.cell[batch]
        for a, n in enumerate((nx, ny, nz))
    )
    points = torch.zeros(ny, nx, 3, dtype=torch.float64)
    points[..., 0], points[..., 1] = x, y[:, None]
    out = torch.zeros(nz, ny, nx, dtype=torch.bool)
    for k in range(nz):
        points[..., 2] = z[k]
        values = function(points.reshape(-1, 3))
        if not isinstance(values, Tensor) or values.shape != (ny * nx,):
            raise InputError(f"function must return ({ny * nx},) values, got {getattr(values, 'shape', type(values))}")
        check_no_gradient("voxelize_implicit", **{"values of function": values})
        if bool(values.isnan().any()):
            raise InputError(f"function must not return NaN: it did in slice {k}")
        out[k] = (values <= 0).reshape(ny, nx)
    return out


def _interior(inside: Tensor) -> Tensor:
    """Cells whose six neighbours are inside; beyond the grid counts as outside."""
    kept = inside.clone()
    for axis in (1, 2, 3):
        n = inside.shape[axis]
        kept.narrow(axis, 0, n - 1).logical_and_(inside.narrow(axis, 1, n - 1))
        kept.narrow(axis, 1, n - 1).logical_and_(inside.narrow(axis, 0, n - 1))
        kept.select(axis, 0).fill_(False)
        kept.select(axis, n - 1).fill_(False)
    return kept


@dataclass(frozen=True, eq=False)
class ParametricVoxels:
    """Voxels of a parametric surface, and how closely it was sampled."""

    voxels: Voxels
    samples: int
    largest_gap: float  # cells between neighbouring samples along u or v


def voxelize_parametric(
    surface: Callable[[Tensor], Tensor],
    domain: tuple[tuple[float, float], tuple[float, float]],
    grid: VoxelGrid,
    *,
    max_samples: int = 1 << 24,
) -> ParametricVoxels:
    """Cells of the points S(u, v). Samples are refined until neighbours are at most half a cell apart.

    Args:
        surface: maps (P,2) float64 parameters to (P,3) points, scene units; continuous.
        domain: smallest and largest u, smallest and largest v.
        grid: one grid.
        max_samples: refinement stops before it takes more points; ``largest_gap`` then tells.

    Raises:
        InputError: an empty domain, several grids, or points of another shape or not finite.
        OptionError: ``max_samples`` below 1024.
    """
    check_range("max_samples", max_samples, 1024)
    (u0, u1), (v0, v1) = domain
    if not (u1 > u0 and v1 > v0) or len(grid) != 1:
        raise InputError(f"domain must have u1 > u0 and v1 > v0 and grid be one, got {domain} and {len(grid)} grids")
    low, size = torch.tensor([u0, v0]).double(), torch.tensor([u1 - u0, v1 - v0]).double()
    occupied = torch.zeros(1, *reversed(grid.dims), dtype=torch.bool)
    line = torch.arange(COARSE, dtype=torch.float64) / COARSE
    boxes = torch.stack(torch.meshgrid(line, line, indexing="ij"), dim=-1).reshape(-1, 2)
    steps = torch.full((len(boxes), 2), 1.0 / COARSE, dtype=torch.float64)
    samples, largest = 0, 0.0
    offsets = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.5, 0.5]], dtype=torch.float64)
    while len(boxes):
        at = boxes[:, None] + offsets * steps[:, None]
        points = _points(surface, (low + at * size).reshape(-1, 2)).reshape(-1, len(offsets), 3)
        samples += at.shape[0] * len(offsets)
        _mark(points.reshape(-1, 3), grid, occupied)
        along_u, along_v = _gaps(points, float(grid.cell[0]))
        wide = (along_u > STEP) | (along_v > STEP)
        if samples + 10 * int(wide.sum()) > max_samples:
            return ParametricVoxels(
                Voxels.from_dense(occupied, grid), samples, float(torch.maximum(along_u, along_v).amax())
            )
        done = ~wide
        if bool(done.any()):
            largest = max(largest, float(torch.maximum(along_u, along_v)[done].amax()))
        boxes, steps = _split(boxes[wide], steps[wide], (along_u >= along_v)[wide])
    return ParametricVoxels(Voxels.from_dense(occupied, grid), samples, largest)


def _points(surface: Callable[[Tensor], Tensor], uv: Tensor) -> Tensor:
    points = surface(uv)
    if not isinstance(points, Tensor) or points.shape != (len(uv), 3):
        raise InputError(f"surface must return ({len(uv)}, 3) points, got {getattr(points, 'shape', type(points))}")
    check_no_gradient("voxelize_parametric", **{"points of surface": points})
    return check_finite("points of the surface", points.double())


def _gaps(points: Tensor, cell: float) -> tuple[Tensor, Tensor]:
    """(N,) longest distances in cells between corners of a parameter box along u and v; its middle counts for both."""

    def apart(a: int, b: int) -> Tensor:
        return (points[:, a] - points[:, b]).norm(dim=1) / cell

    # A surface that turns back inside a box shows in its middle.
    bulge = 2 * (points[:, 4] - points[:, :4].mean(dim=1)).norm(dim=1) / cell
    return (torch.maximum(apart(0, 1), apart(2, 3)) + bulge, torch.maximum(apart(0, 2), apart(1, 3)) + bulge)


def _split(boxes: Tensor, steps: Tensor, along_u: Tensor) -> tuple[Tensor, Tensor]:
    """Halves of the boxes along u or v."""
    half = torch.where(along_u[:, None], torch.tensor([0.5, 1.0]), torch.tensor([1.0, 0.5])).double()
    shift = torch.where(along_u[:, None], torch.tensor([0.5, 0.0]), torch.tensor([0.0, 0.5])).double()
    steps_now = steps * half
    return torch.cat([boxes, boxes + shift * steps]), torch.cat([steps_now, steps_now])


def _mark(points: Tensor, grid: VoxelGrid, occupied: Tensor) -> None:
    cells = ((points - grid.origin[0]) / grid.cell[0]).floor().long()
    inside = ((cells >= 0) & (cells < torch.tensor(grid.dims))).all(dim=1)
    i, j, k = cells[inside].unbind(-1)
    occupied[0, k, j, i] = True
