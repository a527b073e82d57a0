"""Density grids: NumPy ``.npy`` and Mitsuba ``.vol`` (version 3, float32)."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchrender.errors import SceneFileError

SUFFIXES = (".npy", ".vol")
MAX_CELLS = 2**28


def read_volume(path: Path) -> Tensor:
    """(D,H,W) float32, axes z, y, x; whole numbers are scaled so that the largest value of their type is 1.

    Of a ``.vol`` file with several channels the mean is taken. Its bounding box is not used.

    Raises:
        SceneFileError: missing, damaged, cut off, too large, of another kind, or with negative or infinite values.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneFileError(path, f"cannot read {suffix or 'files without suffix'}; supported: {', '.join(SUFFIXES)}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SceneFileError(path, error.strerror or str(error)) from error
    grid = _read_vol(path, data) if suffix == ".vol" else _read_npy(path, data)
    if not bool(torch.isfinite(grid).all()) or bool((grid < 0).any()):
        raise SceneFileError(path, "densities must be finite and not negative")
    return grid


def _read_npy(path: Path, data: bytes) -> Tensor:
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
        if len(shape) != 3 or dtype.kind not in "iuf" or 0 in shape:
            raise SceneFileError(path, f"must hold numbers (D, H, W), holds {dtype} {shape}")
        need = int(np.prod([int(s) for s in shape], dtype=object)) * dtype.itemsize
        if need > len(data) or need > MAX_CELLS * 8:
            raise SceneFileError(path, f"cut off or too large: declares {need} bytes, the file has {len(data)}")
        stream.seek(0)
        grid = np.load(stream, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise SceneFileError(path, f"damaged or no NumPy file ({error})") from error
    values = grid.astype(np.float32)
    return torch.from_numpy(values if dtype.kind == "f" else values / np.float32(np.iinfo(dtype).max))


def _read_vol(path: Path, data: bytes) -> Tensor:
    if len(data) < 48 or data[:4] != b"VOL\x03":
        raise SceneFileError(path, "damaged or no Mitsuba volume of version 3")
    kind, width, height, depth, channels = struct.unpack_from("<5i", data, 4)
    if kind != 1 or min(width, height, depth, channels) < 1:
        raise SceneFileError(path, f"must hold float32 values, is type {kind} of size {width} x {height} x {depth}")
    count = width * height * depth * channels
    if count > MAX_CELLS or 48 + 4 * count > len(data):
        raise SceneFileError(
            path, f"cut off or too large: declares {count} values, the file has {(len(data) - 48) // 4}"
        )
    values = np.frombuffer(data, "<f4", count, 48).reshape(depth, height, width, channels)
    return torch.from_numpy(values.mean(axis=-1, dtype=np.float64).astype(np.float32))
