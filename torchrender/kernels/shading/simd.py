"""Functions of float32 without branches, so that loops over pixels run several at a time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import float32, int32, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

from torchrender.kernels.compile import kernel

f4 = np.float32
LEVEL = f4(3e-7)
"""What float32 makes of heights of zero, of the sizes of the two places: a light that low lies in the surface."""
MOST_BENT = f4(0.5)
"""Cosine between the interpolated normal and the triangle's, down to which it is that of a smooth surface: below, the
triangle's own plane counts."""
ZERO, HALF, ONE, TWO, TINY = f4(0), f4(0.5), f4(1), f4(2), f4(1e-36)
PI, HALF_PI, INV_PI = f4(math.pi), f4(math.pi / 2), f4(1 / math.pi)
ATAN = tuple(map(f4, (0.999999901, -0.3333199067, 0.1996972268, -0.1401947354, 0.09914271676, -0.05948608176,
                      0.02425217598, -0.004693210971)))  # fmt: skip
"""atan(q)/q in q^2 on [0,1], to 1e-7."""
LOG = tuple(map(f4, (1.442695004, -0.7213473469, 0.4809106431, -0.3607036763, 0.2879162366, -0.238944961,
                     0.2157158636, -0.2072688815, 0.1258352495)))  # fmt: skip
"""log2(1+f)/f on [-0.29,0.41], to 3e-8."""
EXP = tuple(map(f4, (1.000000072, 0.6931469671, 0.2402211972, 0.05550713291, 0.00967554129, 0.001327646641)))
"""2^f on [-0.5,0.5], to 1e-7."""


def _cast(source: Any, target: Any) -> Any:
    @intrinsic
    def cast(context: Any, x: Any) -> Any:  # noqa: ARG001
        def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
            return builder.bitcast(args[0], ir.IntType(32) if target is int32 else ir.FloatType())

        return target(source), make

    return cast


bits_of, float_of = _cast(float32, int32), _cast(int32, float32)


@intrinsic
def weighed(context: Any, values: Any, places: Any, weights: Any) -> Any:  # noqa: ARG001
    """Sum of ``values[place : place + 4]`` times the weights, four float32 at once.

    ``values`` float32 or uint16 lie row by row, and three more that follow them may be read; ``places`` (K,) int64
    count their numbers.
    """
    four = ir.VectorType(ir.FloatType(), 4)
    halves = ir.VectorType(ir.IntType(16), 4)
    short = values.dtype == types.uint16

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        first = arrayobj.make_array(signature.args[0])(context, builder, value=args[0]).data
        total = None
        for k in range(len(signature.args[1])):
            place, weight = (builder.extract_value(one, k) for one in args[1:])
            pointer = builder.bitcast(builder.gep(first, [place]), (halves if short else four).as_pointer())
            read = builder.load(pointer, align=2 if short else 4)
            if short:  # by way of signed numbers, which processors turn into floats at once
                read = builder.sitofp(builder.zext(read, ir.VectorType(ir.IntType(32), 4)), four)
            wide = builder.insert_element(ir.Constant(four, ir.Undefined), weight, ir.IntType(32)(0))
            wide = builder.shuffle_vector(wide, wide, ir.Constant(ir.VectorType(ir.IntType(32), 4), [0, 0, 0, 0]))
            part = builder.fmul(wide, read)
            total = part if total is None else builder.fadd(total, part)
        found = [builder.extract_element(total, ir.IntType(32)(k)) for k in range(4)]
        return cgutils.pack_array(builder, found)

    return types.UniTuple(types.float32, 4)(values, places, weights), make


_LOW, _HIGH = (0, 8, 1, 9, 4, 12, 5, 13), (2, 10, 3, 11, 6, 14, 7, 15)
_FIRST, _LAST = (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)
_LEFT, _RIGHT, _BOTH = (0, 1, 2, 3, 8, 9, 10, 11), (4, 5, 6, 7, 12, 13, 14, 15), (0, 1, 2, 3, 4, 5, 6, 7)
"""Which of the numbers of two vectors of eight a step of :func:`columns` takes, in halves of four; _BOTH: of four."""


