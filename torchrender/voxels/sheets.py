"""Voxels in 2D integer images ("worksheets"). Source: specification 05, section 3.

A texel has four 8-bit channels and holds C = 32 / bits voxels that follow one another in z. The sheet is cut into
patches as large as one z slice; each patch holds one slab of C slices, patches row after row, sheets one after another.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import check_range, check_tensor
from torchrender.errors import InputError, OptionError

BITS = (1, 8, 16, 32)


@dataclass(frozen=True, kw_only=True)
class SheetLayout:
    """Sizes, all powers of two.

    Raises:
        OptionError: another number of bits, sides that are not powers of two, or a slice larger than the sheet.
    """

    dims: tuple[int, int, int]  # nx, ny, nz
    bits: int = 1  # per voxel
    width: int = 2048  # texels of a sheet
    height: int = 2048

    def __post_init__(self) -> None:
        if self.bits not in BITS:
            raise OptionError(f"bits must be one of {BITS}, got {self.bits}")
        for name, side in (
            *zip(("nx", "ny", "nz"), self.dims, strict=True),
            ("width", self.width),
            ("height", self.height),
        ):
            if side < 1 or side & (side - 1):
                raise OptionError(f"{name} must be a power of two, got {side}")
        check_range("width", self.width, self.dims[0])
        check_range("height", self.height, self.dims[1])

    @property
    def per_texel(self) -> int:
        """Voxels in one texel: C."""
        return 32 // self.bits

    @property
    def patches(self) -> tuple[int, int]:
        """Patches across and down one sheet."""
        return self.width // self.dims[0], self.height // self.dims[1]

    @property
    def slabs(self) -> int:
        """Slabs of C slices; the last one may be partly empty."""
        return -(-self.dims[2] // self.per_texel)

    @property
    def sheets(self) -> int:
        """Sheets needed."""
        across, down = self.patches
        return -(-self.slabs // (across * down))


@dataclass(frozen=True, eq=False)
class SheetAddress:
    """Where voxels are stored; int64 tensors of one shape."""

    sheet: Tensor
    x: Tensor  # texel column
    y: Tensor  # texel row
    channel: Tensor
    bit: Tensor  # lowest bit within the channel


def sheet_address(layout: SheetLayout, voxels: Tensor) -> SheetAddress:
    """Addresses of voxels (...,3) given as px, py, pz.

    Raises:
        InputError: a voxel outside the grid.
    """
    px, py, pz = voxels.long().unbind(-1)
    top = torch.tensor(layout.dims)
    if voxels.numel() and bool(((voxels < 0) | (voxels >= top)).any()):
        raise InputError(f"voxels must lie in [0, {layout.dims}), got {voxels.amin().item()} to {voxels.amax().item()}")
    across, down = layout.patches
    slab, offset = pz // layout.per_texel, pz % layout.per_texel
    patch = slab % (across * down)
    first = offset * layout.bits
    x = (patch % across) * layout.dims[0] + px
    y = (patch // across) * layout.dims[1] + py
    return SheetAddress(slab // (across * down), x, y, first // 8, first % 8)


def pack_sheets(dense: Tensor, layout: SheetLayout) -> Tensor:
    """(B,sheets,height,width,4) uint8 from values (B,nz,ny,nx): bool or 0/1 for one bit, else integers below 2^bits.

    Raises:
        InputError: another shape, or values that do not fit.
    """
    nx, ny, nz = layout.dims
    check_tensor("dense", dense, ("B", nz, ny, nx))
    values = dense.long()
    if values.numel() and (int(values.min()) < 0 or int(values.max()) >= 1 << layout.bits):
        raise InputError(f"dense must hold values in [0, 2^{layout.bits})")
    count, per_texel = dense.shape[0], layout.per_texel
    across, down = layout.patches
    slabs = values.new_zeros(count, layout.sheets * across * down * per_texel, ny, nx)
    slabs[:, :nz] = values
    slabs = slabs.reshape(count, -1, per_texel, ny, nx)
    weights = torch.tensor([1 << (t * layout.bits) for t in range(per_texel)])[:, None, None]
    words = (slabs * weights).sum(dim=2)  # the bits of different voxels never overlap, so adding is combining
    words = words.reshape(count, layout.sheets, down, across, ny, nx).permute(0, 1, 2, 4, 3, 5)
    words = words.reshape(count, layout.sheets, down * ny, across * nx)
    return torch.stack([(words >> shift) & 255 for shift in (0, 8, 16, 24)], dim=-1).to(torch.uint8)


def unpack_sheets(sheets: Tensor, layout: SheetLayout) -> Tensor:
    """(B,nz,ny,nx) int64 values that :func:`pack_sheets` stored.

    Raises:
        InputError: another shape.
    """
    nx, ny, nz = layout.dims
    across, down = layout.patches
    check_tensor("sheets", sheets, ("B", layout.sheets, down * ny, across * nx, 4))
    channels = sheets.long()
    words = sum((channels[..., c] << (8 * c) for c in range(1, 4)), channels[..., 0])
    words = words.reshape(-1, layout.sheets, down, ny, across, nx).permute(0, 1, 2, 4, 3, 5)
    words = words.reshape(words.shape[0], -1, 1, ny, nx)
    shifts = torch.arange(layout.per_texel)[:, None, None] * layout.bits
    return ((words >> shifts) & ((1 << layout.bits) - 1)).reshape(words.shape[0], -1, ny, nx)[:, :nz]
