"""Eight vertices at a time into the image."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.raster.lanes.vectors import DOUBLES, I64, INTS, LANES, LONGS, call, constant, splat


def _snapped(builder, place, inside, fixed):
    """Both positions in fixed point, in one float64 of the same bits; see ``project.snap``."""
    subpixel, needs_clip = (splat(builder, kind, n) for kind, n in zip((DOUBLES, LONGS), fixed, strict=True))
    halves = []
    for value in reversed(place):  # the lower half first
        moved = builder.fadd(builder.fmul(value, subpixel), _all(0.5))
        # What lies inside fits into 32 bits.
        halves.append(builder.fptosi(call(builder, f"llvm.floor.v{LANES}f64", DOUBLES, [moved]), INTS))
    both = ir.Constant(ir.VectorType(ir.IntType(32), 2 * LANES), [k // 2 + k % 2 * LANES for k in range(2 * LANES)])
    packed = builder.bitcast(builder.shuffle_vector(*halves, both), LONGS)
    return builder.bitcast(builder.select(inside, packed, needs_clip), DOUBLES)


def _all(value):
    return constant(DOUBLES, [value] * LANES)


def _rows(builder, columns):
    """LANES vectors of four from four vectors of LANES."""
    index = ir.IntType(32)
    for k in range(LANES):
        pair = ir.Constant(ir.VectorType(index, 2), [k, k + LANES])
        left, right = (builder.shuffle_vector(*columns[n : n + 2], pair) for n in (0, 2))
        yield builder.shuffle_vector(left, right, ir.Constant(ir.VectorType(index, 4), list(range(4))))


@intrinsic
def project_lanes(typingctx, vertices, first, pose, limits, out, fixed):  # noqa: ARG001
    """The LANES vertices from ``first`` on of ``project.project_vertices``.

    ``vertices`` (V,3) and ``out`` (V,4) float64; ``pose``: matrix (3,3) and point from which vertices count;
    ``limits``: near and whether orthographic; ``fixed``: half the guard band, places of a pixel (float64 both), and
    what stands for a position that needs clipping (int64).
    """
    if out.layout != "C":
        return None
    signature = types.void(
        vertices, types.uintp, pose, types.Tuple((types.float64, types.boolean)), out,
        types.Tuple((types.float64, types.float64, types.int64)),
    )  # fmt: skip

    def generate(context, builder, sig, args):
        vertices_, first_, pose_, limits_, out_, fixed_ = args
        guard, *fixed = cgutils.unpack_tuple(builder, fixed_, 3)
        near, orthographic = cgutils.unpack_tuple(builder, limits_, 2)

        def item(kind, array, *place):
            view = context.make_array(kind)(context, builder, array)
            pointer = cgutils.get_item_pointer(context, builder, kind, view, place)
            return builder.load(pointer)

        matrix, eye = cgutils.unpack_tuple(builder, pose_, 2)
        places_of = [ir.Constant(I64, k) for k in range(LANES)]
        from_eye = []
        for axis in places_of[:3]:
            column = ir.Constant(DOUBLES, ir.Undefined)
            for k in places_of:
                number = item(sig.args[0], vertices_, builder.add(first_, k), axis)
                column = builder.insert_element(column, number, k)
            from_eye.append(builder.fsub(column, splat(builder, DOUBLES, item(sig.args[2][1], eye, axis))))
        seen = []
        for row in places_of[:3]:
            parts = [
                builder.fmul(splat(builder, DOUBLES, item(sig.args[2][0], matrix, row, axis)), along)
                for axis, along in zip(places_of[:3], from_eye, strict=True)
            ]
            seen.append(builder.fadd(builder.fadd(parts[0], parts[1]), parts[2]))
        inside = builder.fcmp_ordered(">=", seen[2], splat(builder, DOUBLES, near))
        depth = builder.select(orthographic, _all(1.0), seen[2])
        place = [builder.fdiv(value, depth) for value in seen[:2]]
        for value in place:
            size = call(builder, f"llvm.fabs.v{LANES}f64", DOUBLES, [value])
            inside = builder.and_(inside, builder.fcmp_ordered("<", size, splat(builder, DOUBLES, guard)))
        view = context.make_array(sig.args[4])(context, builder, out_)
        for k, row in enumerate(_rows(builder, [*seen, _snapped(builder, place, inside, fixed)])):
            at = builder.mul(builder.add(first_, places_of[k]), ir.Constant(I64, 4))
            pointer = builder.bitcast(cgutils.gep_inbounds(builder, view.data, at), row.type.as_pointer())
            builder.store(row, pointer).align = 8
        return context.get_dummy_value()

    return signature, generate