@intrinsic
def columns(context: Any, values: Any, places: Any, target: Any, slots: Any) -> Any:  # noqa: ARG001
    """Eight rows of four or eight numbers of 32 bits, from ``values[place]`` on each, into columns of eight:
    ``target[slot : slot + 8]`` for each number of a row. ``places`` (8,) int64, ``slots`` (4,) or (8,) int64.
    """
    assert len(places) == 8 and len(slots) in (4, 8)

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        width = len(signature.args[3])
        row, column = (ir.VectorType(ir.FloatType(), size).as_pointer() for size in (width, 8))
        source, sink = (arrayobj.make_array(signature.args[k])(context, builder, value=args[k]).data for k in (0, 2))

        def mixed(a: Any, b: Any, taken: tuple[int, ...]) -> Any:
            return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), 8), list(taken)))

        addresses = [builder.gep(source, [builder.extract_value(args[1], k)]) for k in range(8)]
        rows = [builder.load(builder.bitcast(one, row), align=4) for one in addresses]
        if width == 4:
            rows = [mixed(rows[k], rows[k + 4], _BOTH) for k in range(4)]
        pairs = [mixed(rows[k], rows[k + 1], how) for k in range(0, len(rows), 2) for how in (_LOW, _HIGH)]
        fours = [
            mixed(pairs[k + half], pairs[k + half + 2], how)
            for k in range(0, len(rows), 4)
            for half in (0, 1)
            for how in (_FIRST, _LAST)
        ]
        if width == 8:
            fours = [mixed(fours[k], fours[k + 4], how) for how in (_LEFT, _RIGHT) for k in range(4)]
        for k, found in enumerate(fours):
            at = builder.gep(sink, [builder.extract_value(args[3], k)])
            builder.store(found, builder.bitcast(at, column), align=4)
        return context.get_dummy_value()

    return types.void(values, places, target, slots), make


@kernel(inline=True, counted=False)
def log2(x):
    """Logarithm of a positive normal number."""
    b = bits_of(x) - np.int32(0x3F3504F3)
    e = b >> np.int32(23)
    f = float_of((b & np.int32(0x7FFFFF)) + np.int32(0x3F3504F3)) - ONE
    p = LOG[8]
    p = p * f + LOG[7]
    p = p * f + LOG[6]
    p = p * f + LOG[5]
    p = p * f + LOG[4]
    p = p * f + LOG[3]
    p = p * f + LOG[2]
    p = p * f + LOG[1]
    p = p * f + LOG[0]
    return f4(e) + p * f


@kernel(inline=True, counted=False)
def exp2(x):
    """Two to the power of ``x`` <= 127; at least 2^-100, as products of less would be subnormal, which is slow."""
    x = max(x, f4(-100))
    r = np.floor(x + HALF)
    f = x - r
    p = ((((EXP[5] * f + EXP[4]) * f + EXP[3]) * f + EXP[2]) * f + EXP[1]) * f + EXP[0]
    return p * float_of((np.int32(r) + np.int32(127)) << np.int32(23))


@kernel(inline=True, counted=False)
def angle(y, x):
    """atan2 for y >= 0."""
    ax = abs(x)
    q = min(ax, y) / max(max(ax, y), TINY)
    z = q * q
    p = ATAN[7]
    p = p * z + ATAN[6]
    p = p * z + ATAN[5]
    p = p * z + ATAN[4]
    p = p * z + ATAN[3]
    p = p * z + ATAN[2]
    p = p * z + ATAN[1]
    p = p * z + ATAN[0]
    p = p * q
    p = HALF_PI - p if y > ax else p
    return PI - p if x < ZERO else p


@kernel(inline=True, counted=False)
def fifth(cosine):
    """``(1 - cos)^5``, Schlick's weight."""
    one = min(max(ONE - cosine, ZERO), ONE)
    square = one * one
    return square * square * one


@kernel(inline=True, counted=False)
def dielectric(slowed, cosine):
    """Fresnel's term, see :func:`torchrender.numerics.ggx.dielectric_fresnel`."""
    far = math.sqrt(slowed + cosine * cosine) + cosine
    across = slowed / (far * far)
    along = (cosine * far - ONE) / (cosine * across * far + ONE)
    return HALF * across * across * (ONE + along * along)
