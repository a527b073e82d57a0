"""Solid voxels: cells whose centres lie inside a mesh. Source: specification 05, section 5.

Crossings of the surface with the centre lines of cell columns are counted exactly in integers, so the solid of a closed
mesh has no stray lines and no leaks. Open meshes are reported, never silently filled.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TypeAlias, overload

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_choice, check_range, checked_fields, options_of
from torchrender.errors import InputError, LeakWarning
from torchrender.kernels.compile import thread_count
from torchrender.kernels.voxels import columns as columns
from torchrender.kernels.voxels.bits import spread_across, spread_planes
from torchrender.scene.smooth import weld
from torchrender.scene.triangles import Shape
from torchrender.voxels.grid import WORD, VoxelGrid, Voxels, empty_words, flat, row_mask
from torchrender.voxels.mesh_arguments import mesh_arguments
from torchrender.voxels.soup import soup_words
from torchrender.voxels.surface import SurfaceOptions, checked_mesh, voxelize_surface

METHODS = ("winding", "parity", "vote", "soup", "toggle")
AXES = ("x", "y", "z")
Solid: TypeAlias = "tuple[Voxels, SolidReport]"
FARTHEST = 1 << 30
"""Vertices must lie within this many snapped units of the grid's origin."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SolidOptions:
    """How the inside is found.

    ``winding``: winding number not zero; overlapping parts unite. ``parity``: odd number of crossings; nested shells
    are cavities, orientation does not matter. ``vote``: majority of three axes without the columns that leak, for
    meshes with small holes. ``soup``: the surface covers more than half of what the centre sees (generalised winding
    number), for triangles that do not join; slow. ``toggle``: the source's fill of surface voxels, which fails; kept
    for comparison.

    Raises:
        OptionError: a value outside its range.
    """

    method: str = "winding"
    axis: str = "z"  # of the columns, for winding and parity
    subbits: int = 8  # vertices are snapped to 2^-subbits of a cell
    surface: bool = False  # also the cells that the surface meets
    warn: bool = True  # tell of columns that leak

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        check_choice("axis", self.axis, AXES)
        check_range("subbits", self.subbits, 4, 10)


@dataclass(frozen=True)
class SolidReport:
    """What was wrong with the mesh, by axis."""

    odd: dict[str, int] = field(default_factory=dict)  # columns with an odd number of crossings
    unbalanced: dict[str, int] = field(default_factory=dict)  # columns whose winding number ends other than at zero
    crossed: dict[str, int] = field(default_factory=dict)  # columns that the mesh crosses
    leaking: dict[str, int] = field(default_factory=dict)  # columns that are either
    closed: bool = True  # no edge of a face is left over, so that inside and outside are well defined everywhere
    duplicates: int = 0  # doubled faces that were left out
    unknown: int = 0  # cells that no axis could decide, found by filling from the border

    @property
    def leaking_share(self) -> float:
        """Columns that leak, as a share of those that the mesh crosses."""
        return sum(self.leaking.values()) / max(sum(self.crossed.values()), 1)


@dataclass(frozen=True, eq=False)
class _Fill:
    """The solid of one grid by one axis."""

    words: Tensor  # (nz,ny,nw)
    faults: np.ndarray  # (nb,na) uint8
    crossed: int


