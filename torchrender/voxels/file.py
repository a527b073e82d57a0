"""Voxel files: ``.npz`` with everything, and MagicaVoxel ``.vox`` (version 150) for voxel editors."""

from __future__ import annotations

import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import check_class, check_tensor
from torchrender.errors import ImageFileError, InputError, SceneFileError
from torchrender.images.files import write_bytes, write_npz
from torchrender.numerics.color import linear_from_srgb, srgb_from_linear
from torchrender.voxels.attributes import SurfaceVoxels, decode_normals, encode_normals
from torchrender.voxels.grid import VoxelGrid, Voxels

FORMAT = "torchrender.voxels"
ZIP = b"PK"
"""What archives, and so NPZ files, begin with."""

VERSION = 1
KINDS = ("surface", "solid")
VOX_SIDE = 256
_NEEDED = ("format", "version", "kind", "name", "dims", "origin", "cell", "bits")
_ATTRIBUTES = {"normal": 2, "color": 3, "density": 0}


@dataclass(frozen=True, eq=False, kw_only=True)
class VoxelModel:
    """One grid of voxels as files hold it: normals in 16, colours in 24 and densities in 8 bits.

    Raises:
        InputError: several grids, an unknown kind, or attributes of another shape or type.
    """

    voxels: Voxels
    kind: str = "surface"
    name: str = "voxels"
    normal: Tensor | None = None  # (N,2) uint8, see encode_normals; N cells in the order of voxels.cells()
    color: Tensor | None = None  # (N,3) uint8 sRGB
    density: Tensor | None = None  # (N,) uint8

    __repr__ = brief

    def __post_init__(self) -> None:
        if len(self.voxels.grid) != 1:
            raise InputError(f"a file holds one grid, got {len(self.voxels.grid)}")
        if self.kind not in KINDS:
            raise InputError(f"kind must be one of {', '.join(KINDS)}, got {self.kind!r}")
        count = self.voxels.count
        for name, width in _ATTRIBUTES.items():
            value = getattr(self, name)
            if value is not None:
                check_tensor(name, value, (count, width) if width else (count,))
                if value.dtype != torch.uint8:
                    raise InputError(f"{name} must be uint8, got {value.dtype}")

    @classmethod
    def of(cls, surface: SurfaceVoxels, name: str = "voxels") -> VoxelModel:
        """Surface voxels with their attributes in 48 bits."""
        return cls(
            voxels=surface.voxels,
            name=name,
            normal=encode_normals(surface.normal),
            color=(srgb_from_linear(surface.color.clamp(0, 1)) * 255 + 0.5).to(torch.uint8),
            density=(surface.density * 255 + 0.5).to(torch.uint8),
        )

    @property
    def linear_color(self) -> Tensor | None:
        """(N,3) float32 linear colour."""
        return None if self.color is None else linear_from_srgb(self.color.float() / 255)

    @property
    def unit_normal(self) -> Tensor | None:
        """(N,3) float32."""
        return None if self.normal is None else decode_normals(self.normal)

    def info(self) -> dict[str, Any]:
        """Counts and sizes as plain values that JSON can hold."""
        grid = self.voxels.grid
        attributes = [name for name in _ATTRIBUTES if getattr(self, name) is not None]
        return {
            "name": self.name,
            "format": f"{FORMAT} {VERSION}",
            "kind": self.kind,
            "cells": list(grid.dims),
            "voxels": self.voxels.count,
            "share": self.voxels.count / (grid.dims[0] * grid.dims[1] * grid.dims[2]),
            "cell_size": float(grid.cell[0]),
            "volume": float(self.voxels.volume[0]),
            "bounds": [grid.origin[0].tolist(), grid.far_corner[0].tolist()],
            "attributes": attributes,
            "packed_bytes": self.voxels.nbytes,
        }


