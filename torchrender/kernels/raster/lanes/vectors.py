"""Eight pixels of a row, or eight rows, at a time in LLVM's own vectors: what the functions on them are made of.

LLVM makes vectors of long loops only; most rows of most triangles are shorter than that. Whatever the processor has
not, it takes apart.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils

from torchrender.kernels.atomics import element

LANES = 8
HALVES, QUADS = 2, 4  # vectors of QUADS float64 or int64 fill a register

I8, I64 = ir.IntType(8), ir.IntType(64)
DOUBLES, INTS, LONGS = (ir.VectorType(t, LANES) for t in (ir.DoubleType(), ir.IntType(32), I64))
FOUR_DOUBLES, FOUR_LONGS, FOUR_INTS = (ir.VectorType(t, QUADS) for t in (ir.DoubleType(), I64, ir.IntType(32)))
FLOATS, PAIRS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.FloatType(), 2 * LANES)


def constant(kind, values):
    return ir.Constant(kind, [ir.Constant(kind.element, value) for value in values])


def splat(builder, kind, value):
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    spread = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), spread)


def place_of(context, builder, kind, array, index, vector):
    return builder.bitcast(element(context, builder, kind, array, index), vector.as_pointer())


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
    size = kind.element.width if isinstance(kind.element, ir.IntType) else 64 if kind.element == ir.DoubleType() else 32
    floats = ir.VectorType(ir.DoubleType() if size == 64 else ir.FloatType(), kind.count)
    name = f"llvm.arithmetic.fence.v{kind.count}f{size}"
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


def half(builder, values, number):
    """One of the HALVES. What is compared of numbers of different sizes is compared by halves and as 64 bits each:
    LLVM makes 16 bits of each answer else, and packs and unpacks them time and again."""
    places = ir.Constant(ir.VectorType(ir.IntType(32), QUADS), [number * QUADS + k for k in range(QUADS)])
    return builder.shuffle_vector(values, ir.Constant(values.type, ir.Undefined), places)


def halves_of(builder, bits):
    """As :func:`lanes_of`, by halves."""
    spread = splat(builder, FOUR_LONGS, bits)
    for number in range(HALVES):
        own = constant(FOUR_LONGS, [1 << (number * QUADS + k) for k in range(QUADS)])
        yield builder.icmp_signed("==", builder.and_(spread, own), own)


def bits_of(builder, halves):
    """A byte with a bit for each lane, of answers by halves."""
    low, high = (builder.zext(builder.bitcast(part, ir.IntType(QUADS)), I8) for part in halves)
    return builder.or_(low, builder.shl(high, ir.Constant(I8, QUADS)))


def keep_halves(builder, places, key, t, counts):
    """Keys and the id into those of the lanes that count where they are nearer, or as near with a lower id.

    ``places``: of keys (float64) and ids (int32); ``counts``: by halves.
    """
    owner = splat(builder, FOUR_LONGS, builder.sext(t, I64))
    for number, counted in enumerate(counts):
        at = ir.Constant(ir.IntType(32), number)
        key_at, id_at = (
            builder.gep(builder.bitcast(place, kind.as_pointer()), [at])
            for place, kind in zip(places, (FOUR_DOUBLES, FOUR_INTS), strict=True)
        )
        here, held = builder.load(key_at), builder.load(id_at)
        here.align, held.align = 8, 4
        held = builder.sext(held, FOUR_LONGS)
        own = half(builder, key, number)
        nearer = builder.and_(is_nearer(builder, own, owner, here, held), counted)
        ids = builder.trunc(builder.select(nearer, owner, held), FOUR_INTS)
        builder.store(stored_whole(builder, builder.select(nearer, own, here)), key_at).align = 8
        builder.store(stored_whole(builder, ids), id_at).align = 4


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
