"""Textures that are kept as the codes of 8 bits that their files hold: a quarter of the memory of their numbers."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from inspect import isfunction
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils._pytree import tree_leaves, tree_map

from torchrender.errors import InputError
from torchrender.numerics.color import srgb_table

Array = np.ndarray[Any, Any]

PADDING = 3
"""Numbers that follow the texels of a pyramid in memory, so that four may be read from any place on."""
_CACHED = 1 << 16
"""Codes that are looked up at a time: an index takes eight times their memory, and should stay in the cache."""


class CodedTexture(Tensor):
    """A texture (H,W,C) float32 whose numbers are made of 8-bit codes whenever they are asked for.

    To whoever computes with it it is the tensor of its numbers. Whatever else is done with it (taking a part or an
    array of NumPy, changing it, asking for its gradient) turns the same object into an ordinary ``Tensor`` first.

    Args:
        codes: (H,W,C) uint8, which nobody writes to any more.
        colors: leading channels that are sRGB; the others are shares of 255.
    """

    _codes: Array
    _colors: int
    _numbers: Tensor | None  # that were let out where it could not be turned into them yet

    @staticmethod
    def __new__(cls, codes: Array, colors: int) -> CodedTexture:
        make: Callable[..., CodedTexture] = Tensor._make_wrapper_subclass
        with torch.inference_mode(False):
            made = make(cls, codes.shape, dtype=torch.float32)
        made._codes, made._colors, made._numbers = codes, colors, None
        return made

    @property
    def codes(self) -> Array:
        """(H,W,C) uint8."""
        return self._codes

    @property
    def colors(self) -> int:
        """Leading channels that are sRGB."""
        return self._colors

    def numbers(self) -> Tensor:
        """(H,W,C) float32 linear light, made anew."""
        with torch.inference_mode(False):
            return torch.from_numpy(numbers_of(self._codes, self._colors)) if self._numbers is None else self._numbers

    def channels(self, first: int, end: int) -> CodedTexture:
        """Some of the channels, still as codes."""
        colors = min(max(self._colors - first, 0), end - first)
        return CodedTexture(np.ascontiguousarray(self._codes[..., first:end]), colors)

    def __copy__(self) -> Tensor:
        return copy.copy(_settled(self))

    def __deepcopy__(self, memo: dict[int, Any]) -> Tensor:
        return (
            copy.deepcopy(_settled(self), memo) if codes_of(self) is None else CodedTexture(self._codes, self._colors)
        )

    def __reduce_ex__(self, protocol: Any) -> Any:
        # By these protocols, as torch.save has them, the numbers: whoever loads them may know tensors only.
        if protocol <= 2 or codes_of(self) is None:
            return self.numbers().__reduce_ex__(protocol)
        return CodedTexture, (self._codes, self._colors)

    @classmethod
    def __torch_function__(
        cls, func: Callable[..., Any], types: Sequence[type], args: Any = (), kwargs: Any = None
    ) -> Any:
        del types
        kwargs = kwargs or {}
        given = [one for one in tree_leaves((args, kwargs)) if isinstance(one, CodedTexture)]
        kept = all(one._numbers is None for one in given)
        into_another = func in _INTO and bool(args) and not isinstance(args[0], CodedTexture)
        if kept and "out" not in kwargs and func not in _TOLD and (into_another or _only_reads(func)):
            used, result = _computed(func, args, kwargs)
            if not any(_shares(one, used) for one in tree_leaves(result)):
                return result
        if func not in _TOLD or not kept:
            for one in given:
                _settled(one)
        with torch._C.DisableTorchFunctionSubclass():
            return func(*args, **kwargs)

    @classmethod
    def __torch_dispatch__(  # type: ignore[override]  # its own is a function of C that says "none"
        cls, func: Any, types: Sequence[type], args: Any = (), kwargs: Any = None
    ) -> Any:
        """What PyTorch asks for inside its own functions, as those of ``torch.func`` do."""
        del types
        used, result = _computed(func, args, kwargs or {})
        if not _is_pure(func._schema):
            for texture, numbers in used:
                texture._numbers = numbers
        return result


_TOLD = {
    *(getattr(Tensor, name).__get__ for name in ("shape", "dtype", "device", "layout", "ndim", "is_leaf", "grad_fn")),
    *(getattr(Tensor, name).__get__ for name in ("requires_grad", "grad", "_version", "nbytes", "itemsize")),
    *(Tensor.size, Tensor.dim, Tensor.numel, Tensor.stride, Tensor.is_floating_point, Tensor.is_complex),
    *(Tensor.element_size, Tensor.__len__, Tensor.is_inference),
    Tensor._fix_weakref,  # type: ignore[attr-defined]
}
"""What is known without the numbers."""
_READS = {
    *(Tensor.to, Tensor.float, Tensor.double, Tensor.half, Tensor.int, Tensor.long, Tensor.bool, Tensor.cpu),
    *(Tensor.contiguous, Tensor.type_as, Tensor.tolist, Tensor.__repr__, Tensor.__format__, Tensor.norm),
    *(
        getattr(Tensor, name)
        for name in ("__eq__", "__rsub__", "__rdiv__", "__rpow__", "__floordiv__", "__rfloordiv__")
    ),
}
"""What gives new tensors, or the same; beside PyTorch's compiled functions, whose schemas say so."""
_INTO = {Tensor.copy_, Tensor.__setitem__}
"""What writes into the first tensor only."""
_SWAP = threading.Lock()