@overload
def voxelize_solid(
    vertices: Tensor, faces: Tensor, grid: VoxelGrid | int, options: SolidOptions | None = None
) -> Solid: ...
@overload
def voxelize_solid(shape: Shape, grid: VoxelGrid | int, /, *, options: SolidOptions | None = None) -> Solid: ...
def voxelize_solid(
    vertices: Tensor | Shape,
    faces: Tensor | VoxelGrid | int,
    grid: VoxelGrid | int | None = None,
    options: SolidOptions | None = None,
) -> Solid:
    """Cells with their centre inside the mesh, and what was wrong with it: ``voxelize_solid(mesh, 128)``.

    Arguments and errors as in :func:`~torchrender.voxels.surface.voxelize_surface`. Vertices are snapped to
    2^-subbits of a cell; farther than 2^(30 - subbits) cells from the grid is an InputError, too.

    Warns:
        LeakWarning: with the share of columns that leak, or that none does although the mesh is open.
    """
    vertices, faces, grid = mesh_arguments(vertices, faces, grid)
    options = options_of(options, SolidOptions)
    points, triangles = checked_mesh(vertices, faces, grid)
    words = empty_words(grid)
    total = SolidReport()
    for b in range(len(grid)):
        if options.method == "toggle":
            words[b] = _toggle(vertices[b][None], faces, grid[b])
            continue
        words[b], report = _solid(points[b], triangles, grid[b], options)
        total = _joined(total, report)
    solid = Voxels(words, grid)
    if options.surface:
        solid = solid | voxelize_surface(vertices, faces, grid)
    if options.warn and not total.closed:
        _tell(total, options)
    return solid, total


def _tell(report: SolidReport, options: SolidOptions) -> None:
    leaking = sum(report.leaking.values())
    how = f"{100 * report.leaking_share:.2g} % of the columns of cells that it crosses leak"
    how += f" ({leaking} of {sum(report.crossed.values())}) and are "
    how += "decided by the other axes" if options.method == "vote" else 'wrong; method="vote" closes small holes'
    if options.method == "soup":
        how = "cells are inside where it covers more than half of what they see"
    elif not leaking:
        how = "edges belong to one face alone; no column of these cells leaks"
    warnings.warn(f"the mesh is not closed: {how}", LeakWarning, stacklevel=3)


def _snapped(points: np.ndarray, grid: VoxelGrid, subbits: int) -> np.ndarray:
    """Vertices in units of 2^-subbits cell, from the origin of the grid."""
    snapped = np.zeros(points.shape, np.int64)
    scale = (1 << subbits) / float(grid.cell[0])
    far = columns.snap(points, grid.origin[0].numpy(), scale, float(FARTHEST), snapped)
    if far > FARTHEST:
        limit, found = FARTHEST >> subbits, far / (1 << subbits)
        raise InputError(f"vertices must lie within {limit} cells of the grid's origin, one is {found:.3g} away")
    return snapped


def _solid(points: np.ndarray, faces: np.ndarray, grid: VoxelGrid, options: SolidOptions) -> tuple[Tensor, SolidReport]:
    """One grid by winding, parity, vote or soup."""
    axes = (0, 1, 2) if options.method == "vote" else (AXES.index(options.axis),)
    snapped = _snapped(points, grid, options.subbits)
    kept, closed = _sound_faces(snapped, faces, options.method == "parity")
    if options.method == "soup":
        return soup_words(points, kept, grid), SolidReport(closed=closed, duplicates=len(faces) - len(kept))
    fills = {axis: _fill(snapped, kept, grid, axis, options) for axis in axes}
    if closed and any(f.crossed for f in fills.values()) and not any(bool(f.words.any()) for f in fills.values()):
        # A model whose every face is there both ways round cancels itself.
        single = _without_doubles(snapped, kept)
        if len(single) < len(kept) and _closed(snapped, single, options.method == "parity"):
            kept, fills = single, {axis: _fill(snapped, single, grid, axis, options) for axis in axes}
    unknown = 0
    words = fills[axes[0]].words
    if options.method == "vote":
        words, undecided = _vote(fills, grid)
        unknown = Voxels(undecided[None], grid).count
        if unknown:
            words = words | _enclosed(undecided, words, points, faces, grid)
    return words, _report(fills, closed, len(faces) - len(kept), unknown)


def _sound_faces(snapped: np.ndarray, faces: np.ndarray, parity: bool) -> tuple[np.ndarray, bool]:
    """The faces, without doubled ones where those are in the way, and whether they are closed.

    Equal faces cancel in parity. In winding numbers they leave edges over, so that most meshes need no search.
    """
    kept = _without_doubles(snapped, faces, turned=False) if parity else faces
    if _closed(snapped, kept, parity):
        return kept, True
    single = _without_doubles(snapped, faces)
    if len(single) < len(kept) and _closed(snapped, single, parity):
        return single, True
    return kept, False


