"""Textures that are kept as the codes of 8 bits that their files hold: a quarter of the memory of their numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils._pytree import tree_leaves, tree_map

from torchrender.numerics.color import srgb_table

Array = np.ndarray[Any, Any]

PADDING = 3
"""Numbers that follow the texels of a pyramid in memory, so that four may be read from any place on."""
_CACHED = 1 << 16
"""Codes that are looked up at a time: an index takes eight times their memory, and should stay in the cache."""


class CodedTexture(Tensor):
    """A texture (H,W,C) float32 whose numbers are made of 8-bit codes whenever they are asked for.

    To whoever computes with it it is the tensor of its numbers. What shares memory with them (a part, an array of
    NumPy), changes them in place or asks for their gradient makes it an ordinary tensor for good.

    Args:
        codes: (H,W,C) uint8, which nobody writes to any more.
        colors: leading channels that are sRGB; the others are shares of 255.
    """

    _codes: Array | None
    _colors: int
    _numbers: Tensor | None

    @staticmethod
    def __new__(cls, codes: Array, colors: int) -> CodedTexture:
        make: Callable[..., CodedTexture] = Tensor._make_wrapper_subclass
        made = make(cls, codes.shape, dtype=torch.float32)
        made._codes, made._colors, made._numbers = codes, colors, None
        return made

    @property
    def codes(self) -> Array | None:
        """(H,W,C) uint8; None once it is an ordinary tensor."""
        return self._codes

    @property
    def colors(self) -> int:
        """Leading channels that are sRGB."""
        return self._colors

    @property
    def kept(self) -> Array | Tensor:
        """What it takes memory for: codes, or numbers."""
        found = self._codes if self._numbers is None else self._numbers
        assert found is not None
        return found

    def numbers(self) -> Tensor:
        """(H,W,C) float32 linear light; those that it is kept as, or made anew."""
        if self._numbers is not None:
            return self._numbers
        assert self._codes is not None
        return torch.from_numpy(numbers_of(self._codes, self._colors))

    def channels(self, first: int, end: int) -> Tensor:
        """Some of the channels, still as codes where they are."""
        if self._codes is None:
            return self.numbers()[..., first:end]
        colors = min(max(self._colors - first, 0), end - first)
        return CodedTexture(np.ascontiguousarray(self._codes[..., first:end]), colors)

    def __deepcopy__(self, memo: dict[int, Any]) -> Tensor:
        return self.numbers().clone() if self._codes is None else CodedTexture(self._codes, self._colors)

    def __reduce_ex__(self, protocol: Any) -> Any:
        if self._codes is None:
            return self.numbers().__reduce_ex__(protocol)
        return CodedTexture, (self._codes, self._colors)

    @classmethod
    def __torch_function__(
        cls, func: Callable[..., Any], types: Sequence[type], args: Any = (), kwargs: Any = None
    ) -> Any:
        del types
        first = args[0] if args else None
        if func is _HELD or (func in _TOLD and isinstance(first, CodedTexture) and first._numbers is None):
            with torch._C.DisableTorchFunctionSubclass():
                return func(*args, **(kwargs or {}))
        if func is Tensor.detach and isinstance(first, CodedTexture) and first._numbers is None:
            return first
        return _computed(func, args, kwargs or {})

    @classmethod
    def __torch_dispatch__(  # type: ignore[override]  # its own is a function of C that says "none"
        cls, func: Callable[..., Any], types: Sequence[type], args: Any = (), kwargs: Any = None
    ) -> Any:
        del types
        return _computed(func, args, kwargs or {})


_HELD = Tensor._fix_weakref  # type: ignore[attr-defined]
_TOLD = {
    *(getattr(Tensor, name).__get__ for name in ("shape", "dtype", "device", "layout", "ndim", "is_leaf", "grad_fn")),
    *(getattr(Tensor, name).__get__ for name in ("requires_grad", "grad", "_version", "nbytes", "itemsize")),
    *(Tensor.size, Tensor.dim, Tensor.numel, Tensor.stride, Tensor.is_floating_point, Tensor.is_complex),
    *(Tensor.element_size, Tensor.__len__),
}
"""What is known without the numbers."""
_VALUES = (int, float, complex, bool, str, bytes, type(None), torch.Size, torch.dtype, torch.device)


def _computed(func: Callable[..., Any], args: Any, kwargs: dict[str, Any]) -> Any:
    """What a function makes of the numbers; a texture whose numbers it changed, or let out, keeps them."""
    used: dict[int, tuple[CodedTexture, Tensor]] = {}

    def plain(value: Any) -> Any:
        if not isinstance(value, CodedTexture):
            return value
        if id(value) not in used:
            used[id(value)] = value, value.numbers()
        return used[id(value)][1]

    result = func(*tree_map(plain, args), **tree_map(plain, kwargs))
    for texture, numbers in used.values():
        changed = numbers._version > 0 or numbers.requires_grad or func is Tensor.data_ptr
        if texture._numbers is None and (changed or any(_shares(one, numbers) for one in tree_leaves(result))):
            texture._numbers, texture._codes = numbers, None
    back = {id(numbers): texture for texture, numbers in used.values()}
    return tree_map(lambda value: back.get(id(value), value), result)


def _shares(value: Any, numbers: Tensor) -> bool:
    """Whether a result may let somebody see, or change, the numbers."""
    if value is numbers or isinstance(value, _VALUES):
        return False
    if isinstance(value, np.ndarray):
        return bool(np.may_share_memory(value, numbers.detach().numpy()))
    if isinstance(value, Tensor) and value.layout is torch.strided:
        return value.untyped_storage().data_ptr() == numbers.untyped_storage().data_ptr()
    return True


def codes_of(texture: Tensor) -> Array | None:
    """(H,W,C) uint8 of a texture that is kept so; else None."""
    return texture.codes if isinstance(texture, CodedTexture) else None


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