@cache
def _only_reads(func: Callable[..., Any]) -> bool:
    """Whether a function neither changes what it is given nor gives views of it."""
    name = getattr(func, "__name__", "_")
    if func in _READS:
        return True
    op = None if isfunction(func) or name.startswith("_") else getattr(torch.ops.aten, name, None)
    return op is not None and all(_is_pure(getattr(op, one)._schema) for one in op.overloads())


def _is_pure(schema: Any) -> bool:
    """Of an overload, one that writes into what it is given as ``out`` left aside."""
    aliased = [one for one in schema.arguments if one.alias_info is not None]
    if aliased and all(one.kwarg_only for one in aliased):
        return True
    return not aliased and all(one.alias_info is None for one in schema.returns)


def _computed(
    func: Callable[..., Any], args: Any, kwargs: dict[str, Any]
) -> tuple[list[tuple[CodedTexture, Tensor]], Any]:
    """Textures with the numbers that stood for them, and what a function makes of these."""
    used: dict[int, tuple[CodedTexture, Tensor]] = {}

    def plain(value: Any) -> Any:
        if not isinstance(value, CodedTexture):
            return value
        if id(value) not in used:
            used[id(value)] = value, value.numbers()
        return used[id(value)][1]

    result = func(*tree_map(plain, args), **tree_map(plain, kwargs))
    back = {id(numbers): texture for texture, numbers in used.values()}
    return list(used.values()), tree_map(lambda value: back.get(id(value), value), result)


def _shares(value: Any, used: Sequence[tuple[CodedTexture, Tensor]]) -> bool:
    """Whether a result lies in the memory of numbers that stood for textures."""
    if not isinstance(value, Tensor) or isinstance(value, CodedTexture) or value.layout is not torch.strided:
        return False
    return value.untyped_storage().data_ptr() in {one.untyped_storage().data_ptr() for _, one in used}


def _settled(texture: Tensor) -> Tensor:
    """The same object, an ordinary tensor from now on."""
    with _SWAP, torch.inference_mode(False):
        if isinstance(texture, CodedTexture):
            held = texture.numbers()
            plain = torch.zeros(0, dtype=torch.float32, device="cpu")
            plain.set_(held.untyped_storage(), held.storage_offset(), held.shape, held.stride())
            try:
                torch._C._swap_tensor_impl(texture, plain)
            except RuntimeError as error:  # it counts who refers to it
                told = "a texture that PyTorch is computing with cannot be changed or viewed: take its clone()"
                raise InputError(told) from error
            object.__setattr__(texture, "__class__", Tensor)
            vars(texture).clear()
    return texture


def codes_of(texture: Tensor) -> Array | None:
    """(H,W,C) uint8 of a texture that is kept so; else None."""
    kept = vars(texture)
    return kept.get("_codes") if kept.get("_numbers") is None else None


def state_of(texture: Tensor) -> tuple[object, int]:
    """What is another one once a texture was changed: how often that was done in place, and where its numbers lie."""
    if codes_of(texture) is not None:
        return 0, 0
    version = object() if texture.is_inference() else texture._version  # changes of such tensors are not counted
    return version, texture.data_ptr()


@lru_cache(maxsize=1)
def tables() -> Array:
    """(2,256) float32: what each code is, as a share of 255, and in linear light."""
    shares = np.arange(256, dtype=np.float32) / np.float32(255)
    return np.stack([shares, srgb_table(8).numpy()])


def numbers_of(codes: Array, colors: int) -> Array:
    """(H,W,C) float32 of codes (H,W,C) uint8, the leading ``colors`` channels of which are sRGB."""
    plain, linear = tables()
    return looked_up(codes, linear, plain, colors)


def looked_up(codes: Array, table: Array, plain: Array, colors: int) -> Array:
    """What tables (K,) say of each code: the first ``colors`` channels by ``table``, the others by ``plain``."""
    out = np.empty(codes.shape, table.dtype)
    rows = max(_CACHED // max(codes.shape[1] * codes.shape[2], 1), 1)
    for row in range(0, len(codes), rows):
        part = codes[row : row + rows]
        np.take(table, part[..., :colors], out=out[row : row + rows, :, :colors], mode="clip")
        np.take(plain, part[..., colors:], out=out[row : row + rows, :, colors:], mode="clip")
    return out


def room_for(shape: Sequence[int], dtype: Any) -> Array:
    """An array that :data:`PADDING` more numbers follow in memory."""
    count = int(np.prod(shape))
    whole = np.empty(count + PADDING, dtype)
    whole[count:] = 0
    return whole[:count].reshape(shape)


def is_followed(values: Array) -> bool:
    """Whether :data:`PADDING` numbers may be read behind the last one of an array in a row."""
    base = values.base
    while isinstance(base, np.ndarray) and isinstance(base.base, np.ndarray):
        base = base.base
    if not isinstance(base, np.ndarray) or not (values.flags.c_contiguous and base.flags.c_contiguous):
        return False
    behind = base.ctypes.data + base.nbytes - (values.ctypes.data + values.nbytes)
    return behind >= PADDING * values.itemsize