def _closed(snapped: np.ndarray, faces: np.ndarray, parity: bool) -> bool:
    """Is no edge left over? For parity the directions of faces do not count."""
    sums = np.zeros((-(-len(faces) // columns.BLOCK), 2), np.uint64)
    columns.boundary(snapped, faces, np.zeros(len(snapped), np.uint64), sums)
    left = np.bitwise_xor.reduce(sums[:, 1]) if parity else sums[:, 0].sum(dtype=np.uint64)
    return int(left) == 0


def _fill(snapped: np.ndarray, faces: np.ndarray, grid: VoxelGrid, axis: int, options: SolidOptions) -> _Fill:
    """Crossings along one axis, and the cells between them."""
    across = [grid.dims[a] for a in range(3) if a != axis]
    size = (across[0], across[1], grid.dims[axis])
    threads = thread_count()
    counts, hits = np.zeros(across[0] * across[1], np.int64), np.zeros(len(faces), np.bool_)
    where = columns.Columns(snapped, faces, axis, options.subbits, *size)
    nothing = np.zeros(0, np.int32)
    columns.find_crossings(where, threads, hits, counts, nothing, np.zeros(1, np.int64))
    starts = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=starts[1:])
    events = np.zeros(starts[-1], np.int32)
    if len(events):
        columns.find_crossings(where, threads, hits, starts[:-1].copy(), events, np.zeros(1, np.int64))
    faults = np.zeros(len(counts), np.uint8)
    columns.column_runs(events, starts, options.method == "parity", size[2], faults)
    words = torch.zeros(grid.dims[2], grid.dims[1], grid.words, dtype=torch.int64)
    _set_between(events, starts, axis, size, words)
    return _Fill(words, faults.reshape(across[1], across[0]), int((counts > 0).sum()))


def _set_between(events: np.ndarray, starts: np.ndarray, axis: int, size: tuple[int, int, int], words: Tensor) -> None:
    nz, ny, nw = words.shape
    if axis == 0:
        columns.fill_rows(events, starts, size[2], words.numpy().view(np.uint64).reshape(-1, nw))
        return
    steps = (ny * nw, nw) if axis == 1 else (nw, ny * nw)
    columns.toggle_columns(events, starts, size[:2], steps, flat(words))
    shape = (nz, ny, nw) if axis == 1 else (1, nz, ny * nw)
    columns.run_along(words.numpy().view(np.uint64).reshape(shape))


def _faulty(fill: _Fill) -> int:
    return int((fill.faults > 0).sum())


def _without_doubles(snapped: np.ndarray, faces: np.ndarray, turned: bool = True) -> np.ndarray:
    """Each set of three corner positions once; the first face stays. ``turned``: also faces the other way round."""
    _, at = weld(snapped)
    a, b, c = at[faces].T
    corners = np.sort(at[faces], axis=1)
    if not turned:
        handed = ((a > b) ^ (a > c) ^ (b > c)).astype(corners.dtype)
        corners = np.concatenate([corners, handed[:, None]], axis=1)
    order = np.lexsort(corners.T[::-1])
    ordered = corners[order]
    repeated = np.zeros(len(faces), np.bool_)
    repeated[order[1:]] = (ordered[1:] == ordered[:-1]).all(axis=1)
    return np.ascontiguousarray(faces[~repeated])


def _known(fill: _Fill, axis: int, grid: VoxelGrid) -> Tensor:
    """Ones where the column of a cell does not leak, as words that broadcast against (nz,ny,nw)."""
    good = torch.from_numpy(fill.faults == 0)
    if axis == 0:
        return torch.where(good, -1, 0)[..., None] & row_mask(grid)
    flat_grid = VoxelGrid(grid.origin, grid.cell, (grid.dims[0], good.shape[0], 1))
    rows = Voxels.from_dense(good[None, None], flat_grid).words[0, 0]
    return rows[:, None] if axis == 1 else rows[None]


def _vote(fills: dict[int, _Fill], grid: VoxelGrid) -> tuple[Tensor, Tensor]:
    """Cells inside by the majority of the columns that do not leak (two must agree), and cells without any vote."""
    known = [_known(fill, axis, grid) for axis, fill in fills.items()]
    a, b, c = (fill.words & k for fill, k in zip(fills.values(), known, strict=True))
    outside = torch.zeros_like(a)
    for fill, k in zip(fills.values(), known, strict=True):
        outside |= ~fill.words & k
    inside = (a & b) | (b & c) | (a & c) | ((a | b | c) & ~outside)
    voted = known[0] | known[1] | known[2]
    return inside, ~voted & row_mask(grid)


def _enclosed(unknown: Tensor, inside: Tensor, points: np.ndarray, faces: np.ndarray, grid: VoxelGrid) -> Tensor:
    """Undecided cells that cannot be reached from the border of the grid through cells outside and off the surface."""
    shell = voxelize_surface(torch.from_numpy(points)[None], torch.from_numpy(faces), grid).words[0]
    free = ~(shell | inside) & row_mask(grid)
    return unknown & ~flood(free, grid.dims[0])


def flood(free: Tensor, nx: int) -> Tensor:
    """(nz,ny,nw) bits of ``free`` that are connected, over faces of cells, to the border of a grid nx cells wide."""
    nz, ny, _ = free.shape
    reached = torch.zeros_like(free)
    for side in (0, -1):
        reached[side] = free[side]
        reached[:, side] = free[:, side]
    bits, free_bits = reached.numpy().view(np.uint64), free.numpy().view(np.uint64)
    bits[:, :, 0] |= free_bits[:, :, 0] & np.uint64(1)
    bits[:, :, -1] |= free_bits[:, :, -1] & (np.uint64(1) << np.uint64((nx - 1) % WORD))
    in_planes, across = np.ones(nz, np.bool_), np.ones(ny, np.bool_)
    while in_planes.any() or across.any():
        spread_planes(bits, free_bits, in_planes)
        spread_across(bits, free_bits, across)
    return reached


def _toggle(vertices: Tensor, faces: Tensor, grid: VoxelGrid) -> Tensor:
    """The source's fill: a flag that toggles at every surface voxel of a line, along three axes, joined."""
    cells = voxelize_surface(vertices, faces, grid, SurfaceOptions(mode="thin")).dense()[0]
    filled = cells.clone()
    for axis in range(3):
        filled |= cells.to(torch.uint8).cumsum(dim=axis) % 2 == 1
    return Voxels.from_dense(filled[None], grid).words[0]


def _report(fills: dict[int, _Fill], closed: bool, duplicates: int, unknown: int) -> SolidReport:
    named = {AXES[axis]: fill for axis, fill in fills.items()}
    return SolidReport(
        odd={name: int((f.faults & 1).sum()) for name, f in named.items()},
        unbalanced={name: int((f.faults >> 1).sum()) for name, f in named.items()},
        crossed={name: f.crossed for name, f in named.items()},
        leaking={name: _faulty(f) for name, f in named.items()},
        closed=closed,
        duplicates=duplicates,
        unknown=unknown,
    )


def _joined(a: SolidReport, b: SolidReport) -> SolidReport:
    def both(x: dict[str, int], y: dict[str, int]) -> dict[str, int]:
        return {name: x.get(name, 0) + y.get(name, 0) for name in {**x, **y}}

    return SolidReport(
        both(a.odd, b.odd),
        both(a.unbalanced, b.unbalanced),
        both(a.crossed, b.crossed),
        both(a.leaking, b.leaking),
        a.closed and b.closed,
        a.duplicates + b.duplicates,
        a.unknown + b.unknown,
    )
