"""Finished pixels into images, eight of a row at a time: objects and barycentric weights of the triangles they hold."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.raster.lanes.vectors import (
    DOUBLES,
    FLOATS,
    I64,
    INTS,
    LANES,
    LONGS,
    PAIRS,
    call,
    constant,
    lanes_of,
    place_of,
    splat,
    stored_whole,
)


def _store_lanes(builder, values, pointers, lanes):
    """Those of a mask (uint64); where all pixels are the thread's own, the others are written as they were."""
    mask, whole = lanes
    aligned = {PAIRS: 4, LONGS: 8}
    kinds = {PAIRS: ir.VectorType(ir.IntType(32), 2 * LANES), LONGS: LONGS}
    with builder.if_else(builder.icmp_unsigned("==", mask, ir.Constant(I64, 255))) as (every, some):
        with every:
            for value, pointer in zip(values, pointers, strict=True):
                builder.store(value, pointer).align = aligned[value.type]
        with some, builder.if_else(whole) as (blended, masked):
            with blended:
                for value, pointer in zip(values, pointers, strict=True):
                    held = builder.load(pointer)
                    held.align = aligned[value.type]
                    chosen = builder.select(lanes_of(builder, mask, kinds[value.type]), value, held)
                    builder.store(stored_whole(builder, chosen), pointer).align = aligned[value.type]
            with masked:
                for value, pointer in zip(values, pointers, strict=True):
                    bits = lanes_of(builder, mask, kinds[value.type])
                    name = f"llvm.masked.store.v{value.type.count}{'f32' if value.type == PAIRS else 'i64'}.p0"
                    align = ir.Constant(ir.IntType(32), aligned[value.type])
                    call(builder, name, ir.VoidType(), [value, pointer, align, bits])


