"""Eight pixels of a row at a time.

Masks have a bit per pixel, the first one lowest. Tiles start rows at multiples of LANES and all
LANES pixels must lie within the arrays: those that are masked out are written as they were.
"""

from __future__ import annotations

import math

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.atomics import element
from torchrender.kernels.raster.lanes.vectors import (
    DOUBLES,
    FOUR_DOUBLES,
    FOUR_INTS,
    FOUR_LONGS,
    HALVES,
    I8,
    I64,
    INTS,
    LANES,
    QUADS,
    bits_of,
    constant,
    half,
    halves_of,
    is_nearer,
    keep_halves,
    key_of,
    own_function,
    place_of,
    splat,
)


@intrinsic
def covered_window(typingctx, edges, tall):  # noqa: ARG001
    """uint64 with a bit for each pixel of 8 x 8 that lies inside three edges: bit ``8 y + x``.

    ``edges``: values at the first pixel, steps along x and steps along y, three int64 each; inside is >= 0. ``tall``:
    whether more than the first four rows are looked at.
    """
    signature = types.uint64(types.UniTuple(types.int64, 9), types.boolean)

    def generate(context, builder, sig, args):  # noqa: ARG001
        kinds = [I64] * 9 + [args[1].type]
        own = own_function(builder, "torchrender_covered_window", I64, kinds, _covered_body)
        return builder.call(own, [*cgutils.unpack_tuple(builder, args[0], 9), args[1]])

    return signature, generate


def _covered_body(builder, *numbers):
    *parts, tall = numbers
    values, steps = [], []
    for k in range(3):
        across = builder.mul(splat(builder, FOUR_LONGS, parts[3 + k]), constant(FOUR_LONGS, range(QUADS)))
        left = builder.add(splat(builder, FOUR_LONGS, parts[k]), across)
        on = splat(builder, FOUR_LONGS, builder.mul(parts[3 + k], ir.Constant(I64, QUADS)))
        values.append([left, builder.add(left, on)])
        steps.append(splat(builder, FOUR_LONGS, parts[6 + k]))
    upper, values = _covered_rows(builder, values, steps, range(4))
    bits = cgutils.alloca_once_value(builder, upper)
    with builder.if_then(tall):
        lower, _ = _covered_rows(builder, values, steps, range(4, 8))
        builder.store(builder.or_(upper, lower), bits)
    builder.ret(builder.load(bits))


def _covered_rows(builder, values, steps, rows):
    """Bits of some rows of a window, given the edges in the first of them; and the edges in the row behind."""
    bits = ir.Constant(I64, 0)
    for y in rows:
        outside = []
        for number in range(HALVES):
            signs = builder.or_(builder.or_(values[0][number], values[1][number]), values[2][number])
            outside.append(builder.icmp_signed("<", signs, constant(FOUR_LONGS, [0] * QUADS)))
        row = builder.zext(builder.not_(bits_of(builder, outside)), I64)
        bits = builder.or_(bits, builder.shl(row, ir.Constant(I64, LANES * y)))
        values = [[builder.add(v, step) for v in edge] for edge, step in zip(values, steps, strict=True)]
    return bits, values


@intrinsic
def reaches(typingctx, keys, place, mask, high):  # noqa: ARG001
    """True if one of the masked pixels from ``keys[place]`` on holds no more than ``high``."""
    signature = types.boolean(keys, types.uintp, types.uint64, types.float64)

    def generate(context, builder, sig, args):
        keys_, place_, mask_, high_ = args
        here = builder.load(place_of(context, builder, sig.args[0], keys_, place_, DOUBLES))
        here.align = 8
        spread = splat(builder, FOUR_DOUBLES, high_)
        reached = [builder.fcmp_ordered("<=", half(builder, here, number), spread) for number in range(HALVES)]
        found = builder.and_(bits_of(builder, reached), builder.trunc(mask_, I8))
        return builder.icmp_unsigned("!=", found, ir.Constant(I8, 0))

    return signature, generate


