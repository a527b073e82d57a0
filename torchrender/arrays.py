"""Tensors as numpy arrays: what compiled kernels read; and of which type they are where nobody says."""

from __future__ import annotations

import functools
import math
import sys
import threading
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np
import torch
from torch import Tensor

LINE = 64  # bytes of the processor's cache
P = ParamSpec("P")
R = TypeVar("R")


def in_single_precision(function: Callable[P, R]) -> Callable[P, R]:
    """A public function that computes in float32 where nothing else is said, also in a program that has set another
    default type of PyTorch: that is the default again when it returns."""

    @functools.wraps(function)
    def inside(*args: P.args, **kwargs: P.kwargs) -> R:
        usual = torch.get_default_dtype()
        if usual is torch.float32:
            return function(*args, **kwargs)
        torch.set_default_dtype(torch.float32)
        try:
            return function(*args, **kwargs)
        finally:
            torch.set_default_dtype(usual)

    return inside


def view(tensor: Tensor, dtype: type | np.dtype[Any]) -> np.ndarray[Any, Any]:
    """A contiguous numpy view of a CPU tensor, copied only where type or layout differ."""
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=dtype)


def empty_aligned(shape: tuple[int, ...], dtype: type) -> np.ndarray[Any, Any]:
    """An array with anything in it that begins where a line of the processor's cache does.

    Numpy's begin anywhere, and a vector that lies in two lines is read and written twice.
    """
    return _aligned(np.empty(_size(shape, dtype) + LINE, np.uint8), shape, dtype)


def _size(shape: tuple[int, ...], dtype: type) -> int:
    return math.prod(shape) * np.dtype(dtype).itemsize


def _aligned(memory: np.ndarray[Any, Any], shape: tuple[int, ...], dtype: type) -> np.ndarray[Any, Any]:
    """A part of ``memory``, of LINE bytes more."""
    first = -memory.__array_interface__["data"][0] % LINE
    return memory[first : first + _size(shape, dtype)].view(dtype).reshape(shape)


class Recycler:
    """Arrays that nobody else holds any more, handed out again: fresh pages cost as much as what is drawn into them.

    A tensor made from an array, and every view of either, keep it from being handed out. They begin as those of
    :func:`empty_aligned`.
    """

    def __init__(self, most: int) -> None:
        """``most``: bytes that are kept at most."""
        self._most = most
        self._arrays: list[np.ndarray[Any, Any]] = []
        self._lock = threading.Lock()

    def empty(self, shape: tuple[int, ...], dtype: type) -> np.ndarray[Any, Any]:
        """An array with anything in it."""
        size = _size(shape, dtype) + LINE
        if not _LEAST <= size <= self._most:
            return empty_aligned(shape, dtype)
        with self._lock:
            for place in range(len(self._arrays)):
                kept = self._arrays[place]
                if kept.nbytes == size and sys.getrefcount(kept) == _UNUSED:
                    self._arrays.append(self._arrays.pop(place))
                    return _aligned(kept, shape, dtype)
            made = np.empty(size, np.uint8)
            self._arrays.append(made)
            while sum(a.nbytes for a in self._arrays) > self._most:
                self._arrays.pop(0)
            return _aligned(made, shape, dtype)


_LEAST = 1 << 18  # bytes; below this the allocator itself keeps pages
_UNUSED = 3  # references: the list's, the loop's, and that of the call that counts them
