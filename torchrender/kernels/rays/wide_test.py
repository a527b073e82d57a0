"""The edge test of several triangles at once, written in vectors: compilers do not find them in the loop."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from torchrender.kernels.rays.boxes import WIDE

_DOUBLES = ir.VectorType(ir.DoubleType(), WIDE)


@intrinsic
def edges_around(typingctx, address, x, y, z, origin, slope):  # noqa: ARG001  numba calls it with types
    """Bits of the triangles of a group whose edges go round a ray, in the arithmetic of ``watertight.hit_triangle``.

    Args:
        address: of a packed group (see :func:`torchrender.kernels.rays.boxes.pack_groups`).
        x, y, z: the ray's axes, times WIDE, with the direction's largest last.
        origin: the ray's origin times the frame's scale, along these axes.
        slope: direction along x and y over that along z.
    """
    whole, three, two = types.int64, types.UniTuple(types.float64, 3), types.UniTuple(types.float64, 2)
    return whole(whole, whole, whole, whole, three, two), _code


def _code(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
    address, *axes, origin, slope = args
    ox, oy, oz = (_all(builder, builder.extract_value(origin, k)) for k in range(3))
    sx, sy = (_all(builder, builder.extract_value(slope, k)) for k in range(2))

    def load(corner: int, axis: int) -> Any:
        place = builder.add(axes[axis], axes[axis].type(3 * WIDE * corner))
        at = builder.inttoptr(builder.add(address, builder.mul(place, place.type(8))), _DOUBLES.as_pointer())
        return builder.load(at, align=8)

    def sheared(corner: int) -> tuple[Any, Any]:
        pz = builder.fsub(load(corner, 2), oz)
        px = builder.fsub(builder.fsub(load(corner, 0), ox), builder.fmul(sx, pz))
        py = builder.fsub(builder.fsub(load(corner, 1), oy), builder.fmul(sy, pz))
        return px, py

    def cross(p: tuple[Any, Any], q: tuple[Any, Any]) -> Any:
        return builder.fsub(builder.fmul(p[0], q[1]), builder.fmul(p[1], q[0]))

    a, b, c = (sheared(corner) for corner in range(3))
    edges = cross(c, b), cross(a, c), cross(b, a)
    least = _chosen(builder, "<", _chosen(builder, "<", edges[0], edges[1]), edges[2])
    most = _chosen(builder, ">", _chosen(builder, ">", edges[0], edges[1]), edges[2])
    below = builder.fcmp_ordered("<", least, _DOUBLES(None))
    above = builder.fcmp_ordered(">", most, _DOUBLES(None))
    bits = builder.bitcast(builder.not_(builder.and_(below, above)), ir.IntType(WIDE))
    return builder.zext(bits, ir.IntType(64))


def _all(builder: Any, value: Any) -> Any:
    """The value in all places."""
    one = builder.insert_element(_DOUBLES(ir.Undefined), value, ir.IntType(32)(0))
    return builder.shuffle_vector(one, one, ir.VectorType(ir.IntType(32), WIDE)(None))


def _chosen(builder: Any, sign: str, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(sign, a, b), a, b)