@intrinsic
def least_of(typingctx, values, place, rows, step):  # noqa: ARG001
    """The least of 2 LANES float64 from ``values[place]`` on, and of those ``step`` behind them, so many times."""
    signature = types.float64(values, types.uintp, types.intp, types.intp)

    def generate(context, builder, sig, args):
        values_, place_, rows_, step_ = args
        least = [cgutils.alloca_once_value(builder, constant(FOUR_DOUBLES, [math.inf] * QUADS)) for _ in range(QUADS)]
        first = element(context, builder, sig.args[0], values_, place_)
        with cgutils.for_range(builder, rows_) as loop:
            row = builder.gep(first, [builder.mul(loop.index, step_)])
            for number, lowest in enumerate(least):
                at = builder.gep(row, [ir.Constant(I64, number * QUADS)])
                here = builder.load(builder.bitcast(at, FOUR_DOUBLES.as_pointer()))
                here.align = 8
                held = builder.load(lowest)
                builder.store(builder.select(builder.fcmp_ordered("<", here, held), here, held), lowest)
        found = [builder.load(lowest) for lowest in least]
        while len(found) > 1:
            one, other = found.pop(), found.pop()
            found.insert(0, builder.select(builder.fcmp_ordered("<", one, other), one, other))
        every = [builder.extract_element(found[0], ir.Constant(ir.IntType(32), k)) for k in range(QUADS)]
        while len(every) > 1:
            one, other = every.pop(), every.pop()
            every.insert(0, builder.select(builder.fcmp_ordered("<", one, other), one, other))
        return every[0]

    return signature, generate


@intrinsic
def keep_nearest(typingctx, keys, ids, place, mask, plane, t):  # noqa: ARG001
    """Triangle ``t`` into those of the masked pixels from ``place`` on where it is nearer, or as near with a lower id.

    ``plane``: (key at column 0, step, column of the first pixel, least, greatest), float64.
    """
    signature = types.void(keys, ids, types.uintp, types.uint64, types.UniTuple(types.float64, 5), types.int32)

    def generate(context, builder, sig, args):
        keys_, ids_, place_, mask_, plane_, t_ = args
        key = key_of(builder, cgutils.unpack_tuple(builder, plane_, 5))
        places = [element(context, builder, sig.args[k], array, place_) for k, array in enumerate((keys_, ids_))]
        keep_halves(builder, places, key, t_, halves_of(builder, mask_))
        return context.get_dummy_value()

    return signature, generate


def _looked_up(builder, coefficients, near, x, y, key):
    """Columns, rows and where the fragments project at all, in one earlier image: see ``fragments.lookup``."""
    kind = x.type
    u, v, w = (
        builder.fadd(
            builder.fadd(
                builder.fadd(
                    builder.fmul(splat(builder, kind, row[0]), x),
                    splat(builder, kind, builder.fmul(row[1], y)),
                ),
                splat(builder, kind, row[2]),
            ),
            builder.fmul(splat(builder, kind, row[3]), key),
        )
        for row in coefficients
    )
    zero, one = (constant(kind, [value] * kind.count) for value in (0.0, 1.0))
    reached = builder.fcmp_ordered(">=", w, builder.fmul(splat(builder, kind, near), key))
    reached = builder.and_(reached, builder.fcmp_ordered(">", w, zero))
    inverse = builder.fdiv(one, w)
    return builder.fmul(u, inverse), builder.fmul(v, inverse), reached


def _has_triangle(builder, arrays, j, lanes, owner):
    """Which of QUADS pixels earlier image ``j`` has: those where it holds the triangle that they project to.

    ``arrays``: ids, pixels and near of ``records.Earlier``; ``lanes``: centres x, the row's y, and stored keys.
    """
    known, pixels, near = arrays
    x, y, key = lanes
    zeros = constant(FOUR_DOUBLES, [0.0] * QUADS)
    _, height, width = cgutils.unpack_tuple(builder, known.shape, 3)

    def number(data, index):
        return builder.load(cgutils.gep_inbounds(builder, data, index))

    at = builder.mul(j, ir.Constant(I64, 12))
    loaded = [number(pixels.data, builder.add(at, ir.Constant(I64, k))) for k in range(12)]
    rows, least = [loaded[k : k + 4] for k in (0, 4, 8)], number(near.data, j)
    u, v, inside = _looked_up(builder, rows, least, x, y, key)
    for value, size in ((u, width), (v, height)):
        most = splat(builder, FOUR_DOUBLES, builder.sitofp(size, ir.DoubleType()))
        inside = builder.and_(inside, builder.fcmp_ordered(">=", value, zeros))
        inside = builder.and_(inside, builder.fcmp_ordered("<", value, most))
    column, row = (builder.fptosi(builder.select(inside, value, zeros), FOUR_INTS) for value in (u, v))
    row = builder.add(splat(builder, FOUR_LONGS, builder.mul(j, height)), builder.sext(row, FOUR_LONGS))
    spots = builder.add(builder.mul(row, splat(builder, FOUR_LONGS, width)), builder.sext(column, FOUR_LONGS))
    values = ir.Constant(FOUR_LONGS, ir.Undefined)
    for k in range(QUADS):
        lane = ir.Constant(ir.IntType(32), k)
        values = builder.insert_element(values, number(known.data, builder.extract_element(spots, lane)), lane)
    return builder.and_(builder.icmp_signed("==", values, owner), inside)


