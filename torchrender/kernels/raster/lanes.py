"""Eight pixels of a row at a time, in LLVM's own vectors.

LLVM makes vectors of long loops only; most rows of most triangles are shorter than that. Whatever the processor has
not, it takes apart. Masks have a bit per pixel, the first one lowest. Tiles start rows at multiples of LANES and all
LANES pixels must lie within the arrays: those that are masked out are written as they were.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.atomics import element

LANES = 8

_I8, _I64 = ir.IntType(8), ir.IntType(64)
_DOUBLES, _INTS, _LONGS = (ir.VectorType(t, LANES) for t in (ir.DoubleType(), ir.IntType(32), _I64))
_BITS = ir.VectorType(ir.IntType(1), LANES)
_FLOATS, _PAIRS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.FloatType(), 2 * LANES)


def _constant(kind, values):
    return ir.Constant(kind, [ir.Constant(kind.element, value) for value in values])


def _splat(builder, kind, value):
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    spread = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), spread)


def _place(context, builder, kind, array, index, vector):
    return builder.bitcast(element(context, builder, kind, array, index), vector.as_pointer())


def _mask(builder, bits, kind=_LONGS):
    """Of a mask (uint64), a bit for one or more lanes of this kind each: compared, as bits are taken apart singly."""
    own = _constant(kind, [1 << (k * LANES // kind.count) for k in range(kind.count)])
    spread = _splat(builder, kind, builder.trunc(bits, kind.element) if kind.element != _I64 else bits)
    return builder.icmp_signed("!=", builder.and_(spread, own), _constant(kind, [0] * kind.count))


def _call(builder, name, result, arguments):
    """One of LLVM's own functions."""
    kind = ir.FunctionType(result, [a.type for a in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def _whole(builder, values):
    """The values, to be stored all together: by a mask it takes dozens of steps, and the next load has to wait."""
    kind = values.type
    floats = {_INTS: _FLOATS, _LONGS: _DOUBLES}.get(kind, kind)
    name = f"llvm.arithmetic.fence.v{kind.count}{'f64' if floats == _DOUBLES else 'f32'}"
    return builder.bitcast(_call(builder, name, floats, [builder.bitcast(values, floats)]), kind)


def _store_lanes(builder, values, pointers, lanes):
    """Those of a mask (uint64); where all pixels are the thread's own, the others are written as they were."""
    mask, whole = lanes
    aligned = {_PAIRS: 4, _LONGS: 8}
    kinds = {_PAIRS: ir.VectorType(ir.IntType(32), 2 * LANES), _LONGS: _LONGS}
    with builder.if_else(builder.icmp_unsigned("==", mask, ir.Constant(_I64, 255))) as (every, some):
        with every:
            for value, pointer in zip(values, pointers, strict=True):
                builder.store(value, pointer).align = aligned[value.type]
        with some, builder.if_else(whole) as (blended, masked):
            with blended:
                for value, pointer in zip(values, pointers, strict=True):
                    held = builder.load(pointer)
                    held.align = aligned[value.type]
                    chosen = builder.select(_mask(builder, mask, kinds[value.type]), value, held)
                    builder.store(_whole(builder, chosen), pointer).align = aligned[value.type]
            with masked:
                for value, pointer in zip(values, pointers, strict=True):
                    bits = _mask(builder, mask, kinds[value.type])
                    name = f"llvm.masked.store.v{value.type.count}{'f32' if value.type == _PAIRS else 'i64'}.p0"
                    align = ir.Constant(ir.IntType(32), aligned[value.type])
                    _call(builder, name, ir.VoidType(), [value, pointer, align, bits])


@intrinsic
def covered_window(typingctx, edges):  # noqa: ARG001
    """uint64 with a bit for each pixel of 8 x 8 that lies inside three edges: bit ``8 y + x``.

    ``edges``: values at the first pixel, steps along x and steps along y, three int64 each; inside is >= 0.
    """
    signature = types.uint64(types.UniTuple(types.int64, 9))

    def generate(context, builder, sig, args):  # noqa: ARG001
        parts = cgutils.unpack_tuple(builder, args[0], 9)
        columns = _constant(_LONGS, range(LANES))
        values, steps = [], []
        for k in range(3):
            across = builder.mul(_splat(builder, _LONGS, parts[3 + k]), columns)
            values.append(builder.add(_splat(builder, _LONGS, parts[k]), across))
            steps.append(_splat(builder, _LONGS, parts[6 + k]))
        bits = ir.Constant(_I64, 0)
        for y in range(8):
            signs = builder.or_(builder.or_(values[0], values[1]), values[2])
            inside = builder.icmp_signed(">=", signs, _constant(_LONGS, [0] * LANES))
            row = builder.zext(builder.bitcast(inside, _I8), _I64)
            bits = builder.or_(bits, builder.shl(row, ir.Constant(_I64, LANES * y)))
            values = [builder.add(v, s) for v, s in zip(values, steps, strict=True)]
        return bits

    return signature, generate


@intrinsic
def reaches(typingctx, keys, place, mask, high):  # noqa: ARG001
    """True if one of the masked pixels from ``keys[place]`` on holds no more than ``high``."""
    signature = types.boolean(keys, types.uintp, types.uint64, types.float64)

    def generate(context, builder, sig, args):
        keys_, place_, mask_, high_ = args
        here = builder.load(_place(context, builder, sig.args[0], keys_, place_, _DOUBLES))
        here.align = 8
        reached = builder.fcmp_ordered("<=", here, _splat(builder, _DOUBLES, high_))
        found = builder.and_(builder.bitcast(reached, _I8), builder.trunc(mask_, _I8))
        return builder.icmp_unsigned("!=", found, ir.Constant(_I8, 0))

    return signature, generate


@intrinsic
def keep_nearest(typingctx, keys, ids, place, mask, plane, t):  # noqa: ARG001
    """Triangle ``t`` into those of the masked pixels from ``place`` on where it is nearer, or as near with a lower id.

    ``plane``: (key at column 0, step, column of the first pixel, least, greatest), float64.
    """
    signature = types.void(keys, ids, types.uintp, types.uint64, types.UniTuple(types.float64, 5), types.int32)

    def generate(context, builder, sig, args):
        keys_, ids_, place_, mask_, plane_, t_ = args
        key = _key_of(builder, cgutils.unpack_tuple(builder, plane_, 5))
        owner = _splat(builder, _INTS, t_)
        key_at = _place(context, builder, sig.args[0], keys_, place_, _DOUBLES)
        id_at = _place(context, builder, sig.args[1], ids_, place_, _INTS)
        here, held = builder.load(key_at), builder.load(id_at)
        here.align, held.align = 8, 4
        nearer = builder.and_(_is_nearer(builder, key, owner, here, held), _mask(builder, mask_))
        builder.store(_whole(builder, builder.select(nearer, key, here)), key_at).align = 8
        builder.store(_whole(builder, builder.select(nearer, owner, held)), id_at).align = 4
        return context.get_dummy_value()

    return signature, generate


def _key_of(builder, plane):
    """The keys of a row's pixels; ``plane`` as of :func:`keep_nearest`."""
    base, step, column, low, high = (_splat(builder, _DOUBLES, part) for part in plane)
    columns = builder.fadd(column, _constant(_DOUBLES, [float(k) for k in range(LANES)]))
    key = builder.fadd(base, builder.fmul(step, columns))
    key = builder.select(builder.fcmp_ordered(">", key, low), key, low)
    return builder.select(builder.fcmp_ordered("<", key, high), key, high)


def _is_nearer(builder, key, t, here, held):
    """Or as near with a lower id."""
    level = builder.and_(builder.fcmp_ordered("==", key, here), builder.icmp_signed("<", t, held))
    return builder.or_(builder.fcmp_ordered(">", key, here), level)


def _looked_up(builder, coefficients, near, x, y, key):
    """Columns, rows and where the fragments project at all, in one earlier image: see ``fragments.lookup``."""
    u, v, w = (
        builder.fadd(
            builder.fadd(
                builder.fadd(
                    builder.fmul(_splat(builder, _DOUBLES, row[0]), x),
                    _splat(builder, _DOUBLES, builder.fmul(row[1], y)),
                ),
                _splat(builder, _DOUBLES, row[2]),
            ),
            builder.fmul(_splat(builder, _DOUBLES, row[3]), key),
        )
        for row in coefficients
    )
    zero, one = (_constant(_DOUBLES, [value] * LANES) for value in (0.0, 1.0))
    reached = builder.fcmp_ordered(">=", w, builder.fmul(_splat(builder, _DOUBLES, near), key))
    reached = builder.and_(reached, builder.fcmp_ordered(">", w, zero))
    inverse = builder.fdiv(one, w)
    return builder.fmul(u, inverse), builder.fmul(v, inverse), reached


def _has_triangle(builder, arrays, j, lanes, owner):
    """Which of the pixels earlier image ``j`` has: those where it holds the triangle that they project to.

    ``arrays``: ids, pixels and near of ``records.Earlier``; ``lanes``: centres x, the row's y, and stored keys.
    """
    known, pixels, near = arrays
    zeros = _constant(_DOUBLES, [0.0] * LANES)
    _, height, width = cgutils.unpack_tuple(builder, known.shape, 3)

    def number(data, index):
        return builder.load(cgutils.gep_inbounds(builder, data, index))

    at = builder.mul(j, ir.Constant(_I64, 12))
    loaded = [number(pixels.data, builder.add(at, ir.Constant(_I64, k))) for k in range(12)]
    u, v, inside = _looked_up(builder, [loaded[k : k + 4] for k in (0, 4, 8)], number(near.data, j), *lanes)
    for value, size in ((u, width), (v, height)):
        most = _splat(builder, _DOUBLES, builder.sitofp(size, ir.DoubleType()))
        inside = builder.and_(inside, builder.fcmp_ordered(">=", value, zeros))
        inside = builder.and_(inside, builder.fcmp_ordered("<", value, most))
    column, row = (builder.fptosi(builder.select(inside, value, zeros), _LONGS) for value in (u, v))
    row = builder.add(_splat(builder, _LONGS, builder.mul(j, height)), row)
    spots = builder.add(builder.mul(row, _splat(builder, _LONGS, width)), column)
    values = ir.Constant(_LONGS, ir.Undefined)
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
        key = _key_of(builder, plane)
        here = builder.load(_place(context, builder, sig.args[0], keys_, place_, _DOUBLES))
        held = builder.load(_place(context, builder, sig.args[1], ids_, place_, _INTS))
        here.align, held.align = 8, 4
        new = _is_nearer(builder, key, _splat(builder, _INTS, t_), here, held)
        new = builder.bitcast(builder.and_(new, _mask(builder, mask_)), _I8)
        left = cgutils.alloca_once_value(builder, new)
        parts = zip(sig.args[6], cgutils.unpack_tuple(builder, earlier_, 3), strict=True)
        arrays = [context.make_array(kind)(context, builder, part) for kind, part in parts]
        x = builder.fadd(_splat(builder, _DOUBLES, first), _constant(_DOUBLES, [float(k) for k in range(LANES)]))
        ones, none = _constant(_DOUBLES, [1.0] * LANES), ir.Constant(_I8, 0)
        owner = _splat(builder, _LONGS, builder.sext(t_, _I64))
        count = cgutils.unpack_tuple(builder, arrays[0].shape, 3)[0]
        with builder.if_then(builder.icmp_unsigned("!=", new, none)):
            stored = builder.fpext(builder.fptrunc(builder.fdiv(ones, key), _FLOATS), _DOUBLES)
            lanes = (x, y, builder.fdiv(ones, stored))
            with cgutils.for_range(builder, count) as loop:
                rest = builder.load(left)
                with builder.if_then(builder.icmp_unsigned("!=", rest, none)):
                    seen = builder.bitcast(_has_triangle(builder, arrays, loop.index, lanes, owner), _I8)
                    builder.store(builder.and_(rest, builder.not_(seen)), left)
        return builder.zext(builder.load(left), _I64)

    return signature, generate


@intrinsic
def same_lanes(typingctx, ids, place, t):  # noqa: ARG001
    """Mask of the pixels from ``ids[place]`` on that hold triangle ``t``."""
    signature = types.uint64(ids, types.uintp, types.int32)

    def generate(context, builder, sig, args):
        ids_, place_, t_ = args
        held = builder.load(_place(context, builder, sig.args[0], ids_, place_, _INTS))
        held.align = 4
        same = builder.icmp_signed("==", held, _splat(builder, _INTS, t_))
        return builder.zext(builder.bitcast(same, _I8), _I64)

    return signature, generate


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
        ux, uc, vx, vc, column = (_splat(builder, _DOUBLES, p) for p in cgutils.unpack_tuple(builder, planes_, 5))
        first, weighted = cgutils.unpack_tuple(builder, source_, 2)
        depth = builder.load(_place(context, builder, sig.args[5], depths_, first, _DOUBLES))
        depth.align = 8
        one, zero = (_constant(_DOUBLES, [value] * LANES) for value in (1.0, 0.0))
        depth = builder.select(weighted, depth, one)
        x = builder.fadd(_constant(_DOUBLES, [float(k) for k in range(LANES)]), column)
        u = builder.fmul(builder.fadd(builder.fmul(ux, x), uc), depth)
        v = builder.fmul(builder.fadd(builder.fmul(vx, x), vc), depth)
        u = builder.select(builder.fcmp_ordered(">", u, zero), u, zero)
        u = builder.select(builder.fcmp_ordered("<", u, one), u, one)
        most = builder.fsub(one, u)
        v = builder.select(builder.fcmp_ordered(">", v, zero), v, zero)
        v = builder.select(builder.fcmp_ordered("<", v, most), v, most)
        both = ir.Constant(ir.VectorType(ir.IntType(32), 2 * LANES), [k // 2 + k % 2 * LANES for k in range(2 * LANES)])
        pairs = builder.shuffle_vector(builder.fptrunc(u, _FLOATS), builder.fptrunc(v, _FLOATS), both)
        values = (_splat(builder, _LONGS, owner_), pairs)
        arrays = cgutils.unpack_tuple(builder, images_, 2)
        places = [
            _image_place(context, builder, kind, array, place_, value.type)
            for kind, array, value in zip(sig.args[0], arrays, values, strict=True)
        ]
        _store_lanes(builder, values, places, cgutils.unpack_tuple(builder, lanes_, 2))
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
