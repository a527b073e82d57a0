"""Atomic operations on array elements, which numba does not offer on the CPU."""

from __future__ import annotations

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
