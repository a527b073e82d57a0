"""The rows of a triangle in a tile: which pixels they cover, whether any of these is reached, and drawing them.

Tiles have TILE_WIDTH columns. What is masked out is written as it was.
"""

from __future__ import annotations

import math

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.raster.lanes.vectors import (
    DOUBLES,
    FOUR_DOUBLES,
    FOUR_LONGS,
    HALVES,
    I8,
    I64,
    INTS,
    LANES,
    LONGS,
    bits_of,
    call,
    constant,
    half,
    keep_halves,
    key_of,
    own_function,
    place_of,
    splat,
)

COLUMN_BITS, ROW_BITS = 6, 5
TILE_WIDTH, TILE_HEIGHT = 1 << COLUMN_BITS, 1 << ROW_BITS
HAIR = 1e-6  # pixels by which a span's ends are guessed too wide before the exact test
FAR = 2.0**52  # an edge's step along a row is at most 2**45 (``project.GUARD``), that along a column, too

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
    """One edge, at the first column of eight rows: where it lets a span begin or end.

    All in float64, which is exact: an edge beyond FAR does not change its sign within a tile, so values end there.
    Spans end where the mirrored row begins: columns of edges that end them are counted with the other sign.
    """

    def __init__(self, builder, value, across, down, width):
        zero, one = ir.Constant(_DOUBLE, 0.0), ir.Constant(_DOUBLE, 1.0)
        value, across, down = (builder.sitofp(number, _DOUBLE) for number in (value, across, down))
        value = _lesser(builder, _larger(builder, value, ir.Constant(_DOUBLE, -FAR)), ir.Constant(_DOUBLE, FAR))
        begins = builder.fcmp_ordered(">=", across, zero)
        size = call(builder, "llvm.fabs.f64", _DOUBLE, [across])
        # A level edge lets a row in or not, and so does one that rises by less than one along it.
        size = builder.select(builder.fcmp_ordered("==", across, zero), ir.Constant(_DOUBLE, 1.0 / TILE_WIDTH), size)
        low = builder.select(begins, zero, builder.fneg(width))
        high = builder.select(begins, width, one)
        never, ever = ir.Constant(_DOUBLE, -math.inf), ir.Constant(_DOUBLE, math.inf)
        self.inverse, self.size, self.low, self.high, self.begins, self.ends = (
            splat(builder, DOUBLES, number)
            for number in (
                builder.fdiv(ir.Constant(_DOUBLE, -1.0), size), size, low, high,
                builder.select(begins, ever, never), builder.select(begins, never, ever),
            )
        )  # fmt: skip
        down = splat(builder, DOUBLES, down)
        rows = builder.fmul(down, constant(DOUBLES, range(LANES)))
        self.value = cgutils.alloca_once_value(builder, builder.fadd(splat(builder, DOUBLES, value), rows))
        self.on = builder.fmul(down, constant(DOUBLES, [LANES] * LANES))

    def narrow(self, builder, first, last):
        """The spans of eight rows within the edge, and the edge moved on by as many; ``last`` with the other sign.

        The division only guesses, a hair too wide; one exact test decides.
        """
        value = builder.load(self.value)
        builder.store(builder.fadd(value, self.on), self.value)
        guess = _larger(builder, builder.fmul(value, self.inverse), self.low)
        guess = builder.fsub(_lesser(builder, guess, self.high), constant(DOUBLES, [HAIR] * LANES))
        x = call(builder, f"llvm.ceil.v{LANES}f64", DOUBLES, [guess])
        none, one = (constant(DOUBLES, [number] * LANES) for number in (0.0, 1.0))
        outside = builder.fcmp_ordered("<", builder.fadd(value, builder.fmul(self.size, x)), none)
        x = builder.fadd(x, builder.select(outside, one, none))
        first = _larger(builder, first, _lesser(builder, x, self.begins))
        return first, _larger(builder, last, _lesser(builder, x, self.ends))


def _larger(builder, one, other):
    return builder.select(builder.fcmp_ordered(">", one, other), one, other)


def _lesser(builder, one, other):
    return builder.select(builder.fcmp_ordered("<", one, other), one, other)


def _find_body(builder, first, last, *numbers):
    *parts, rows, width = numbers
    wide = builder.sitofp(width, _DOUBLE)
    edges = [_Edge(builder, parts[k], parts[3 + k], parts[6 + k], wide) for k in range(3)]
    total = cgutils.alloca_once_value(builder, _NONE)
    most = splat(builder, DOUBLES, builder.fsub(ir.Constant(_DOUBLE, 1.0), wide))
    with cgutils.for_range_slice(builder, _number(0), rows, _number(LANES), I64) as (y, _):
        begin, end = constant(DOUBLES, [0.0] * LANES), most
        for edge in edges:
            begin, end = edge.narrow(builder, begin, end)
        # From -1 to the width of a tile.
        begin, end = (builder.sext(builder.fptosi(ends, INTS), LONGS) for ends in (begin, builder.fneg(end)))
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
    """Which of the pixels from column ``x`` on are neither before the one nor behind the other, by halves."""
    low, high = (splat(builder, FOUR_LONGS, builder.sub(v, x)) for v in (begin, end))
    for number in range(HALVES):
        counted = half(builder, _COUNTED, number)
        yield builder.and_(builder.icmp_signed(">=", counted, low), builder.icmp_signed("<=", counted, high))


def _each_vector(builder, span, work):
    """``work`` on the columns ``span`` = begin, end of a row, LANES at a time: given the first one and which count.

    They begin at multiples of LANES: what one triangle stores, the next one loads in the same parts, which processors
    hand over at once, and no part lies in two lines of the cache.
    """
    begin, end = span
    first = builder.and_(_least(builder, begin, _number(TILE_WIDTH - 1)), _number(-LANES))
    x = cgutils.alloca_once_value(builder, first)
    loop, done = builder.append_basic_block("vector"), builder.append_basic_block("done")
    builder.branch(loop)
    builder.position_at_end(loop)
    here = builder.load(x)
    work(here, _lanes_between(builder, begin, end, here))
    builder.store(builder.add(here, _number(LANES)), x)
    more = builder.icmp_signed(">", end, builder.add(here, _number(LANES - 1)))
    builder.cbranch(more, loop, done)
    builder.position_at_end(done)


def _reach_body(builder, keys, first, last, x0, rows, high):
    spread = splat(builder, FOUR_DOUBLES, high)
    found = cgutils.alloca_once_value(builder, ir.Constant(I8, 0))
    with cgutils.for_range_slice(builder, _number(0), rows, _number(1), I64) as (y, _):
        span = [builder.add(x0, _load(builder, ends, y)) for ends in (first, last)]
        row = builder.mul(y, _number(TILE_WIDTH))

        def look(x, counts, row=row):
            here = _load(builder, keys, builder.add(row, x), DOUBLES)
            reached = [
                builder.and_(counted, builder.fcmp_ordered("<=", half(builder, here, number), spread))
                for number, counted in enumerate(counts)
            ]
            builder.store(builder.or_(builder.load(found), bits_of(builder, reached)), found)

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
            keep_halves(builder, [builder.gep(array, [place]) for array in (keys, ids)], key, t, counts)

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
