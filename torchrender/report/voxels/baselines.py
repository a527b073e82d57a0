"""Other ways to voxelize, for comparison: three directional sheets stage by stage in torch, slices, layered depths.

Source: specification 05, sections 4 and 10.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from torchrender.checks import check_range
from torchrender.rays import RayCaster
from torchrender.scene.mesh import Geometry
from torchrender.voxels.grid import VoxelGrid, Voxels
from torchrender.voxels.surface import SurfaceOptions, dominant_axes, voxelize_surface


@dataclass(frozen=True, eq=False)
class SheetRun:
    """Thin surface voxels by the source's stages, and the milliseconds that each took."""

    voxels: Voxels
    classify_ms: float
    rasterise_ms: float
    texelize_ms: float
    synthesise_ms: float
    pairs: int  # of triangle and column tested


def three_sheets(vertices: Tensor, faces: Tensor, grid: VoxelGrid, pair_chunk: int = 4_000_000) -> SheetRun:
    """Thin voxels (V,3), (F,3) of one grid: classify, rasterise each group along its axis, texelize, synthesise.

    Raises:
        OptionError: ``pair_chunk`` below 1000.
    """
    check_range("pair_chunk", pair_chunk, 1000)
    clock = [time.perf_counter()]
    corners = ((vertices.double() - grid.origin[0]) / grid.cell[0])[faces.long()]
    axes = dominant_axes(vertices, faces)
    groups = [corners[axes == axis] for axis in range(3)]
    clock.append(time.perf_counter())
    cells, pairs = [], 0
    for axis, group in enumerate(groups):
        # Cyclic coordinates (a, b, c) with c along the axis keep handedness.
        order = [(axis + 1) % 3, (axis + 2) % 3, axis]
        found, tested = _fragments(group[..., order], [grid.dims[o] for o in order], pair_chunk)
        cells.append(found)
        pairs += tested
    clock.append(time.perf_counter())
    sheets = []
    for axis, found in enumerate(cells):
        na, nb, nc = (grid.dims[(axis + k) % 3] for k in (1, 2, 3))
        sheet = torch.zeros(nc * nb * na, dtype=torch.bool)
        sheet[(found[:, 2] * nb + found[:, 1]) * na + found[:, 0]] = True
        sheets.append(sheet.view(nc, nb, na))
    clock.append(time.perf_counter())
    # Axes of a sheet are (c, b, a): (x, z, y), (y, x, z) and (z, y, x).
    whole = sheets[2] | sheets[0].permute(1, 2, 0) | sheets[1].permute(2, 0, 1)
    voxels = Voxels.from_dense(whole[None], grid)
    clock.append(time.perf_counter())
    stages = [1e3 * (after - before) for before, after in pairwise(clock)]
    return SheetRun(voxels, stages[0], stages[1], stages[2], stages[3], pairs)


def _fragments(corners: Tensor, dims: list[int], pair_chunk: int) -> tuple[Tensor, int]:
    """(N,3) cells a, b, c at column centres inside the triangles (F,3,3), and the number of pairs tested."""
    low = (corners[..., :2].amin(1) - 0.5).ceil().long().clamp_min(0)
    high = (corners[..., :2].amax(1) - 0.5).floor().long()
    high = torch.minimum(high, torch.tensor(dims[:2]) - 1)
    size = (high - low + 1).clamp_min(0)
    counts = size[:, 0] * size[:, 1]
    ends = counts.cumsum(0)
    parts, begin = [], 0
    while begin < len(counts):
        before = int(ends[begin - 1]) if begin else 0
        end = max(int(torch.searchsorted(ends, before + pair_chunk, right=True)), begin + 1)
        own = counts[begin:end]
        triangle = torch.repeat_interleave(torch.arange(begin, end), own)
        place = torch.arange(len(triangle)) - torch.repeat_interleave(own.cumsum(0) - own, own)
        columns = low[triangle] + torch.stack([place % size[triangle, 0], place // size[triangle, 0]], dim=1)
        parts.append(_at_columns(corners[triangle], columns, dims[2]))
        begin = end
    return torch.cat(parts) if parts else torch.zeros(0, 3, dtype=torch.int64), int(counts.sum())


def _at_columns(corners: Tensor, columns: Tensor, depth: int) -> Tensor:
    """Cells where the centre line of a column (N,2) meets its triangle (N,3,3)."""
    at = columns.double() + 0.5
    areas = []
    for e in range(3):
        p, q = corners[:, e], corners[:, (e + 1) % 3]
        areas.append((q[:, 0] - p[:, 0]) * (at[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (at[:, 0] - p[:, 0]))
    u, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = torch.linalg.cross(u, w)
    signed = torch.stack(areas) * torch.where(normal[:, 2] > 0, 1.0, -1.0)
    away = at - corners[:, 0, :2]
    z = corners[:, 0, 2] - (normal[:, 0] * away[:, 0] + normal[:, 1] * away[:, 1]) / normal[:, 2]
    z = torch.minimum(torch.maximum(z, corners[..., 2].amin(1)), corners[..., 2].amax(1))
    cells = torch.cat([columns, z.floor().long()[:, None]], dim=1)
    return cells[(signed >= 0).all(dim=0) & (cells[:, 2] >= 0) & (cells[:, 2] < depth)]


def slices(vertices: Tensor, faces: Tensor, grid: VoxelGrid) -> Voxels:
    """Thin voxels by drawing all triangles once for every z slice, with the same kernel."""
    nx, ny, nz = grid.dims
    words = torch.zeros(1, nz, ny, grid.words, dtype=torch.int64)
    step = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    for k in range(nz):
        layer = VoxelGrid(grid.origin + k * grid.cell[:, None] * step, grid.cell, (nx, ny, 1))
        words[:, k] = voxelize_surface(vertices[None], faces, layer, SurfaceOptions(mode="thin")).words[:, 0]
    return Voxels(words, grid)


def layered_depths(geometry: Geometry, grid: VoxelGrid) -> Voxels:
    """Solid by rays along z through the centres of columns: all depths of a column, filled between pairs."""
    nx, ny, nz = grid.dims
    j, i = torch.meshgrid(torch.arange(ny), torch.arange(nx), indexing="ij")
    start = grid.origin[0] + torch.stack([i + 0.5, j + 0.5, torch.full_like(i, -1)], dim=-1).double() * grid.cell[0]
    origins = start.reshape(-1, 3)
    toward = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand_as(origins)
    changes = torch.zeros(nz + 1, ny * nx, dtype=torch.int32)
    caster = RayCaster(geometry)
    rows = torch.arange(len(origins))
    hits = caster.first_hit(origins, toward)
    while len(rows):
        hit = hits.triangle >= 0
        rows, t, triangle = rows[hit], hits.t[hit], hits.triangle[hit]
        k = (t / grid.cell[0] - 1.5).ceil().long().clamp(0, nz)
        changes.view(-1).index_add_(0, k * (ny * nx) + rows, torch.ones(len(rows), dtype=torch.int32))
        if not len(rows):
            break
        hits = caster.next_hit(origins[rows], toward[rows], t, triangle)
    inside = changes[:nz].cumsum(0) % 2 == 1
    return Voxels.from_dense(inside.reshape(1, nz, ny, nx), grid)
