"""Pictures that get no larger than somebody wants: made smaller while their codes become numbers, row by row."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.numerics.texels.coded import CodedTexture
from torchrender.numerics.texels.halving import halved
from torchrender.numerics.texels.levels import halved_codes

ROWS = 256
"""Of the smaller picture, that are made at a time."""


@dataclass(eq=False)
class Bound:
    """Of each picture."""

    pixels: int | None  # None: there is none
    coded: int | None  # of one that is kept as codes
    lost: Counter[str] = field(default_factory=Counter)  # what was made smaller, in words


_BOUND: ContextVar[Bound | None] = ContextVar("bound", default=None)


@contextmanager
def at_most(pixels: int | None, coded: int | None = None) -> Iterator[Bound]:
    """Pictures that are read inside have so many pixels at most: larger ones are halved, by means of two by two.

    Args:
        coded: of textures that are kept as codes; None: as of others.
    """
    bound = Bound(pixels, pixels if coded is None else coded)
    token = _BOUND.set(bound)
    try:
        yield bound
    finally:
        _BOUND.reset(token)


def converted(codes: np.ndarray[Any, Any], convert: Callable[[np.ndarray[Any, Any]], Tensor]) -> Tensor:
    """(H,W,C) codes as numbers, halved until they keep to the bound."""
    bound = _BOUND.get()
    height, width, channels = codes.shape
    if bound is None or bound.pixels is None or height * width <= bound.pixels:
        return convert(codes)
    if height % 2 or width % 2:
        made = halved(convert(codes))
    else:
        made = torch.zeros(height // 2, width // 2, channels)
        for row in range(0, height // 2, ROWS):
            made[row : row + ROWS] = halved(convert(codes[2 * row : 2 * (row + ROWS)]))
    while made.shape[0] * made.shape[1] > bound.pixels:
        made = halved(made)
    bound.lost[smaller(codes.shape, made.shape)] += 1
    return made


def kept_as_codes(codes: np.ndarray[Any, Any], colors: int) -> CodedTexture:
    """(H,W,C) 8-bit codes as a texture, halved until they keep to the bound."""
    bound, made = _BOUND.get(), codes
    if bound is None or bound.coded is None:
        return CodedTexture(codes, colors)
    while made.shape[0] * made.shape[1] > bound.coded:
        made = halved_codes(made, colors)
    if made is not codes:
        bound.lost[smaller(codes.shape, made.shape)] += 1
    return CodedTexture(made, colors)


def smaller(before: tuple[int, ...], after: tuple[int, ...]) -> str:
    """What is said of a texture (H,W,C) of which a smaller one is kept."""
    return f"texels of a texture of {before[1]} x {before[0]}: {after[1]} x {after[0]} are kept"
