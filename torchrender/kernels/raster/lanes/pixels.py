"""Eight pixels of a row at a time.

Masks have a bit per pixel, the first one lowest. Tiles start rows at multiples of LANES and all
LANES pixels must lie within the arrays: those that are masked out are written as they were.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.raster.lanes.vectors import (
    DOUBLES,
    FLOATS,
    I8,
    I64,
    INTS,
    LANES,
    LONGS,
    constant,
    is_nearer,
    key_of,
    lanes_of,
    place_of,
    splat,
    stored_whole,
)


@intrinsic
def covered_window(typingctx, edges, tall):  # noqa: ARG001
    """uint64 with a bit for each pixel of 8 x 8 that lies inside three edges: bit ``8 y + x``.

    ``edges``: values at the first pixel, steps along x and steps along y, three int64 each; inside is >= 0. ``tall``:
    whether more than the first four rows are looked at.
    """
    signature = types.uint64(types.UniTuple(types.int64, 9), types.boolean)

    def generate(context, builder, sig, args):  # noqa: ARG001
        parts = cgutils.unpack_tuple(builder, args[0], 9)
        columns = constant(LONGS, range(LANES))
        values, steps = [], []
        for k in range(3):
            across = builder.mul(splat(builder, LONGS, parts[3 + k]), columns)
            values.append(builder.add(splat(builder, LONGS, parts[k]), across))
            steps.append(splat(builder, LONGS, parts[6 + k]))
        upper, values = _covered_rows(builder, values, steps, range(4))
        bits = cgutils.alloca_once_value(builder, upper)
        with builder.if_then(args[1]):
            lower, _ = _covered_rows(builder, values, steps, range(4, 8))
            builder.store(builder.or_(upper, lower), bits)
        return builder.load(bits)

    return signature, generate


def _covered_rows(builder, values, steps, rows):
    """Bits of some rows of a window, given the edges in the first of them; and the edges in the row behind."""
    bits = ir.Constant(I64, 0)
    for y in rows:
        signs = builder.or_(builder.or_(values[0], values[1]), values[2])
        inside = builder.icmp_signed(">=", signs, constant(LONGS, [0] * LANES))
        row = builder.zext(builder.bitcast(inside, I8), I64)
        bits = builder.or_(bits, builder.shl(row, ir.Constant(I64, LANES * y)))
        values = [builder.add(v, s) for v, s in zip(values, steps, strict=True)]
    return bits, values


@intrinsic
def reaches(typingctx, keys, place, mask, high):  # noqa: ARG001
    """True if one of the masked pixels from ``keys[place]`` on holds no more than ``high``."""
    signature = types.boolean(keys, types.uintp, types.uint64, types.float64)

    def generate(context, builder, sig, args):
        keys_, place_, mask_, high_ = args
        here = builder.load(place_of(context, builder, sig.args[0], keys_, place_, DOUBLES))
        here.align = 8
        reached = builder.fcmp_ordered("<=", here, splat(builder, DOUBLES, high_))
        found = builder.and_(builder.bitcast(reached, I8), builder.trunc(mask_, I8))
        return builder.icmp_unsigned("!=", found, ir.Constant(I8, 0))

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
        owner = splat(builder, INTS, t_)
        key_at = place_of(context, builder, sig.args[0], keys_, place_, DOUBLES)
        id_at = place_of(context, builder, sig.args[1], ids_, place_, INTS)
        here, held = builder.load(key_at), builder.load(id_at)
        here.align, held.align = 8, 4
        nearer = builder.and_(is_nearer(builder, key, owner, here, held), lanes_of(builder, mask_))
        builder.store(stored_whole(builder, builder.select(nearer, key, here)), key_at).align = 8
        builder.store(stored_whole(builder, builder.select(nearer, owner, held)), id_at).align = 4
        return context.get_dummy_value()

    return signature, generate


def _looked_up(builder, coefficients, near, x, y, key):
    """Columns, rows and where the fragments project at all, in one earlier image: see ``fragments.lookup``."""
    u, v, w = (
        builder.fadd(
            builder.fadd(
                builder.fadd(
                    builder.fmul(splat(builder, DOUBLES, row[0]), x),
                    splat(builder, DOUBLES, builder.fmul(row[1], y)),
                ),
                splat(builder, DOUBLES, row[2]),
            ),
            builder.fmul(splat(builder, DOUBLES, row[3]), key),
        )
        for row in coefficients
    )
    zero, one = (constant(DOUBLES, [value] * LANES) for value in (0.0, 1.0))
    reached = builder.fcmp_ordered(">=", w, builder.fmul(splat(builder, DOUBLES, near), key))
    reached = builder.and_(reached, builder.fcmp_ordered(">", w, zero))
    inverse = builder.fdiv(one, w)
    return builder.fmul(u, inverse), builder.fmul(v, inverse), reached


def _has_triangle(builder, arrays, j, lanes, owner):
    """Which of the pixels earlier image ``j`` has: those where it holds the triangle that they project to.

    ``arrays``: ids, pixels and near of ``records.Earlier``; ``lanes``: centres x, the row's y, and stored keys.
    """
    known, pixels, near = arrays
    zeros = constant(DOUBLES, [0.0] * LANES)
    _, height, width = cgutils.unpack_tuple(builder, known.shape, 3)

    def number(data, index):
        return builder.load(cgutils.gep_inbounds(builder, data, index))

    at = builder.mul(j, ir.Constant(I64, 12))
    loaded = [number(pixels.data, builder.add(at, ir.Constant(I64, k))) for k in range(12)]
    u, v, inside = _looked_up(builder, [loaded[k : k + 4] for k in (0, 4, 8)], number(near.data, j), *lanes)
    for value, size in ((u, width), (v, height)):
        most = splat(builder, DOUBLES, builder.sitofp(size, ir.DoubleType()))
        inside = builder.and_(inside, builder.fcmp_ordered(">=", value, zeros))
        inside = builder.and_(inside, builder.fcmp_ordered("<", value, most))
    column, row = (builder.fptosi(builder.select(inside, value, zeros), LONGS) for value in (u, v))
    row = builder.add(splat(builder, LONGS, builder.mul(j, height)), row)
    spots = builder.add(builder.mul(row, splat(builder, LONGS, width)), column)
    values = ir.Constant(LONGS, ir.Undefined)
    for k in range(LANES):
        lane = ir.Constant(ir.IntType(32), k)
        value = number(known.data, builder.extract_element(spots, lane))
        values = builder.insert_element(values, value, lane)
    return builder.and_(builder.icmp_signed("==", values, owner), inside)


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
        new = is_nearer(builder, key, splat(builder, INTS, t_), here, held)
        new = builder.bitcast(builder.and_(new, lanes_of(builder, mask_)), I8)
        left = cgutils.alloca_once_value(builder, new)
        parts = zip(sig.args[6], cgutils.unpack_tuple(builder, earlier_, 3), strict=True)
        arrays = [context.make_array(kind)(context, builder, part) for kind, part in parts]
        x = builder.fadd(splat(builder, DOUBLES, first), constant(DOUBLES, [float(k) for k in range(LANES)]))
        ones, none = constant(DOUBLES, [1.0] * LANES), ir.Constant(I8, 0)
        owner = splat(builder, LONGS, builder.sext(t_, I64))
        count = cgutils.unpack_tuple(builder, arrays[0].shape, 3)[0]
        with builder.if_then(builder.icmp_unsigned("!=", new, none)):
            stored = builder.fpext(builder.fptrunc(builder.fdiv(ones, key), FLOATS), DOUBLES)
            lanes = (x, y, builder.fdiv(ones, stored))
            with cgutils.for_range(builder, count) as loop:
                rest = builder.load(left)
                with builder.if_then(builder.icmp_unsigned("!=", rest, none)):
                    seen = builder.bitcast(_has_triangle(builder, arrays, loop.index, lanes, owner), I8)
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
