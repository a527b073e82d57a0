"""The edge test of several triangles at once, written in vectors: compilers do not find them in the loop."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from torchrender.kernels.rays.boxes import WIDE

_DOUBLES, _SINGLES = ir.VectorType(ir.DoubleType(), WIDE), ir.VectorType(ir.FloatType(), WIDE)


@intrinsic
def perhaps_hit(typingctx, address, x, y, z, origin, slope, doubt):
    """Bits of the triangles of a group that a float64 test may find hit, whatever the rounding of their float32 copies.

    Args:
        address: of a packed group (see :func:`torchrender.kernels.rays.boxes.pack_groups`).
        x, y, z: the ray's axes, times WIDE, with the direction's largest last.
        origin: the ray's origin relative to the frame, along these axes.
        slope: direction along x and y over that along z.
        doubt: by how much sheared coordinates may be wrong.
    """
    three, two = types.UniTuple(types.float64, 3), types.UniTuple(types.float64, 2)
    whole, real = types.int64, types.float64
    return whole(whole, whole, whole, whole, three, two, real), _code


def _code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    address, *axes, origin, slope, doubt = args
    fx, fy, fz = (_all(builder, builder.extract_value(origin, k)) for k in range(3))
    sx, sy = (_all(builder, builder.extract_value(slope, k)) for k in range(2))
    wide_doubt = _all(builder, doubt)

    def load(corner: int, axis: int) -> Any:
        place = builder.add(axes[axis], axes[axis].type(3 * WIDE * corner))
        at = builder.inttoptr(builder.add(address, builder.mul(place, place.type(4))), _SINGLES.as_pointer())
        return builder.fpext(builder.load(at, align=4), _DOUBLES)

    def sheared(corner: int) -> tuple[Any, Any]:
        pz = builder.fsub(load(corner, 2), fz)
        px = builder.fsub(builder.fsub(load(corner, 0), fx), builder.fmul(sx, pz))
        py = builder.fsub(builder.fsub(load(corner, 1), fy), builder.fmul(sy, pz))
        return px, py

    def cross(p: tuple[Any, Any], q: tuple[Any, Any]) -> Any:
        return builder.fsub(builder.fmul(p[0], q[1]), builder.fmul(p[1], q[0]))

    a, b, c = (sheared(corner) for corner in range(3))
    edges = cross(c, b), cross(a, c), cross(b, a)
    slack = wide_doubt
    for value in (*a, *b, *c):
        slack = builder.fadd(slack, _absolute(builder, value))
    slack = builder.fmul(slack, wide_doubt)
    least = _chosen(builder, "<", _chosen(builder, "<", edges[0], edges[1]), edges[2])
    most = _chosen(builder, ">", _chosen(builder, ">", edges[0], edges[1]), edges[2])
    # Ordered comparisons: NaN counts as perhaps.
    below = builder.fcmp_ordered("<", least, builder.fsub(_DOUBLES(None), slack))
    above = builder.fcmp_ordered(">", most, slack)
    bits = builder.bitcast(builder.not_(builder.and_(below, above)), ir.IntType(WIDE))
    return builder.zext(bits, ir.IntType(64))


def _all(builder: Any, value: Any) -> Any:
    """The value in all places."""
    one = builder.insert_element(_DOUBLES(ir.Undefined), value, ir.IntType(32)(0))
    return builder.shuffle_vector(one, one, ir.VectorType(ir.IntType(32), WIDE)(None))


def _chosen(builder: Any, sign: str, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(sign, a, b), a, b)


def _absolute(builder: Any, value: Any) -> Any:
    kind = ir.FunctionType(_DOUBLES, [_DOUBLES])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fabs.v{WIDE}f64"), [value])