def _stored_keys(builder, key):
    """As ``fragments.stored_key``."""
    ones = constant(FOUR_DOUBLES, [1.0] * QUADS)
    depth = builder.fptrunc(builder.fdiv(ones, key), ir.VectorType(ir.FloatType(), QUADS))
    return builder.fdiv(ones, builder.fpext(depth, FOUR_DOUBLES))


@intrinsic
def unseen_lanes(typingctx, keys, ids, place, mask, row, t, earlier):  # noqa: ARG001
    """Mask of those of the masked pixels from ``place`` on where triangle ``t`` is nearer and in no earlier image.

    ``row``: plane of :func:`keep_nearest`, then x and y of the first pixel's centre from the image centre;
    ``earlier``: ids (J,h,w) int64, pixels (J,3,4) and near (J,): see ``records.Earlier``.
    """
    if any(part.layout != "C" for part in earlier):
        return None
    signature = types.uint64(
        keys, ids, types.uintp, types.uint64, types.UniTuple(types.float64, 7), types.int32, earlier
    )

    def generate(context, builder, sig, args):
        keys_, ids_, place_, mask_, row_, t_, earlier_ = args
        *plane, first, y = cgutils.unpack_tuple(builder, row_, 7)
        key = key_of(builder, plane)
        here = builder.load(place_of(context, builder, sig.args[0], keys_, place_, DOUBLES))
        held = builder.load(place_of(context, builder, sig.args[1], ids_, place_, INTS))
        here.align, held.align = 8, 4
        owner = splat(builder, FOUR_LONGS, builder.sext(t_, I64))
        nearer = [
            is_nearer(builder, half(builder, key, k), owner, half(builder, here, k), builder.sext(ids, FOUR_LONGS))
            for k, ids in enumerate(half(builder, held, k) for k in range(HALVES))
        ]
        new = builder.and_(bits_of(builder, nearer), builder.trunc(mask_, I8))
        left = cgutils.alloca_once_value(builder, new)
        parts = zip(sig.args[6], cgutils.unpack_tuple(builder, earlier_, 3), strict=True)
        arrays = [context.make_array(kind)(context, builder, part) for kind, part in parts]
        x = builder.fadd(splat(builder, DOUBLES, first), constant(DOUBLES, [float(k) for k in range(LANES)]))
        none = ir.Constant(I8, 0)
        count = cgutils.unpack_tuple(builder, arrays[0].shape, 3)[0]
        for part in range(HALVES):
            own = ir.Constant(I8, ((1 << QUADS) - 1) << (part * QUADS))
            with builder.if_then(builder.icmp_unsigned("!=", builder.and_(new, own), none)):
                lanes = (half(builder, x, part), y, _stored_keys(builder, half(builder, key, part)))
                with cgutils.for_range(builder, count) as loop:
                    rest = builder.load(left)
                    with builder.if_then(builder.icmp_unsigned("!=", builder.and_(rest, own), none)):
                        seen = _has_triangle(builder, arrays, loop.index, lanes, owner)
                        seen = builder.zext(builder.bitcast(seen, ir.IntType(QUADS)), I8)
                        seen = builder.shl(seen, ir.Constant(I8, part * QUADS))
                        builder.store(builder.and_(rest, builder.not_(seen)), left)
        return builder.zext(builder.load(left), I64)

    return signature, generate


@intrinsic
def same_lanes(typingctx, ids, place, t):  # noqa: ARG001
    """Mask of the pixels from ``ids[place]`` on that hold triangle ``t``."""
    signature = types.uint64(ids, types.uintp, types.int32)

    def generate(context, builder, sig, args):
        ids_, place_, t_ = args
        held = builder.load(place_of(context, builder, sig.args[0], ids_, place_, INTS))
        held.align = 4
        same = builder.icmp_signed("==", held, splat(builder, INTS, t_))
        return builder.zext(builder.bitcast(same, I8), I64)

    return signature, generate
