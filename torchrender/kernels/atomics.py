"""Operations on array elements that numba does not offer on the CPU: atomic ones, and reading ahead."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def element(context, builder, kind, array, index):
    """Address of ``array[index]`` of a one-dimensional array of this type, for intrinsics."""
    data = context.make_array(kind)(context, builder, array).data
    return cgutils.gep_inbounds(builder, data, index)


@intrinsic
def fetch_add(typingctx, array, index, value):  # noqa: ARG001
    """Add ``value`` to ``array[index]`` atomically and return what was there before. The array is one-dimensional."""
    signature = array.dtype(array, types.intp, array.dtype)

    def generate(context, builder, sig, args):
        values, position, addend = args
        pointer = element(context, builder, sig.args[0], values, position)
        return builder.atomic_rmw("add", pointer, addend, "monotonic")

    return signature, generate


@intrinsic
def store_max(typingctx, array, index, value):  # noqa: ARG001
    """``array[index] = max(array[index], value)``, atomically. The array is one-dimensional and unsigned."""
    signature = types.void(array, types.intp, array.dtype)

    def generate(context, builder, sig, args):
        values, position, candidate = args
        pointer = element(context, builder, sig.args[0], values, position)
        builder.atomic_rmw("umax", pointer, candidate, "monotonic")
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def store_or(typingctx, array, index, value):  # noqa: ARG001
    """``array[index] |= value``, atomically. The array is one-dimensional."""
    signature = types.void(array, types.intp, array.dtype)

    def generate(context, builder, sig, args):
        values, position, bits = args
        pointer = element(context, builder, sig.args[0], values, position)
        builder.atomic_rmw("or", pointer, bits, "monotonic")
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def foresee(typingctx, array, index):  # noqa: ARG001
    """Have the processor fetch ``array[index]``, which may be a row, while other work goes on.

    For what is read soon after from memory in no order: such a read takes as long as a hundred additions.
    """
    if array.layout != "C":
        return None
    signature = types.void(array, types.uintp)

    def generate(context, builder, sig, args):
        view = context.make_array(sig.args[0])(context, builder, args[0])
        place = args[1]
        for size in cgutils.unpack_tuple(builder, view.shape, sig.args[0].ndim)[1:]:
            place = builder.mul(place, size)
        number = ir.IntType(32)
        pointer = builder.bitcast(builder.gep(view.data, [place]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, number, number, number])
        read, keep_near, data = (ir.Constant(number, value) for value in (0, 3, 1))
        builder.call(
            cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0"), [pointer, read, keep_near, data]
        )
        return context.get_dummy_value()

    return signature, generate


def _lent(context, builder, kind, value):
    """The value with every array in it cut off from its owner."""
    if isinstance(kind, types.Array):
        view = context.make_array(kind)(context, builder, value)
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()
    if isinstance(kind, types.BaseTuple):
        parts = cgutils.unpack_tuple(builder, value, len(kind))
        return context.make_tuple(
            builder, kind, [_lent(context, builder, k, v) for k, v in zip(kind, parts, strict=True)]
        )
    return value


@intrinsic
def borrowed(typingctx, arrays):  # noqa: ARG001
    """The same array, or tuple or record of arrays and numbers, without reference counts.

    Two threads would fight over these in hot loops. The caller must keep the arrays alive for as long as the result is
    used: an array whose last mention is the call itself is freed by it. See :func:`keep`.
    """
    signature = arrays(arrays)

    def generate(context, builder, sig, args):
        return _lent(context, builder, sig.args[0], args[0])

    return signature, generate


@intrinsic
def keep(typingctx, arrays):  # noqa: ARG001
    """Does nothing: as the last mention of arrays that were made for :func:`borrowed`, it keeps them until there."""
    return types.void(arrays), lambda context, builder, sig, args: context.get_dummy_value()  # noqa: ARG005
