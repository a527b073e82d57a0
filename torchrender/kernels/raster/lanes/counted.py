"""Surfaces before what an image stores, for eight pixels of a row at a time."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.raster.lanes.vectors import (
    DOUBLES,
    FLOATS,
    FOUR_DOUBLES,
    FOUR_LONGS,
    HALVES,
    I8,
    INTS,
    LANES,
    LONGS,
    bits_of,
    constant,
    half,
    key_of,
    lanes_of,
    splat,
)

BYTES = ir.VectorType(I8, LANES)


@intrinsic
def count_lanes(typingctx, images, spot, mask, plane, limits, own):  # noqa: ARG001
    """Add a triangle to the masked ones of LANES pixels of a row, all of which lie in the image.

    Where none of them stores a depth of ``limits[3]`` or more, which no fragment falls below, nothing is looked at.
    ``images``: depth (H,W) float32, triangle (H,W) int64, number (H,W) int32 and touching (H,W) bool; ``spot``: row and
    first column; ``plane``: of :func:`~.pixels.keep_nearest`; ``limits`` = (one and the relative distance of touching
    surfaces, the absolute one, far, the least depth); ``own`` = (triangle, int32 what it counts).
    """
    if any(image.layout != "C" for image in images):
        return None
    numbers = types.float64
    signature = types.void(
        images, types.UniTuple(types.uintp, 2), types.uint64, types.UniTuple(numbers, 5), types.UniTuple(numbers, 4),
        types.Tuple((types.int64, types.int32)),
    )  # fmt: skip

    def generate(context, builder, sig, args):
        views = [
            context.make_array(kind)(context, builder, image)
            for kind, image in zip(sig.args[0], cgutils.unpack_tuple(builder, args[0], 4), strict=True)
        ]
        row, column = cgutils.unpack_tuple(builder, args[1], 2)
        plane, limits = (cgutils.unpack_tuple(builder, args[k], n) for k, n in ((3, 5), (4, 4)))
        owner, worth = cgutils.unpack_tuple(builder, args[5], 2)
        width = cgutils.unpack_tuple(builder, views[0].shape, 2)[1]
        place = builder.add(builder.mul(row, width), column)
        depth, triangle, number, touching = (
            builder.bitcast(builder.gep(image.data, [place]), kind.as_pointer())
            for image, kind in zip(views, (FLOATS, LONGS, INTS, BYTES), strict=True)
        )
        held = builder.fpext(builder.load(depth, align=4), DOUBLES)
        least, none = splat(builder, FOUR_DOUBLES, limits[3]), ir.Constant(I8, 0)
        open_ones = [builder.fcmp_ordered(">=", half(builder, held, part), least) for part in range(HALVES)]
        open_ones = builder.and_(bits_of(builder, open_ones), builder.trunc(args[2], I8))
        with builder.if_then(builder.icmp_unsigned("!=", open_ones, none)):
            near, touches = _nearer(builder, key_of(builder, plane), owner, (held, triangle), limits[:3])
            near = builder.and_(near, open_ones)
            with builder.if_then(builder.icmp_unsigned("!=", near, none)):
                count = builder.load(number, align=4)
                more = builder.add(count, splat(builder, INTS, worth))
                chosen = lanes_of(builder, builder.zext(near, ir.IntType(32)), INTS)
                builder.store(builder.select(chosen, more, count), number, align=4)
                touches = lanes_of(builder, builder.and_(touches, near), BYTES)
                marked = builder.or_(builder.load(touching, align=1), builder.zext(touches, BYTES))
                builder.store(marked, touching, align=1)
        return context.get_dummy_value()

    return signature, generate


def _nearer(builder, key, owner, stored, limits):
    """Bytes with a bit for each fragment before what is stored, of equal depths those with the lower id; and for each
    that touches it. Compared as 64 bits each, see :func:`~.vectors.half`; float32 fits into them."""
    held, triangle = stored
    widened, absolute, far = (splat(builder, FOUR_DOUBLES, number) for number in limits)
    rounded = builder.fptrunc(builder.fdiv(constant(DOUBLES, [1.0] * LANES), key), FLOATS)
    every = builder.fpext(rounded, DOUBLES)
    ids, own = builder.load(triangle, align=8), splat(builder, FOUR_LONGS, owner)
    nearer, touches = [], []
    for part in range(HALVES):
        z, here = half(builder, every, part), half(builder, held, part)
        level = builder.fcmp_ordered("==", z, here)
        level = builder.and_(level, builder.icmp_signed("<", own, half(builder, ids, part)))
        before = builder.or_(level, builder.fcmp_ordered("<", z, here))
        nearer.append(builder.and_(before, builder.fcmp_ordered("<=", z, far)))
        reach = builder.fadd(builder.fmul(z, widened), absolute)
        touches.append(builder.fcmp_ordered(">=", reach, here))
    return bits_of(builder, nearer), bits_of(builder, touches)
