"""What earlier images refuse in a tile, noted while it is drawn.

A fragment is refused only where nothing nearer is stored yet, so what lies before the sample that stays in the end is
among the refused ones, with a few behind it that came first. Their number, the least key and the last SLOTS keys of a
pixel tell how many these are; where they do not, or where float32 depths are equal, the pixel is UNSURE, and
``count_layers`` tells.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.lanes.pixels import ALIKE
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.lanes.vectors import (
    DOUBLES,
    I64,
    LANES,
    constant,
    key_of,
    lanes_of,
    stored_whole,
)

SLOTS = 4
COUNT, LEAST, FIRST = 0, 1, 2
NOTES = FIRST + SLOTS
"""Rows of the notes on a tile: number, least key, and keys, the last one first."""
ROOM = TILE_WIDTH * TILE_HEIGHT + 24
"""Columns of the notes: a few more than pixels, because the cache has few places for what lies whole pages apart."""
LEVEL = 2.0**32
"""Added to the number for every depth that may be the stored one."""
APART, TOUCHING, UNSURE, LISTED = 0, 1, 2, 3
HIGHER = 1.0 + 2.0 * ALIKE
"""Factor of keys that no fragment exceeds, so that those of equal float32 depth are looked at."""


@kernel(inline=True)
def is_asked(earlier):
    """True if what is refused is noted."""
    return earlier.number.shape[0] > 0


@kernel(inline=True)
def clear_notes(notes):
    """Nothing is refused yet; the keys need not be cleared."""
    for n in range(np.uintp(ROOM)):
        notes[COUNT, n] = 0.0
        notes[LEAST, n] = np.inf


@kernel(inline=True)
def note(notes, place, key):
    """One refused fragment with this key."""
    for n in range(np.uintp(SLOTS - 1)):
        k = np.uintp(NOTES - 1) - n
        notes[k, place] = notes[k - np.uintp(1), place]
    notes[FIRST, place] = key
    notes[COUNT, place] += 1.0
    notes[LEAST, place] = min(notes[LEAST, place], key)


@kernel(inline=True)
def note_level(notes, place, key, here):
    """Whether float32 may not tell the depths of a key and of that stored apart."""
    if abs(key - here) <= here * ALIKE:
        notes[COUNT, place] += LEVEL


@intrinsic
def note_lanes(typingctx, notes, place, found, row):  # noqa: ARG001
    """What :func:`~.pixels.unseen_lanes` ``found`` in the pixels from ``place`` on; ``row``: their plane."""
    signature = types.void(notes, types.uintp, types.uint64, types.UniTuple(types.float64, 5))

    def generate(context, builder, sig, args):
        notes_, place_, found_, row_ = args
        view = context.make_array(sig.args[0])(context, builder, notes_)
        key = key_of(builder, cgutils.unpack_tuple(builder, row_, 5))
        refused, level = (lanes_of(builder, builder.lshr(found_, ir.Constant(I64, LANES * group))) for group in (1, 2))

        def spot(number):
            at = cgutils.gep_inbounds(builder, view.data, builder.add(place_, ir.Constant(I64, number * ROOM)))
            return builder.bitcast(at, DOUBLES.as_pointer())

        def load(number):
            loaded = builder.load(spot(number))
            loaded.align = 8
            return loaded

        def store(number, values):
            builder.store(stored_whole(builder, values), spot(number)).align = 8

        none, one, much = (constant(DOUBLES, [value] * LANES) for value in (0.0, 1.0, LEVEL))
        more = builder.fadd(builder.select(refused, one, none), builder.select(level, much, none))
        store(COUNT, builder.fadd(load(COUNT), more))
        held = [load(FIRST + k) for k in range(SLOTS)]
        for k, value in enumerate([key, *held[:-1]]):
            store(FIRST + k, builder.select(refused, value, held[k]))
        least = load(LEAST)
        lower = builder.and_(refused, builder.fcmp_ordered("<", key, least))
        store(LEAST, builder.select(lower, key, least))
        return context.get_dummy_value()

    return signature, generate


@kernel(inline=True)
def judge(notes, row, column, spot, outputs, eps):
    """Fill a row of ``outputs`` = depth, number and nearest by what the least keys tell; LISTED where others must.

    ``row``: of the tile; ``spot``: row and first column of the image; ``column``: how many. No branches.
    """
    depth, number, nearest = outputs
    y, left = spot
    relative, absolute = 1.0 + eps[0], eps[1]
    for x in range(np.uintp(column)):
        at = row * np.uintp(TILE_WIDTH) + x
        told, here = notes[COUNT, at], depth[y, left + x]
        z = np.float32(1.0 / notes[LEAST, at])
        touches = np.float64(z) * relative + absolute >= np.float64(here)
        code = np.uint8(TOUCHING) if touches & (told > 0.0) else np.uint8(APART)
        code = np.uint8(LISTED) if (z >= here) & (told > 0.0) else code
        code = np.uint8(APART) if here == np.inf else code
        nearest[y, left + x] = np.uint8(UNSURE) if told >= LEVEL else code
        number[y, left + x] = np.int32(told if told < LEVEL else 0.0)


@kernel(inline=True)
def judge_listed(notes, place, here, count, eps):
    """How many refused surfaces lie before a stored depth, and APART, TOUCHING or UNSURE."""
    if count > SLOTS:
        return count, UNSURE
    nearest, before = np.float32(-1.0), np.int32(0)
    for k in range(np.uintp(count)):
        z = np.float32(1.0 / notes[np.uintp(FIRST) + k, place])
        if z == here:
            return count, UNSURE
        if z < here:
            before += np.int32(1)
            nearest = max(nearest, z)
    touches = before > 0 and np.float64(nearest) * (1.0 + eps[0]) + eps[1] >= np.float64(here)
    return before, TOUCHING if touches else APART


@kernel()
def settle(area, earlier, depth):
    """Write what is asked for of a finished tile, whose depths are in the image."""
    earlier, depth = borrowed(earlier), borrowed(depth)
    notes, number, nearest = earlier.notes, earlier.number, earlier.nearest
    left, top, width, height = area
    eps = (earlier.relative, earlier.absolute)
    for y in range(np.uintp(height)):
        row = np.uintp(top) + y
        judge(notes, y, width, (row, np.uintp(left)), (depth, number, nearest), eps)
        for x in range(np.uintp(width)):
            column = np.uintp(left) + x
            if nearest[row, column] == LISTED:
                place = y * np.uintp(TILE_WIDTH) + x
                number[row, column], nearest[row, column] = judge_listed(
                    notes, place, depth[row, column], number[row, column], eps
                )
