"""Where voxels lie, and packed sets of them with Boolean operations. Source: specification 05, sections 2 and 7.

Cell (i, j, k) covers ``origin + cell [i, i+1) x [j, j+1) x [k, k+1)``. Dense tensors are (B,nz,ny,nx).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief, brief_html
from torchrender.checks import as_array, check_finite, check_no_gradient, check_range, check_tensor
from torchrender.errors import InputError, OptionError
from torchrender.kernels.voxels.bits import count_ones, count_runs, list_ones

MAX_SIDE = 2048
MAX_CELLS = 2**32
DIMS = (256, 256, 256)
WORD = 64


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """B grids of cubic cells that share their cell counts.

    Raises:
        InputError: wrong shapes, values that are not finite, or cells without size.
        OptionError: a side outside [1, 2048], or more than 2^32 cells.
    """

    origin: Tensor  # (B,3) float64 lowest corner, scene units
    cell: Tensor  # (B,) float64 edge of a cell, scene units
    dims: tuple[int, int, int] = DIMS  # nx, ny, nz

    __repr__ = brief
    _repr_html_ = brief_html

    def __post_init__(self) -> None:
        origin = check_tensor("origin", self.origin, ("B", 3)).detach().double().contiguous()
        cell = check_tensor("cell", self.cell, (origin.shape[0],)).detach().double().contiguous()
        check_finite("origin", origin)
        check_finite("cell", cell)
        if not bool((cell > 0).all()):
            raise InputError(f"cell must be > 0, got {cell.tolist()}")
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "cell", cell)
        object.__setattr__(self, "dims", check_dims(self.dims))

    def __len__(self) -> int:
        return int(self.origin.shape[0])

    def __getitem__(self, index: int) -> VoxelGrid:
        """Grid ``index`` alone."""
        return VoxelGrid(self.origin[index][None], self.cell[index][None], self.dims)

    @property
    def words(self) -> int:
        """64-bit words in a row along x."""
        return -(-self.dims[0] // WORD)

    @property
    def far_corner(self) -> Tensor:
        """(B,3) float64 highest corner."""
        return self.origin + self.cell[:, None] * torch.tensor(self.dims, dtype=torch.float64)

    def centres(self, cells: Tensor, batch: int = 0) -> Tensor:
        """(...,3) float64 centres of cells (...,3) int64 given as i, j, k."""
        return self.origin[batch] + (cells.double() + 0.5) * self.cell[batch]

    def matches(self, other: VoxelGrid) -> bool:
        """Same cells?"""
        same = self.dims == other.dims and len(self) == len(other)
        return same and bool((self.origin == other.origin).all()) and bool((self.cell == other.cell).all())


def check_dims(dims: Sequence[int]) -> tuple[int, int, int]:
    """Three cell counts, checked."""
    counts = tuple(int(d) for d in dims)
    if len(counts) != 3:
        raise OptionError(f"dims must be three cell counts nx, ny, nz, got {tuple(dims)}")
    for d in counts:
        check_range("dims", d, 1, MAX_SIDE)
    if counts[0] * counts[1] * counts[2] > MAX_CELLS:
        raise OptionError(f"dims must give at most {MAX_CELLS} cells, got {counts}")
    return counts[0], counts[1], counts[2]


def make_grid(points: Tensor, dims: Sequence[int] | int = DIMS, pad: int = 2) -> VoxelGrid:
    """Grids around points, with at least ``pad`` free cells on each side, the points' box in the middle.

    Args:
        points: (B,N,3) vertices, or (B,2,3) corners of boxes; N may be 0.
        dims: nx, ny, nz, or one number: cells along the longest side of the first box, the others as many as needed.
        pad: cells; lowered where ``dims`` has no room for it.

    Raises:
        InputError: wrong shape, no set of points, or points that are not finite.
        OptionError: ``dims`` or ``pad`` outside their ranges.
    """
    points = check_tensor("points", as_array("points", points), ("B", "N", 3))
    check_no_gradient("make_grid", points=points)
    check_finite("points", points)
    check_range("pad", pad, 0, 8)
    points = points.detach().double()
    if not len(points):
        raise InputError("points must hold at least one set, got shape " + str(tuple(points.shape)))
    if points.shape[1] == 0:
        points = torch.zeros(points.shape[0], 1, 3, dtype=torch.float64)
    low, high = points.amin(1), points.amax(1)
    size = high - low
    sides = check_dims(_fitting_dims(size[0], int(dims), pad) if isinstance(dims, int | np.integer) else dims)
    counts = torch.tensor(sides, dtype=torch.float64)
    room = torch.clamp(counts - 2 * pad, min=0.5)
    cell = (size / room).amax(dim=1)
    # Points, and boxes without size, get cells of some size.
    floor = 1e-9 * torch.maximum(low.abs(), high.abs()).amax(dim=1)
    cell = torch.where(cell > floor, cell, torch.where(floor > 0, floor, torch.ones_like(cell)))
    origin = (low + high) / 2 - cell[:, None] * counts / 2
    return VoxelGrid(origin, cell, sides)


def _fitting_dims(size: Tensor, longest: int, pad: int) -> tuple[int, int, int]:
    check_range("dims", longest, 1, MAX_SIDE)
    room = max(longest - 2 * pad, 1)
    cell = max(float(size.max()) / room, 1e-300)
    counts = [min(int(np.ceil(float(s) / cell - 1e-9)) + 2 * pad, longest) for s in size]
    return max(counts[0], 1), max(counts[1], 1), max(counts[2], 1)


@dataclass(frozen=True, eq=False)
class Voxels:
    """B sets of cells, one bit each. ``|``, ``&``, ``-`` and ``~`` are union, intersection, difference, complement.

    Raises:
        InputError: words of another shape or type, or an operation on sets of different grids.
    """

    words: Tensor  # (B,nz,ny,nw) int64; cell i of a row is bit i % 64 of word i // 64, bits beyond nx are zero
    grid: VoxelGrid
    stats: dict[str, float] = field(default_factory=dict)  # what making them took and met

    __repr__ = brief
    _repr_html_ = brief_html

    def __post_init__(self) -> None:
        _, ny, nz = self.grid.dims
        check_tensor("words", self.words, (len(self.grid), nz, ny, self.grid.words))
        if self.words.dtype != torch.int64:
            raise InputError(f"words must be int64, got {self.words.dtype}")

    @classmethod
    def empty(cls, grid: VoxelGrid) -> Voxels:
        """No cells."""
        return cls(empty_words(grid), grid)

    @classmethod
    def from_dense(cls, occupied: Tensor, grid: VoxelGrid) -> Voxels:
        """From (B,nz,ny,nx) bool."""
        nx, ny, nz = grid.dims
        check_tensor("occupied", occupied, (len(grid), nz, ny, nx))
        rows = np.zeros((len(grid), nz, ny, grid.words * 8), np.uint8)
        packed = np.packbits(occupied.detach().cpu().bool().numpy(), axis=-1, bitorder="little")
        rows[..., : packed.shape[-1]] = packed
        return cls(torch.from_numpy(rows.view("<u8").astype(np.int64)), grid)

    def dense(self) -> Tensor:
        """(B,nz,ny,nx) bool."""
        rows = np.ascontiguousarray(self.words.numpy()).astype("<i8", copy=False).view(np.uint8)
        bits = np.unpackbits(rows, axis=-1, count=self.grid.dims[0], bitorder="little")
        return torch.from_numpy(bits.view(np.bool_))

    @cached_property
    def counts(self) -> Tensor:
        """(B,) int64 number of cells."""
        return torch.tensor([count_ones(flat(w)) for w in self.words], dtype=torch.int64).reshape(len(self.grid))

    @property
    def count(self) -> int:
        """Number of cells in all B grids."""
        return int(self.counts.sum())

    @property
    def volume(self) -> Tensor:
        """(B,) float64 volume of the cells, scene units."""
        return self.counts.double() * self.grid.cell**3

    @property
    def nbytes(self) -> int:
        """Bytes of memory."""
        return self.words.numel() * 8

    def cells(self, batch: int = 0) -> Tensor:
        """(N,3) int64 i, j, k of the cells of one grid, in the order of memory."""
        return self.indices(self.numbers(batch))

    def numbers(self, batch: int = 0) -> Tensor:
        """(N,) int64 places of the bits of one grid, ascending."""
        words, run = flat(self.words[batch]), self.words.shape[2] * self.words.shape[3]
        counts = np.zeros(self.words.shape[1], np.int64)
        count_runs(words, run, counts)
        numbers = np.zeros(int(counts.sum()), np.int64)
        list_ones(words, run, np.cumsum(counts) - counts, numbers)
        return torch.from_numpy(numbers)

    def indices(self, numbers: Tensor) -> Tensor:
        """(N,3) int64 i, j, k of bits at places (N,)."""
        row = self.grid.words * WORD
        line = numbers // row
        return torch.stack([numbers - line * row, line % self.grid.dims[1], line // self.grid.dims[1]], dim=-1)

    def __getitem__(self, batch: int) -> Voxels:
        """One of the B sets alone."""
        return Voxels(self.words[batch][None], self.grid[batch])

    def __or__(self, other: Voxels) -> Voxels:
        return Voxels(self.words | self._same(other), self.grid)

    def __and__(self, other: Voxels) -> Voxels:
        return Voxels(self.words & self._same(other), self.grid)

    def __sub__(self, other: Voxels) -> Voxels:
        return Voxels(self.words & ~self._same(other), self.grid)

    def __invert__(self) -> Voxels:
        return Voxels(~self.words & row_mask(self.grid), self.grid)

    def equals(self, other: Voxels) -> bool:
        """The same cells of the same grid?"""
        return bool(torch.equal(self.words, self._same(other)))

    def _same(self, other: Voxels) -> Tensor:
        if not isinstance(other, Voxels):
            raise InputError(f"voxels can only be combined with voxels, got {type(other).__name__}")
        if not self.grid.matches(other.grid):
            raise InputError(f"voxels must lie on the same grid, got {self.grid.dims} and {other.grid.dims}")
        return other.words


def empty_words(grid: VoxelGrid) -> Tensor:
    """(B,nz,ny,nw) int64 zeros."""
    _, ny, nz = grid.dims
    return torch.zeros(len(grid), nz, ny, grid.words, dtype=torch.int64)


def row_mask(grid: VoxelGrid) -> Tensor:
    """(nw,) int64: ones where a row has cells."""
    bits = np.arange(grid.words * WORD) < grid.dims[0]
    return torch.from_numpy(np.packbits(bits, bitorder="little").view("<u8").astype(np.int64))


def flat(words: Tensor) -> np.ndarray:
    """One grid's words as a flat uint64 view."""
    view: np.ndarray = words.numpy().view(np.uint64).reshape(-1)
    return view