def _weights(builder, planes, column, depth):
    """Barycentric weights of LANES pixels, as pairs: see :func:`write_seen`."""
    ux, uc, vx, vc = planes
    one, zero = (constant(DOUBLES, [value] * LANES) for value in (1.0, 0.0))
    x = builder.fadd(constant(DOUBLES, [float(k) for k in range(LANES)]), column)
    u = builder.fmul(builder.fadd(builder.fmul(ux, x), uc), depth)
    v = builder.fmul(builder.fadd(builder.fmul(vx, x), vc), depth)
    u = builder.select(builder.fcmp_ordered(">", u, zero), u, zero)
    u = builder.select(builder.fcmp_ordered("<", u, one), u, one)
    most = builder.fsub(one, u)
    v = builder.select(builder.fcmp_ordered(">", v, zero), v, zero)
    v = builder.select(builder.fcmp_ordered("<", v, most), v, most)
    both = ir.Constant(ir.VectorType(ir.IntType(32), 2 * LANES), [k // 2 + k % 2 * LANES for k in range(2 * LANES)])
    return builder.shuffle_vector(builder.fptrunc(u, FLOATS), builder.fptrunc(v, FLOATS), both)


def _store_seen(context, builder, images, place, values, lanes):
    """Objects and pairs of weights into the masked pixels; ``images``: their types and values."""
    places = [
        _image_place(context, builder, kind, array, place, value.type)
        for (kind, array), value in zip(images, values, strict=True)
    ]
    _store_lanes(builder, values, places, lanes)


@intrinsic
def write_seen(typingctx, images, place, lanes, owner, planes, depths, source):  # noqa: ARG001
    """Object and barycentric weights of a triangle into some of the pixels from ``place`` = row, column on.

    ``images``: (H,W) int64 and (H,W,2) float32; ``lanes``: a mask of the pixels, and whether all LANES of them lie
    within the part of the image that the thread writes; ``planes``: steps along x and values at column 0 of the second
    and third weight over depth, and the first column; ``source``: first of ``depths`` and whether these count.
    """
    if any(image.layout != "C" for image in images):
        return None
    signature = types.void(
        images, types.UniTuple(types.uintp, 2), types.Tuple((types.uint64, types.boolean)), types.int64,
        types.UniTuple(types.float64, 5), depths, types.Tuple((types.uintp, types.boolean)),
    )  # fmt: skip

    def generate(context, builder, sig, args):
        images_, place_, lanes_, owner_, planes_, depths_, source_ = args
        ux, uc, vx, vc, column = (splat(builder, DOUBLES, p) for p in cgutils.unpack_tuple(builder, planes_, 5))
        first, weighted = cgutils.unpack_tuple(builder, source_, 2)
        depth = builder.load(place_of(context, builder, sig.args[5], depths_, first, DOUBLES))
        depth.align = 8
        depth = builder.select(weighted, depth, constant(DOUBLES, [1.0] * LANES))
        pairs = _weights(builder, (ux, uc, vx, vc), column, depth)
        values = (splat(builder, LONGS, owner_), pairs)
        images = list(zip(sig.args[0], cgutils.unpack_tuple(builder, images_, 2), strict=True))
        _store_seen(context, builder, images, place_, values, cgutils.unpack_tuple(builder, lanes_, 2))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def write_mixed(typingctx, images, place, lanes, known, tables, depths, spot):  # noqa: ARG001
    """As :func:`write_seen`, of pixels that hold different triangles.

    ``known``: ids, first of them and of ``depths``, and the bits of an id that tell its row of planes; ``tables``:
    planes (N,6), steps along x and y and value of the second weight over depth, then of the third, and objects (F,) of
    all triangles; ``spot``: the first column, the row, and whether depths count.
    """
    if any(part.layout != "C" for part in (*images, known[0], *tables)):
        return None
    signature = types.void(
        images, types.UniTuple(types.uintp, 2), types.Tuple((types.uint64, types.boolean)),
        types.Tuple((known[0], types.uintp, types.int32)), tables, depths,
        types.Tuple((types.float64, types.float64, types.boolean)),
    )  # fmt: skip

    def generate(context, builder, sig, args):
        images_, place_, lanes_, known_, tables_, depths_, spot_ = args
        ids_, first, bits = cgutils.unpack_tuple(builder, known_, 3)
        column, row, weighted = cgutils.unpack_tuple(builder, spot_, 3)
        held = builder.load(place_of(context, builder, sig.args[3][0], ids_, first, INTS))
        depth = builder.load(place_of(context, builder, sig.args[5], depths_, first, DOUBLES))
        held.align, depth.align = 4, 8
        there = builder.icmp_signed(">=", held, constant(INTS, [0] * LANES))
        slots = builder.zext(builder.and_(held, splat(builder, INTS, bits)), LONGS)
        some = builder.sext(builder.select(there, held, constant(INTS, [0] * LANES)), LONGS)
        table, owners_of = (
            context.make_array(kind)(context, builder, array).data
            for kind, array in zip(sig.args[4], cgutils.unpack_tuple(builder, tables_, 2), strict=True)
        )
        parts, owners = [ir.Constant(DOUBLES, ir.Undefined)] * 6, ir.Constant(LONGS, ir.Undefined)
        for k in range(LANES):
            lane = ir.Constant(ir.IntType(32), k)
            begin = builder.mul(builder.extract_element(slots, lane), ir.Constant(I64, 6))
            for n in range(6):
                value = builder.load(cgutils.gep_inbounds(builder, table, builder.add(begin, ir.Constant(I64, n))))
                parts[n] = builder.insert_element(parts[n], value, lane)
            owner = builder.load(cgutils.gep_inbounds(builder, owners_of, builder.extract_element(some, lane)))
            owners = builder.insert_element(owners, owner, lane)
        none = constant(DOUBLES, [0.0] * LANES)
        ux, uy, uc, vx, vy, vc = (builder.select(there, part, none) for part in parts)
        y = splat(builder, DOUBLES, row)
        uc, vc = (builder.fadd(builder.fmul(step, y), c) for step, c in ((uy, uc), (vy, vc)))
        ones = constant(DOUBLES, [1.0] * LANES)
        depth = builder.select(there, builder.select(weighted, depth, ones), ones)
        pairs = _weights(builder, (ux, uc, vx, vc), splat(builder, DOUBLES, column), depth)
        owners = builder.select(there, owners, constant(LONGS, [-1] * LANES))
        images = list(zip(sig.args[0], cgutils.unpack_tuple(builder, images_, 2), strict=True))
        _store_seen(context, builder, images, place_, (owners, pairs), cgutils.unpack_tuple(builder, lanes_, 2))
        return context.get_dummy_value()

    return signature, generate


def _image_place(context, builder, kind, array, place, vector):
    """Pixel ``place`` = row, column of a contiguous image."""
    view = context.make_array(kind)(context, builder, array)
    row, column = cgutils.unpack_tuple(builder, place, 2)
    shape = cgutils.unpack_tuple(builder, view.shape, kind.ndim)
    index = builder.add(builder.mul(row, shape[1]), column)
    if kind.ndim == 3:
        index = builder.mul(index, shape[2])
    return builder.bitcast(cgutils.gep_inbounds(builder, view.data, index), vector.as_pointer())