def write_voxels(path: str | Path, model: VoxelModel | SurfaceVoxels | Voxels) -> None:
    """Write ``.npz`` or ``.vox``, whole or not at all; voxels without a name are called after the file.

    Raises:
        SceneFileError: another suffix, a missing folder, a grid of more than 256 cells per side for ``.vox``, or the
            file cannot be written.
        InputError: ``model`` is none.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    if isinstance(model, SurfaceVoxels):
        model = VoxelModel.of(model, path.stem)
    elif isinstance(model, Voxels):
        model = VoxelModel(voxels=model, name=path.stem)
    elif not isinstance(model, VoxelModel):
        raise InputError(f"model must be a VoxelModel, SurfaceVoxels or Voxels, got {type(model).__name__}")
    suffix = path.suffix.lower()
    if suffix not in (".npz", ".vox"):
        raise SceneFileError(path, f"voxels are written to .npz or .vox, not {path.suffix or 'without suffix'}")
    try:
        if suffix == ".vox":
            write_bytes(path, _vox(path, model))
        else:
            write_npz(path, _arrays(model))
    except ImageFileError as error:  # voxels are no picture
        raise SceneFileError(path, error.reason) from error


def _arrays(model: VoxelModel) -> dict[str, Any]:
    grid = model.voxels.grid
    bits = np.packbits(model.voxels.dense()[0].numpy(), axis=-1, bitorder="little")
    arrays: dict[str, Any] = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "kind": np.array(model.kind),
        "name": np.array(model.name),
        "dims": np.array(grid.dims),
        "origin": grid.origin[0],
        "cell": grid.cell[0],
        "bits": bits,
    }
    return arrays | {name: getattr(model, name) for name in _ATTRIBUTES if getattr(model, name) is not None}


def read_voxels(path: str | Path) -> VoxelModel:
    """A voxel ``.npz`` file.

    Raises:
        SceneFileError: missing, damaged, cut off, of another kind or of a newer version.
    """
    check_class("path", path, str, Path)
    path = Path(path)
    if not path.is_file():
        raise SceneFileError(path, "no such file")
    try:
        with path.open("rb") as stream:  # NumPy leaves files that it cannot read open
            if stream.read(len(ZIP)) != ZIP:
                raise SceneFileError(path, "damaged, cut off or no NPZ file, as voxel files of torchrender are")
            stream.seek(0)
            return _read(path, np.load(stream, allow_pickle=False))
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, OSError, KeyError) as error:
        if isinstance(error, InputError):
            raise SceneFileError(path, f"damaged ({error})") from error
        raise SceneFileError(path, f"damaged, cut off or no NPZ file ({error})") from error


def _read(path: Path, file: Any) -> VoxelModel:
    if not hasattr(file, "files") or "format" not in file.files or str(file["format"]) != FORMAT:
        raise SceneFileError(path, "is no voxel file of torchrender")
    missing = [key for key in _NEEDED if key not in file.files]
    if missing:
        raise SceneFileError(path, f"damaged: {', '.join(missing)} missing")
    version = file["version"]
    if version.shape != () or version.dtype.kind not in "iu" or int(version) < 1:
        raise SceneFileError(path, f"damaged: version must be a whole number, is {version}", key="version")
    if int(version) > VERSION:
        raise SceneFileError(path, f"has version {int(version)}, this program reads up to {VERSION}", key="version")
    dims = file["dims"]
    if dims.shape != (3,) or dims.dtype.kind not in "iu":
        raise SceneFileError(path, "damaged: must be three cell counts", key="dims")
    grid = VoxelGrid(_numbers(path, file, "origin", (3,))[None], _numbers(path, file, "cell", ())[None], _triple(dims))
    nx, ny, nz = grid.dims
    bits = _bytes(path, file, "bits", (nz, ny, -(-nx // 8)))
    dense = np.unpackbits(bits, axis=-1, count=nx, bitorder="little").view(np.bool_)
    voxels = Voxels.from_dense(torch.from_numpy(dense)[None], grid)
    found = {}
    for name, width in _ATTRIBUTES.items():
        if name in file.files:
            shape = (voxels.count, width) if width else (voxels.count,)
            found[name] = torch.from_numpy(_bytes(path, file, name, shape))
    return VoxelModel(voxels=voxels, kind=str(file["kind"]), name=str(file["name"]), **found)


def _triple(values: np.ndarray) -> tuple[int, int, int]:
    return int(values[0]), int(values[1]), int(values[2])


def _numbers(path: Path, file: Any, key: str, shape: tuple[int, ...]) -> Tensor:
    value = file[key]
    if value.shape != shape or value.dtype.kind != "f":
        raise SceneFileError(path, f"damaged: must be numbers {shape}, is {value.dtype} {value.shape}", key=key)
    return torch.from_numpy(value.astype(np.float64))


def _bytes(path: Path, file: Any, key: str, shape: tuple[int, ...]) -> np.ndarray:
    value: np.ndarray = file[key]
    if value.shape != shape or value.dtype != np.uint8:
        raise SceneFileError(path, f"damaged: must be bytes {shape}, is {value.dtype} {value.shape}", key=key)
    return value


def _vox(path: Path, model: VoxelModel) -> bytes:
    """RIFF-like chunks SIZE, XYZI and RGBA; z is up, so the grid's y becomes z."""
    nx, ny, nz = model.voxels.grid.dims
    if max(nx, ny, nz) > VOX_SIDE:
        raise SceneFileError(path, f"a .vox model has at most {VOX_SIDE} cells per side, got {nx} x {ny} x {nz}")
    cells = model.voxels.cells().numpy()
    index, palette = _palette(model, len(cells))
    places = np.stack([cells[:, 0], nz - 1 - cells[:, 2], cells[:, 1], index], axis=1).astype(np.uint8)
    content = _chunk(b"SIZE", struct.pack("<3i", nx, nz, ny))
    content += _chunk(b"XYZI", struct.pack("<i", len(cells)) + places.tobytes())
    content += _chunk(b"RGBA", palette.tobytes())
    return b"VOX " + struct.pack("<i", 150) + b"MAIN" + struct.pack("<2i", 0, len(content)) + content


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<2i", len(data), 0) + data


def _palette(model: VoxelModel, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(N,) palette places from 1 on, and (256,4) uint8 colours of which the first belongs to place 1."""
    from PIL import Image

    palette = np.full((256, 4), 255, np.uint8)
    if model.color is None or not count:
        palette[0, :3] = 204
        return np.ones(count, np.int64), palette
    picture = Image.fromarray(model.color.numpy()[None]).quantize(255, method=Image.Quantize.MEDIANCUT)
    colors = np.array(picture.getpalette(), np.uint8).reshape(-1, 3)[:255]
    palette[: len(colors), :3] = colors
    return np.asarray(picture)[0].astype(np.int64) + 1, palette
