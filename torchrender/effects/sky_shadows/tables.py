"""Tables that do not depend on any scene: caps as bits, kept on disk, and wavelets of 4 x 4 bits by their code."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.kernels.keys import cache_folder
from torchrender.kernels.sky_shadows.caps import WORDS, fill_table
from torchrender.numerics.wavelets.haar import SIGNS
from torchrender.scene.sky.cube_map import texel_directions

Array = np.ndarray[Any, Any]
LOG = logging.getLogger("torchrender.sky_shadows")
SIDE = 32
VERSION = 1


@cache
def code_wavelets() -> Array:
    """(65536,16) int8: of each code of 4 x 4 bits 16 times mean, wavelets of the block, and of its four quarters.

    The block's three wavelets come first, in the order 01, 10, 11; then those of the quarters, row by row.
    """
    codes = torch.arange(1 << 16)
    bits = ((codes[:, None] >> (15 - torch.arange(16))) & 1).double().reshape(-1, 4, 4)
    parts = bits.reshape(-1, 2, 2, 2, 2).transpose(2, 3).reshape(-1, 4, 4)
    fine = parts @ SIGNS.T * 2.0
    coarse = parts.sum(-1) @ SIGNS.T
    made = torch.cat([bits.sum((1, 2))[:, None], coarse, fine.reshape(-1, 12)], dim=1)
    table: Array = made.to(torch.int8).numpy()
    return table


def bin_radii(radii: int) -> Tensor:
    """(R,) float64 relative radius, the sine of the half angle, that stands for each bin."""
    return (torch.arange(radii, dtype=torch.float64) + 0.5) / radii


def table_file(radii: int) -> Path:
    """Where the table of caps is kept."""
    return cache_folder() / "sky_shadows" / f"caps_{SIDE}_{radii}_v{VERSION}.npy"


def build_table(radii: int = 32) -> tuple[Array, Array]:
    """Caps about the 6144 texel centres: bits (6144 R, 96) int64, rows that hold any (6144 R,) int64.

    With 32 radii the bits take 144 MiB, and about a second of two cores.
    """
    directions = texel_directions(SIDE).reshape(-1, 3).contiguous().numpy()
    bits = np.empty((len(directions), radii, WORDS), np.int64)
    filled = np.empty((len(directions), radii), np.int64)
    fill_table(directions, bin_radii(radii).numpy(), bits, filled)
    return bits.reshape(-1, WORDS), filled.reshape(-1)


@cache
def cap_table(radii: int = 32) -> tuple[Array, Array]:
    """The table as :func:`build_table` makes it, mapped from the user's cache: processes share its memory.

    It is built on first use, which the log says. Where nothing can be written it stays in this process.
    """
    file = table_file(radii)
    kept = _kept(file, radii)
    if kept is not None:
        return kept
    begin = perf_counter()
    bits, filled = build_table(radii)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(_rows_file(file), lambda path: _save(path, filled))
        write_atomically(file, lambda path: _save(path, bits))
    except OSError as error:
        LOG.info("a table of %d MiB for shadows under the sky is not kept: %s", bits.nbytes >> 20, error)
        return bits, filled
    LOG.info(
        "built a table of %d MiB for shadows under the sky in %.1f s, once; kept in %s",
        bits.nbytes >> 20, perf_counter() - begin, file,
    )  # fmt: skip
    return _kept(file, radii) or (bits, filled)


def _rows_file(file: Path) -> Path:
    return file.with_name(file.stem + "_rows.npy")


def _save(path: Path, array: Array) -> None:
    with path.open("wb") as stream:
        np.save(stream, array)


def _kept(file: Path, radii: int) -> tuple[Array, Array] | None:
    """The table on disk; None where there is none, or a damaged one."""
    count = 6 * SIDE * SIDE * radii
    try:
        bits = np.load(file, mmap_mode="r")
        filled = np.load(_rows_file(file))
    except (OSError, ValueError, EOFError):
        return None
    right = bits.shape == (count, WORDS) and filled.shape == (count,) and bits.dtype == filled.dtype == np.int64
    return (np.asarray(bits), filled) if right else None


NO_TABLE = np.zeros((0, WORDS), np.int64), np.zeros(0, np.int64)
"""In place of a table where caps are found one by one."""
