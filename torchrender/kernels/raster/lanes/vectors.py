"""Eight pixels of a row, or eight rows, at a time in LLVM's own vectors: what the functions on them are made of.

LLVM makes vectors of long loops only; most rows of most triangles are shorter than that. Whatever the processor has
not, it takes apart.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils

from torchrender.kernels.atomics import element

LANES = 8

I8, I64 = ir.IntType(8), ir.IntType(64)
DOUBLES, INTS, LONGS = (ir.VectorType(t, LANES) for t in (ir.DoubleType(), ir.IntType(32), I64))
FLOATS, PAIRS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.FloatType(), 2 * LANES)


def constant(kind, values):
    return ir.Constant(kind, [ir.Constant(kind.element, value) for value in values])


def splat(builder, kind, value):
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    spread = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), spread)


def place_of(context, builder, kind, array, index, vector):
    return builder.bitcast(element(context, builder, kind, array, index), vector.as_pointer())


def as_doubles(builder, values):
    """LANES int64, each rounded to the nearest float64. Processors with vectors of 256 bits convert them one by one.

    Each half of a number, put into the digits of a large float64, is exact there; the only rounding is that of the sum.
    """
    whole, half = constant(LONGS, [32] * LANES), constant(LONGS, [(1 << 32) - 1] * LANES)
    low = builder.or_(builder.and_(values, half), constant(LONGS, [0x43300000 << 32] * LANES))  # 2^52 + low
    high = builder.xor(builder.lshr(values, whole), constant(LONGS, [0x4530000080000000] * LANES))
    # 2^84 + 2^63 + high, of which all but the last is taken off, and the 2^52 of the lower half.
    high = builder.fsub(builder.bitcast(high, DOUBLES), constant(DOUBLES, [2.0**84 + 2.0**63 + 2.0**52] * LANES))
    return builder.fadd(high, builder.bitcast(low, DOUBLES))


def lanes_of(builder, bits, kind=LONGS):
    """Of a mask (uint64), a bit for one or more lanes of this kind each: compared, as bits are taken apart singly."""
    own = constant(kind, [1 << (k * LANES // kind.count) for k in range(kind.count)])
    spread = splat(builder, kind, builder.trunc(bits, kind.element) if kind.element != I64 else bits)
    return builder.icmp_signed("!=", builder.and_(spread, own), constant(kind, [0] * kind.count))


def call(builder, name, result, arguments):
    """One of LLVM's own functions."""
    kind = ir.FunctionType(result, [a.type for a in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def stored_whole(builder, values):
    """The values, to be stored all together: by a mask it takes dozens of steps, and the next load has to wait."""
    kind = values.type
    floats = {INTS: FLOATS, LONGS: DOUBLES}.get(kind, kind)
    name = f"llvm.arithmetic.fence.v{kind.count}{'f64' if floats == DOUBLES else 'f32'}"
    return builder.bitcast(call(builder, name, floats, [builder.bitcast(values, floats)]), kind)


def key_of(builder, plane):
    """The keys of a row's pixels; ``plane`` as of :func:`~.pixels.keep_nearest`."""
    base, step, column, low, high = (splat(builder, DOUBLES, part) for part in plane)
    columns = builder.fadd(column, constant(DOUBLES, [float(k) for k in range(LANES)]))
    key = builder.fadd(base, builder.fmul(step, columns))
    key = builder.select(builder.fcmp_ordered(">", key, low), key, low)
    return builder.select(builder.fcmp_ordered("<", key, high), key, high)


def is_nearer(builder, key, t, here, held):
    """Or as near with a lower id."""
    level = builder.and_(builder.fcmp_ordered("==", key, here), builder.icmp_signed("<", t, held))
    return builder.or_(builder.fcmp_ordered(">", key, here), level)


def own_function(builder, name, result, kinds, body):
    """A function of this module, made once: loops that are worth a call, because within a long function LLVM works out
    beforehand, for every triangle, what only a few of their turns need.

    ``body``: writes it, given a builder and the arguments; ``result`` and ``kinds``: types.
    """
    made = builder.module.globals.get(name)
    if made is None:
        made = ir.Function(builder.module, ir.FunctionType(result, kinds), name)
        made.linkage = "linkonce_odr"
        made.attributes.add("noinline")
        made.attributes.add("nounwind")
        body(ir.IRBuilder(made.append_basic_block("entry")), *made.args)
    return made
