"""Grids, packed sets of cells, and worksheets (specification 05, sections 2, 3 and 7)."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError, OptionError
from torchrender.voxels.grid import VoxelGrid, Voxels, check_dims, make_grid
from torchrender.voxels.sheets import BITS, SheetLayout, pack_sheets, sheet_address, unpack_sheets
from voxel_shapes import unit_grid

SIDES = st.tuples(st.integers(1, 140), st.integers(1, 5), st.integers(1, 5))


def random_set(dims: tuple[int, int, int], seed: int, count: int = 2) -> tuple[torch.Tensor, Voxels]:
    generator = torch.Generator().manual_seed(seed)
    dense = torch.rand(count, *reversed(dims), generator=generator) < 0.5
    grid = VoxelGrid(torch.zeros(count, 3), torch.ones(count), dims)
    return dense, Voxels.from_dense(dense, grid)


@settings(deadline=None, max_examples=40)
@given(dims=SIDES, seed=st.integers(0, 1000))
def test_packing_loses_nothing(dims: tuple[int, int, int], seed: int) -> None:
    dense, voxels = random_set(dims, seed)
    assert torch.equal(voxels.dense(), dense)
    assert voxels.counts.tolist() == dense.sum(dim=(1, 2, 3)).tolist()
    for b in range(2):
        cells = voxels.cells(b)
        assert torch.equal(cells, dense[b].nonzero().flip(-1))
        assert torch.equal(voxels[b].dense()[0], dense[b])


@settings(deadline=None, max_examples=40)
@given(dims=SIDES, seed=st.integers(0, 1000))
def test_boolean_operations(dims: tuple[int, int, int], seed: int) -> None:
    """Each equals the operation on dense tensors; De Morgan; counts of union and intersection add up."""
    x, a = random_set(dims, seed)
    y, b = random_set(dims, seed + 1)
    assert torch.equal((a | b).dense(), x | y)
    assert torch.equal((a & b).dense(), x & y)
    assert torch.equal((a - b).dense(), x & ~y)
    assert torch.equal((~a).dense(), ~x)
    assert (~(a | b)).equals(~a & ~b) and (~(a & b)).equals(~a | ~b)
    assert (a | b).count + (a & b).count == a.count + b.count
    assert (~a).count + a.count == x.numel()  # padding bits stay zero


def test_memory_of_512_cubed_is_16_mib() -> None:
    assert Voxels.empty(unit_grid(512)).nbytes == 16 * 2**20


def test_sets_of_different_grids_do_not_mix() -> None:
    with pytest.raises(InputError, match="same grid"):
        Voxels.empty(unit_grid(8)) | Voxels.empty(unit_grid(9))
    moved = VoxelGrid(torch.ones(1, 3), torch.ones(1), (8, 8, 8))
    with pytest.raises(InputError, match="same grid"):
        Voxels.empty(unit_grid(8)).equals(Voxels.empty(moved))
    two = VoxelGrid(torch.zeros(2, 3), torch.ones(2), (8, 8, 8))
    assert two.matches(VoxelGrid(two.origin.clone(), two.cell.clone(), (8, 8, 8)))
    shifted = two.origin + torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for other in (VoxelGrid(shifted, two.cell, (8, 8, 8)), VoxelGrid(two.origin, torch.tensor([1.0, 2.0]), (8, 8, 8))):
        assert not two.matches(other), "one of several differs"


def test_as_many_cells_as_the_limit_are_taken() -> None:
    assert check_dims((2048, 2048, 1024)) == (2048, 2048, 1024)
    with pytest.raises(OptionError, match="at most"):
        check_dims((2048, 2048, 1025))


def test_grid_fits_points_with_padding() -> None:
    points = torch.tensor([[[0.0, 0.0, 0.0], [4.0, 2.0, 1.0]], [[0.0, 0.0, 0.0], [1.0, 9.0, 1.0]]])
    grid = make_grid(points, (32, 16, 64), pad=2)
    inside = (points.double() - grid.origin[:, None]) / grid.cell[:, None, None]
    assert bool((inside >= 2 - 1e-9).all()) and bool((inside <= torch.tensor([30.0, 14.0, 62.0]) + 1e-9).all())
    assert torch.allclose((grid.origin + grid.far_corner) / 2, points.double().mean(dim=1))


def test_one_number_gives_cubic_cells_and_as_many_as_needed() -> None:
    grid = make_grid(torch.tensor([[[0.0, 0.0, 0.0], [4.0, 2.0, 0.0]]]), 100, pad=2)
    assert grid.dims == (100, 52, 4) and float(grid.cell[0]) == pytest.approx(4 / 96)


@pytest.mark.parametrize("points", [torch.zeros(1, 0, 3), torch.full((1, 4, 3), 7.0), torch.full((1, 1, 3), 1e30)])
def test_grid_of_nothing_or_one_point(points: torch.Tensor) -> None:
    grid = make_grid(points, 16)
    assert bool((grid.cell > 0).all()) and bool(torch.isfinite(grid.far_corner).all())
    assert bool((grid.far_corner > grid.origin).all())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: make_grid(torch.full((1, 2, 3), float("nan"))), "points must be finite"),
        (lambda: make_grid(torch.zeros(2, 3)), "points must have shape"),
        (lambda: make_grid(torch.zeros(1, 2, 3), 0), r"dims must be in \[1, 2048\]"),
        (lambda: make_grid(torch.zeros(1, 2, 3), (8, 8)), "three cell counts"),
        (lambda: make_grid(torch.zeros(1, 2, 3), 8, pad=9), "pad must be"),
        (lambda: VoxelGrid(torch.zeros(1, 3), torch.zeros(1), (2, 2, 2)), "cell must be > 0"),
        (lambda: VoxelGrid(torch.zeros(1, 3), torch.ones(1), (2048, 2048, 2048)), "at most"),
        (lambda: Voxels(torch.zeros(1, 2, 2, 1, dtype=torch.int32), unit_grid(2)), "int64"),
        (lambda: Voxels.from_dense(torch.zeros(1, 2, 2, 3), unit_grid(2)), "occupied must have shape"),
        (lambda: SheetLayout(dims=(12, 8, 8)), "nx must be a power of two"),
        (lambda: SheetLayout(dims=(8, 8, 8), bits=4), "bits must be one of"),
        (lambda: SheetLayout(dims=(64, 8, 8), width=32), "width must be >= 64"),
        (lambda: sheet_address(SheetLayout(dims=(8, 8, 8)), torch.tensor([0, 0, 8])), "voxels must lie in"),
        (lambda: pack_sheets(torch.full((1, 8, 8, 8), 2), SheetLayout(dims=(8, 8, 8))), "values in"),
    ],
)
def test_wrong_input_is_named(call: object, message: str) -> None:
    with pytest.raises((InputError, OptionError), match=message):
        call()  # type: ignore[operator]


# ------------------------------------------------------------------- sheets


def test_address_of_the_worked_example() -> None:
    layout = SheetLayout(dims=(512, 512, 512))
    at = sheet_address(layout, torch.tensor([100, 200, 300]))
    assert [int(v) for v in (at.sheet, at.x, at.y, at.channel, at.bit)] == [0, 612, 1224, 1, 4]
    assert layout.sheets * layout.width * layout.height * 4 == 16 * 2**20


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("width", [32, 64])
def test_sheets_give_back_what_was_packed(bits: int, width: int) -> None:
    layout = SheetLayout(dims=(16, 8, 64), bits=bits, width=width, height=16)
    values = torch.randint(0, 1 << bits, (2, 64, 8, 16), generator=torch.Generator().manual_seed(bits))
    sheets = pack_sheets(values, layout)
    assert sheets.shape == (2, layout.sheets, 16, width, 4) and sheets.dtype == torch.uint8
    assert torch.equal(unpack_sheets(sheets, layout), values)
    if bits > 1:
        assert layout.sheets > 1
    # Every voxel lies where its address says.
    for voxel in torch.randint(0, 8, (20, 3), generator=torch.Generator().manual_seed(1)):
        at = sheet_address(layout, voxel)
        whole = 0
        for byte in range(max(bits // 8, 1)):
            whole |= int(sheets[0, at.sheet, at.y, at.x, at.channel + byte]) << (8 * byte)
        i, j, k = voxel.tolist()
        assert (whole >> int(at.bit)) & ((1 << bits) - 1) == int(values[0, k, j, i])


def test_fewer_slices_than_a_texel_holds() -> None:
    layout = SheetLayout(dims=(8, 8, 4), width=8, height=8)
    values = torch.rand(1, 4, 8, 8, generator=torch.Generator().manual_seed(0)) < 0.5
    assert torch.equal(unpack_sheets(pack_sheets(values, layout), layout).bool(), values)
