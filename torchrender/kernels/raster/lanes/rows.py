"""The rows of a triangle in a tile: which pixels they cover, whether any of these is reached, and drawing them.

Tiles have TILE_WIDTH columns. Vectors that would end beyond a row start earlier; what is masked out is written as it
was.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.raster.lanes.vectors import (
    DOUBLES,
    I8,
    I64,
    INTS,
    LANES,
    LONGS,
    as_doubles,
    call,
    constant,
    is_nearer,
    key_of,
    own_function,
    place_of,
    splat,
    stored_whole,
)

COLUMN_BITS, ROW_BITS = 6, 5
TILE_WIDTH, TILE_HEIGHT = 1 << COLUMN_BITS, 1 << ROW_BITS
HAIR = 1e-6  # pixels by which a span's ends are guessed too wide before the exact test

_I32, _DOUBLE = ir.IntType(32), ir.DoubleType()
_NONE, _COUNTED = constant(LONGS, [0] * LANES), constant(LONGS, range(LANES))


def _number(value):
    return ir.Constant(I64, value)


def _load(builder, pointer, index, vector=None):
    """An element, or a vector from there on."""
    place = builder.gep(pointer, [index])
    if vector is None:
        return builder.load(place)
    loaded = builder.load(builder.bitcast(place, vector.as_pointer()))
    loaded.align = vector.element.width // 8 if isinstance(vector.element, ir.IntType) else 8
    return loaded


def _store(builder, value, pointer, index):
    place = builder.bitcast(builder.gep(pointer, [index]), value.type.as_pointer())
    builder.store(value, place).align = 4 if value.type == INTS else 8


def _least(builder, one, other):
    return builder.select(builder.icmp_signed("<", one, other), one, other)


class _Edge:
    """One edge, at the first column of eight rows: where it lets a span begin or end."""

    def __init__(self, builder, value, across, down, width):
        zero, none = _number(0), ir.Constant(_DOUBLE, 0.0)
        self.level = builder.icmp_signed("==", across, zero)
        self.begins, self.ends = (builder.icmp_signed(sign, across, zero) for sign in "><")
        step = builder.sitofp(across, _DOUBLE)
        inverse = builder.select(self.level, none, builder.fdiv(ir.Constant(_DOUBLE, -1.0), step))
        sign = builder.select(self.ends, _number(-1), _number(1))
        least = builder.select(self.ends, ir.Constant(_DOUBLE, -1.0), none)
        self.inverse, self.least, self.most, self.turn = (
            splat(builder, DOUBLES, v)
            for v in (inverse, least, builder.sitofp(width, _DOUBLE), builder.sitofp(sign, _DOUBLE))
        )
        self.across, self.sign = splat(builder, LONGS, across), splat(builder, LONGS, sign)
        rows = builder.mul(splat(builder, LONGS, down), _COUNTED)
        self.value = cgutils.alloca_once_value(builder, builder.add(splat(builder, LONGS, value), rows))
        self.on = splat(builder, LONGS, builder.mul(down, _number(LANES)))

    def narrow(self, builder, first, last):
        """The spans of eight rows within the edge, and the edge moved on by as many.

        The division only guesses, a hair too wide; one exact integer test decides.
        """
        value = builder.load(self.value)
        builder.store(builder.add(value, self.on), self.value)
        guess = builder.fmul(as_doubles(builder, value), self.inverse)
        guess = builder.select(builder.fcmp_ordered("<", guess, self.least), self.least, guess)
        guess = builder.select(builder.fcmp_ordered(">", guess, self.most), self.most, guess)
        # The floor of a number is minus the ceiling of minus the number: one way for both ends.
        wide = builder.fsub(builder.fmul(guess, self.turn), constant(DOUBLES, [HAIR] * LANES))
        wide = builder.fmul(call(builder, f"llvm.ceil.v{LANES}f64", DOUBLES, [wide]), self.turn)
        x = builder.sext(builder.fptosi(wide, INTS), LONGS)  # from -1 to the width of a tile
        outside = builder.icmp_signed("<", builder.add(value, builder.mul(self.across, x)), _NONE)
        x = builder.add(x, builder.select(outside, self.sign, _NONE))
        begin = builder.select(builder.icmp_signed(">", x, first), x, first)
        end = builder.select(builder.icmp_signed("<", x, last), x, last)
        first, last = builder.select(self.begins, begin, first), builder.select(self.ends, end, last)
        missed = builder.select(builder.icmp_signed("<", value, _NONE), constant(LONGS, [-1] * LANES), last)
        return first, builder.select(self.level, missed, last)


def _find_body(builder, first, last, *numbers):
    *parts, rows, width = numbers
    edges = [_Edge(builder, parts[k], parts[3 + k], parts[6 + k], width) for k in range(3)]
    total = cgutils.alloca_once_value(builder, _NONE)
    most = splat(builder, LONGS, builder.sub(width, _number(1)))
    with cgutils.for_range_slice(builder, _number(0), rows, _number(LANES), I64) as (y, _):
        begin, end = _NONE, most
        for edge in edges:
            begin, end = edge.narrow(builder, begin, end)
        there = builder.icmp_signed("<", builder.add(splat(builder, LONGS, y), _COUNTED), splat(builder, LONGS, rows))
        end = builder.select(there, end, constant(LONGS, [-1] * LANES))
        _store(builder, begin, first, y)
        _store(builder, end, last, y)
        count = builder.add(builder.sub(end, begin), constant(LONGS, [1] * LANES))
        count = builder.select(builder.icmp_signed(">", count, _NONE), count, _NONE)
        builder.store(builder.add(builder.load(total), count), total)
    builder.ret(call(builder, f"llvm.vector.reduce.add.v{LANES}i64", I64, [builder.load(total)]))


@intrinsic
def find_rows(typingctx, first, last, edges, rows, width):  # noqa: ARG001
    """Fill ``first[y]..last[y]`` (inclusive; the last may be the lesser one) of rows inside three edges; exact.

    Returns the number of pixels. ``first``, ``last``: TILE_HEIGHT int64 each, of which as many are written as are whole
    groups of LANES; ``edges``: values at the first pixel, steps along x and steps along y, three int64 each; inside is
    >= 0.
    """
    signature = types.int64(first, last, types.UniTuple(types.int64, 9), types.int64, types.int64)

    def generate(context, builder, sig, args):
        ends = [place_of(context, builder, sig.args[k], args[k], _number(0), I64) for k in range(2)]
        parts = cgutils.unpack_tuple(builder, args[2], 9)
        kinds = [I64.as_pointer()] * 2 + [I64] * 11
        return builder.call(
            own_function(builder, "torchrender_find_rows", I64, kinds, _find_body), [*ends, *parts, args[3], args[4]]
        )

    return signature, generate


def _lanes_between(builder, begin, end, x):
    """Which of the pixels from column ``x`` on are neither before the one nor behind the other."""
    low, high = (splat(builder, LONGS, builder.sub(v, x)) for v in (begin, end))
    return builder.and_(builder.icmp_signed(">=", _COUNTED, low), builder.icmp_signed("<=", _COUNTED, high))


def _each_vector(builder, span, work):
    """``work`` on the columns ``span`` = begin, end of a row, LANES at a time: given the first one and which count."""
    begin, end = span
    most = _number(TILE_WIDTH - LANES)
    x = cgutils.alloca_once_value(builder, _least(builder, begin, most))
    loop, done = builder.append_basic_block("vector"), builder.append_basic_block("done")
    builder.branch(loop)
    builder.position_at_end(loop)
    here = builder.load(x)
    work(here, _lanes_between(builder, begin, end, here))
    builder.store(_least(builder, builder.add(here, _number(LANES)), most), x)
    more = builder.icmp_signed(">", end, builder.add(here, _number(LANES - 1)))
    builder.cbranch(more, loop, done)
    builder.position_at_end(done)


def _reach_body(builder, keys, first, last, x0, rows, high):
    spread = splat(builder, DOUBLES, high)
    found = cgutils.alloca_once_value(builder, ir.Constant(I8, 0))
    with cgutils.for_range_slice(builder, _number(0), rows, _number(1), I64) as (y, _):
        span = [builder.add(x0, _load(builder, ends, y)) for ends in (first, last)]
        row = builder.mul(y, _number(TILE_WIDTH))

        def look(x, counts, row=row):
            here = _load(builder, keys, builder.add(row, x), DOUBLES)
            reached = builder.and_(counts, builder.fcmp_ordered("<=", here, spread))
            builder.store(builder.or_(builder.load(found), builder.bitcast(reached, I8)), found)

        _each_vector(builder, span, look)
        # Once in a while: a branch for each row would be foretold wrongly.
        ending = builder.icmp_signed("==", builder.and_(y, _number(LANES - 1)), _number(LANES - 1))
        with builder.if_then(builder.and_(ending, builder.icmp_signed("!=", builder.load(found), ir.Constant(I8, 0)))):
            builder.ret(ir.Constant(ir.IntType(1), 1))
    builder.ret(builder.icmp_signed("!=", builder.load(found), ir.Constant(I8, 0)))


@intrinsic
def rows_reach(typingctx, keys, first, last, box, high):  # noqa: ARG001
    """True if a pixel of the spans of :func:`find_rows` holds no more than the key ``high``.

    ``box``: first column in the tile, number of rows, and where the pixels of the first one's row begin in ``keys``.
    """
    signature = types.boolean(keys, first, last, types.UniTuple(types.int64, 3), types.float64)

    def generate(context, builder, sig, args):
        x0, rows, start = cgutils.unpack_tuple(builder, args[3], 3)
        row = place_of(context, builder, sig.args[0], args[0], start, _DOUBLE)
        ends = [place_of(context, builder, sig.args[k], args[k], _number(0), I64) for k in (1, 2)]
        kinds = [_DOUBLE.as_pointer()] + [I64.as_pointer()] * 2 + [I64, I64, _DOUBLE]
        own = own_function(builder, "torchrender_rows_reach", ir.IntType(1), kinds, _reach_body)
        return builder.call(own, [row, *ends, x0, rows, args[4]])

    return signature, generate


def _fill_body(builder, keys, ids, first, last, *numbers):
    x0, y0, rows, small, t, kx, ky, kc, low, high = numbers
    owner = splat(builder, INTS, t)
    with cgutils.for_range_slice(builder, _number(0), rows, _number(1), I64) as (k, _):
        span = [builder.add(x0, _load(builder, ends, k)) for ends in (first, last)]
        y = builder.add(y0, k)
        row = builder.mul(y, _number(TILE_WIDTH))
        start = builder.select(small, _number(0), row)
        base = builder.fadd(kc, builder.fmul(ky, builder.sitofp(y, _DOUBLE)))
        base = builder.fsub(base, builder.fmul(kx, builder.sitofp(start, _DOUBLE)))

        def keep(x, counts, row=row, start=start, base=base):
            place = builder.add(row, x)
            key = key_of(builder, (base, kx, builder.sitofp(builder.add(start, x), _DOUBLE), low, high))
            here, held = _load(builder, keys, place, DOUBLES), _load(builder, ids, place, INTS)
            nearer = builder.and_(is_nearer(builder, key, owner, here, held), counts)
            _store(builder, stored_whole(builder, builder.select(nearer, key, here)), keys, place)
            _store(builder, stored_whole(builder, builder.select(nearer, owner, held)), ids, place)

        _each_vector(builder, span, keep)
    builder.ret_void()


@intrinsic
def fill_rows(typingctx, keys, ids, ends, box, plane, t):  # noqa: ARG001
    """Triangle ``t`` into the spans of :func:`find_rows` where it is nearer, or as near with a lower id.

    ``ends``: first and last pixels; ``box``: first column, first row and number of rows in the tile, where the tile's
    pixels begin, and whether columns count from the start of their rows, not from that of the tile: the keys round
    differently. ``plane``: key at the tile's first pixel after steps along x and y, then the least and greatest one.
    """
    signature = types.void(
        keys, ids, ends, types.UniTuple(types.int64, 5), types.UniTuple(types.float64, 5), types.int32
    )

    def generate(context, builder, sig, args):
        x0, y0, rows, start, small = cgutils.unpack_tuple(builder, args[3], 5)
        key_at = place_of(context, builder, sig.args[0], args[0], start, _DOUBLE)
        id_at = place_of(context, builder, sig.args[1], args[1], start, _I32)
        both = cgutils.unpack_tuple(builder, args[2], 2)
        spans = [place_of(context, builder, k, a, _number(0), I64) for k, a in zip(sig.args[2], both, strict=True)]
        small = builder.icmp_signed("!=", small, _number(0))
        plane = cgutils.unpack_tuple(builder, args[4], 5)
        kinds = [_DOUBLE.as_pointer(), _I32.as_pointer()] + [I64.as_pointer()] * 2
        kinds += [I64] * 3 + [small.type, _I32] + [_DOUBLE] * 5
        own = own_function(builder, "torchrender_fill_rows", ir.VoidType(), kinds, _fill_body)
        builder.call(own, [key_at, id_at, *spans, x0, y0, rows, small, args[5], *plane])
        return context.get_dummy_value()

    return signature, generate
