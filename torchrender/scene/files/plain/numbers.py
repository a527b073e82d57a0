"""All numbers of a text as one array."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.kernels.files.numbers import parse_numbers

Array = np.ndarray[Any, Any]


def numbers_of(text: bytes) -> Array:
    """(N,) float64 of the words between blanks, as Python's ``float`` reads each.

    Raises:
        ValueError: a word that is no number; names it.
    """
    source = np.frombuffer(text, np.uint8)
    room = len(source) // 2 + 1
    # Pages are only taken when they are written to.
    out, hard = np.empty(room), np.empty((room, 2), np.int64)
    count, left = parse_numbers(source, out, hard)
    for number, start in hard[:left].tolist():
        word = text[start : start + 400].split(None, 1)[0]
        try:
            if b"_" in word:  # Python's digits may be grouped, those of files not
                raise ValueError
            out[number] = float(word)
        except ValueError as error:
            raise ValueError(f"{word[:40]!r} is no number") from error
    return out[:count].copy() if count < room // 2 else out[:count]
