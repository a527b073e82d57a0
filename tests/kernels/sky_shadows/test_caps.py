"""Caps as bits beside their slow twin, which asks every texel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.sky_shadows.caps import ROWS, SIDE, WORDS, add_cap, fill_table, filled_rows, pack_blocks
from torchrender.scene.sky.cube_map import solid_angles, texel_directions

TEXELS = texel_directions(SIDE).numpy()


def image(rows: np.ndarray) -> np.ndarray:
    """(6,32,32) bool of rows (192,)."""
    return (((rows[:, None] >> (31 - np.arange(32, dtype=np.uint32))) & 1) > 0).reshape(6, SIDE, SIDE)


def codes_of(bits: np.ndarray) -> np.ndarray:
    """The slow twin of packing: one texel after the other."""
    codes = np.zeros(384, np.int64)
    for face in range(6):
        for row in range(SIDE):
            for column in range(SIDE):
                if bits[face, row, column]:
                    place = (face * 8 + row // 4) * 8 + column // 4
                    codes[place] |= 1 << (15 - (4 * (row % 4) + column % 4))
    return codes.astype(np.uint16)


def axes() -> list[np.ndarray]:
    """Directions along axes, edges, corners, and close to them."""
    rng = np.random.default_rng(0)
    found = [np.array(d, float) for d in np.ndindex(3, 3, 3)]
    found = [d - 1 for d in found if (d != 1).any()]
    near = [d + 1e-6 * rng.normal(size=3) for d in found]
    return [d / np.linalg.norm(d) for d in (*found, *near, *rng.normal(size=(120, 3)))]


@pytest.mark.parametrize("size", [1e-9, 0.004, 1 / 64, 0.1, 0.37, 1 / math.sqrt(3), 1 / math.sqrt(2), 0.75, 0.999, 1.0])
def test_a_cap_holds_the_texels_whose_centres_lie_in_it(size: float) -> None:
    cosine = math.sqrt(1 - size * size)
    for axis in axes():
        rows = np.zeros(ROWS, np.uint32)
        add_cap(axis[0], axis[1], axis[2], cosine, rows)
        dots = TEXELS @ axis
        clear = np.abs(dots - cosine) > 1e-8  # rounding decides the others
        np.testing.assert_array_equal(image(rows)[clear], (dots >= cosine)[clear])


def test_blocks_are_rows_in_another_order() -> None:
    rng = np.random.default_rng(1)
    rows, words = rng.integers(0, 1 << 32, ROWS).astype(np.uint32), np.empty(WORDS, np.int64)
    rows[40:60] = 0
    pack_blocks(rows, words)
    codes = codes_of(image(rows))
    np.testing.assert_array_equal(words.view(np.uint16), codes)
    used = codes.reshape(48, 8).any(axis=1)
    assert filled_rows(words) == sum(1 << int(k) for k in np.flatnonzero(used))


def test_the_table_holds_caps_of_the_right_size() -> None:
    """Solid angles of 2 pi (1 - cos) in the mean, within 1 % from 7 degrees on."""
    directions = np.ascontiguousarray(TEXELS.reshape(-1, 3)[::37])
    radii = np.array([0.125, 0.3, 0.6, 0.95])
    bits, filled = np.empty((len(directions), 4, WORDS), np.int64), np.empty((len(directions), 4), np.int64)
    fill_table(directions, radii, bits, filled)
    solid = np.broadcast_to(solid_angles(SIDE).numpy(), (6, SIDE, SIDE))
    ordered = solid.reshape(6, 8, 4, 8, 4).swapaxes(2, 3).reshape(-1)
    for r, size in enumerate(radii):
        hidden = np.unpackbits(bits[:, r].view(np.uint16).astype(">u2").view(np.uint8), axis=1) @ ordered
        wanted = 2 * math.pi * (1 - math.sqrt(1 - size * size))
        assert hidden.mean() == pytest.approx(wanted, rel=0.01)
    assert filled[5, 1] == filled_rows(bits[5, 1])
