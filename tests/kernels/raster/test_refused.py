"""What is noted of refused fragments, against the list of all of them."""

from __future__ import annotations

import itertools

import numba
import numpy as np

from torchrender.kernels.raster.lanes.refused import (
    APART,
    COUNT,
    LEVEL,
    NOTES,
    ROOM,
    SLOTS,
    TOUCHING,
    UNSURE,
    clear_notes,
    note,
    note_lanes,
    note_level,
    settle,
)
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.lanes.vectors import LANES
from torchrender.kernels.raster.records import NO_EARLIER


@numba.njit
def noted(notes, place, found, row):
    note_lanes(notes, np.uintp(place), np.uint64(found), row)


def test_eight_pixels_are_noted_as_each_of_them() -> None:
    rng = np.random.default_rng(3)
    one, other = np.zeros((NOTES, ROOM)), np.zeros((NOTES, ROOM))
    for notes in (one, other):
        clear_notes(notes)
    for _ in range(300):
        place, found = int(rng.choice([0, 3, 8, TILE_WIDTH * TILE_HEIGHT - LANES])), int(rng.integers(0, 1 << 24))
        base, step, column, low, high = row = (0.5, float(rng.normal(0, 0.05)), float(rng.integers(0, 9)), 0.3, 0.7)
        noted(one, place, found, row)
        for k in range(LANES):
            key = min(max(base + step * (column + k), low), high)
            if found >> (LANES + k) & 1:
                note(other, np.uintp(place + k), key)
            if found >> (2 * LANES + k) & 1:
                note_level(other, np.uintp(place + k), key, key)
    np.testing.assert_array_equal(one, other)
    assert (one[COUNT] > 2 * LEVEL).any() and (one[NOTES - 1] > 0).sum() > 2 * LANES


def test_refused_surfaces_before_the_stored_ones_are_counted() -> None:
    """Any order, more of them than there is room for, nothing stored, and depths of the same float32."""
    rng = np.random.default_rng(2)
    notes = np.full((NOTES, ROOM), np.nan)
    clear_notes(notes)
    left, top, width, height = 64, 32, 50, 30
    shape = (top + TILE_HEIGHT, left + TILE_WIDTH)
    relative, absolute = 0.01, 0.02
    earlier = NO_EARLIER._replace(
        notes=notes, number=np.zeros(shape, np.int32), nearest=np.zeros(shape, np.uint8),
        relative=relative, absolute=absolute,
    )  # fmt: skip
    depth = np.full(shape, np.inf, np.float32)
    refused, level = {}, {}
    for y, x in itertools.product(range(height), range(width)):
        place = y * TILE_WIDTH + x
        zs = rng.choice([1.0, 2.0, 2.06, 3.0, 5.0], rng.integers(0, 2 * SLOTS + 1)) * rng.uniform(0.999, 1.001)
        for z in zs:
            note(notes, np.uintp(place), 1.0 / z)
        here = float(rng.choice([0.5, 2.0, 2.08, 9.0]))
        level[y, x] = bool(rng.random() < 0.1)
        note_level(notes, np.uintp(place), 1.0 / here * (1 + (1e-7 if level[y, x] else 1e-6)), 1.0 / here)
        if rng.random() < 0.8:
            depth[top + y, left + x] = here
            if len(zs) and rng.random() < 0.1:
                depth[top + y, left + x] = np.float32(1.0 / (1.0 / zs[0]))
        refused[y, x] = [np.float32(1.0 / (1.0 / z)) for z in zs]
    settle((left, top, width, height), earlier, depth)
    kinds = set()
    for (y, x), zs in refused.items():
        place, here = (top + y, left + x), depth[top + y, left + x]
        before = [z for z in zs if z < here]
        unsure = level[y, x] or (len(before) < len(zs) and (len(zs) > SLOTS or here in zs))
        kinds.add((unsure, bool(before), len(before) < len(zs), len(zs) > SLOTS, bool(np.isinf(here))))
        if unsure:
            assert earlier.nearest[place] == UNSURE
            continue
        touches = any(float(z) * (1 + relative) + absolute >= float(here) for z in before)
        assert earlier.number[place] == len(before)
        assert earlier.nearest[place] == (TOUCHING if touches else APART)
    assert len(kinds) > 12
    outside = np.ones(shape, bool)
    outside[top : top + height, left : left + width] = False
    assert not earlier.number[outside].any() and not earlier.nearest[outside].any()
