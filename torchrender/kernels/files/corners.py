"""Lines of OBJ files: the corners of faces, and how many words there are."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel

_LARGEST = 10**15


@kernel()
def parse_corners(text: np.ndarray, table: np.ndarray, counts: np.ndarray) -> int:
    """Corners 1, 1/2, 1//3 and 1/2/3 between blanks, a face on each line.

    Args:
        text: (n,) uint8.
        table: (m,3) int64 gets the indices of each corner; 0 where it has none.
        counts: (F,) int64 gets the corners of each line.

    Returns:
        How many corners there are; -1 where there is anything else, or more than there is room for.
    """
    n, at, found, line = len(text), 0, 0, 0
    while at < n and line < len(counts):
        c = text[at]
        if c == 10:
            line += 1
            at += 1
        elif c <= 32:
            at += 1
        else:
            if found >= len(table):
                return -1
            part, digits = 0, 0
            table[found, 0] = table[found, 1] = table[found, 2] = 0
            while at < n and text[at] > 32:
                c = text[at]
                if 48 <= c <= 57:
                    value = table[found, part] * 10 + np.int64(c - 48)
                    if value > _LARGEST:
                        return -1
                    table[found, part] = value
                    digits += 1
                elif c == 47 and part < 2 and (digits > 0 or part == 1):
                    part, digits = part + 1, 0
                else:
                    return -1
                at += 1
            if digits == 0:
                return -1
            found += 1
            counts[line] += 1
    return found


@kernel()
def count_words(text: np.ndarray, counts: np.ndarray) -> None:
    """Words between blanks on each line of ``text`` (n,) uint8; ``counts`` (L,) int64."""
    line, inside = 0, False
    for at in range(len(text)):
        c = text[at]
        if c > 32 and not inside:
            counts[line] += 1
        inside = c > 32
        if c == 10:
            line += 1
            if line == len(counts):
                return
