"""What earlier images refuse in a tile, noted while it is drawn.

A fragment is refused only where nothing nearer is stored yet, so what lies before the sample that stays in the end is
among the refused ones, with a few behind it that came first. Their number, the farthest depth and the first SLOTS ones
of a pixel tell how many these are; where they do not, or where float32 depths are equal, the pixel is UNSURE, and
``count_layers`` tells.
"""

from __future__ import annotations

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.lanes.pixels import ALIKE
from torchrender.kernels.raster.lanes.rows import TILE_WIDTH
from torchrender.kernels.raster.lanes.vectors import LANES

SLOTS = 8
COUNT, FARTHEST, LEVEL, FIRST = 0, 1, 2, 3
NOTES = FIRST + SLOTS
"""Rows of the notes on a tile: number, greatest depth, whether depths are equal, and depths."""
APART, TOUCHING, UNSURE = 0, 1, 2
NO_BITS, GROUP = np.uint64(0), np.uint64((1 << LANES) - 1)
HIGHER = 1.0 + 2.0 * ALIKE
"""Factor of keys that no fragment exceeds, so that those of equal float32 depth are looked at."""


@kernel(inline=True)
def is_asked(earlier):
    """True if what is refused is noted."""
    return earlier.number.shape[0] > 0


@kernel(inline=True)
def clear_notes(notes):
    """Nothing is refused yet; depths need not be cleared."""
    for n in range(np.uintp(notes.shape[1])):
        notes[COUNT, n] = 0.0
        notes[FARTHEST, n] = 0.0
        notes[LEVEL, n] = 0.0


@kernel(inline=True)
def note(notes, place, key):
    """One refused fragment with this key."""
    z = np.float32(1.0 / key)
    count = notes[COUNT, place]
    if count < SLOTS:
        notes[np.uintp(FIRST) + np.uintp(count), place] = z
    notes[COUNT, place] = count + np.float32(1.0)
    notes[FARTHEST, place] = max(notes[FARTHEST, place], z)


@kernel(inline=True)
def note_level(notes, place, key, here):
    """Whether float32 may not tell the depths of a key and of that stored apart."""
    if abs(key - here) <= here * ALIKE:
        notes[LEVEL, place] = 1.0


@kernel()
def note_lanes(notes, place, found, row):
    """What :func:`~.pixels.unseen_lanes` ``found`` in pixels from ``place`` on; ``row``: their plane."""
    notes = borrowed(notes)
    base, step, column, low, high = row
    refused, level = (found >> np.uint64(LANES)) & GROUP, found >> np.uint64(2 * LANES)
    while refused != NO_BITS:
        k = np.uintp(trailing_zeros(refused))
        refused &= refused - np.uint64(1)
        key = base + step * (column + np.float64(k))
        key = key if key > low else low
        note(notes, place + k, key if key < high else high)
    while level != NO_BITS:
        k = np.uintp(trailing_zeros(level))
        level &= level - np.uint64(1)
        notes[LEVEL, place + k] = 1.0


@kernel(inline=True)
def judged(notes, place, here, empty, eps):
    """How many refused surfaces lie before a stored depth, and APART, TOUCHING or UNSURE."""
    count, farthest = np.int32(notes[COUNT, place]), notes[FARTHEST, place]
    if notes[LEVEL, place] != 0.0:
        return count, UNSURE
    if empty or count == 0:
        return count, APART
    nearest = farthest
    if farthest >= here:
        if count > SLOTS:
            return count, UNSURE
        nearest, before = np.float32(-1.0), np.int32(0)
        for k in range(np.uintp(count)):
            z = notes[np.uintp(FIRST) + k, place]
            if z == here:
                return count, UNSURE
            if z < here:
                before += np.int32(1)
                nearest = max(nearest, z)
        count = before
    touches = count > 0 and np.float64(nearest) * (1.0 + eps[0]) + eps[1] >= np.float64(here)
    return count, TOUCHING if touches else APART


@kernel()
def settle(area, ids, earlier, depth):
    """Write what is asked for of a finished tile, whose depths are in the image."""
    earlier, depth = borrowed(earlier), borrowed(depth)
    notes, number, nearest = earlier.notes, earlier.number, earlier.nearest
    left, top, width, height = area
    eps = (earlier.relative, earlier.absolute)
    for y in range(np.uintp(height)):
        row = np.uintp(top) + y
        for x in range(np.uintp(width)):
            place, column = y * np.uintp(TILE_WIDTH) + x, np.uintp(left) + x
            if notes[COUNT, place] != 0.0 or notes[LEVEL, place] != 0.0:
                number[row, column], nearest[row, column] = judged(
                    notes, place, depth[row, column], ids[place] < 0, eps
                )
