"""Rows with lists in them: where each property's values are, in numbers or in bytes, and the values side by side."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.kernels.compile import kernel


@kernel()
def number_rows(numbers: np.ndarray, lists: np.ndarray, starts: np.ndarray, counts: np.ndarray) -> tuple[int, Any]:
    """Where the values of rows are among numbers, as far as there are whole rows.

    Args:
        numbers: (n,) float64; a list is its count and then its values.
        lists: (P,) bool which properties are lists; the others have one value.
        starts, counts: (R,P) int64 get first place and count of the values of each property of each row.

    Returns:
        Whole rows, and the first number behind them. -1 rows where a count is no whole number >= 0: the second is then
        its place.
    """
    n, at = len(numbers), np.int64(0)
    for row in range(len(starts)):
        here = at
        for p in range(len(lists)):
            count = np.int64(1)
            if lists[p]:
                if here >= n:
                    return row, at
                value = numbers[here]
                if not 0.0 <= value <= 2147483648.0 or value != np.floor(value):
                    return -1, here
                count = np.int64(value)
                here += 1
            starts[row, p], counts[row, p] = here, count
            here += count
        if here > n:
            return row, at
        at = here
    return len(starts), at


@kernel()
def byte_rows(
    data: np.ndarray, heads: np.ndarray, widths: np.ndarray, big: bool, starts: np.ndarray, counts: np.ndarray
) -> tuple[int, Any]:
    """Where the values of packed rows are among bytes, as far as there are whole rows.

    Args:
        data: (n,) uint8.
        heads: (P,) int64 bytes of the count of a list, unsigned; 0: one value.
        widths: (P,) int64 bytes of a value.
        big: the greatest byte of a count comes first.
        starts, counts: (R,P) int64 get first byte and count of the values of each property of each row.

    Returns:
        Whole rows, and the first byte behind them.
    """
    n, at = len(data), np.int64(0)
    for row in range(len(starts)):
        here = at
        for p in range(len(heads)):
            count = np.int64(1)
            if heads[p] > 0:
                if here + heads[p] > n:
                    return row, at
                count = np.int64(0)
                for k in range(heads[p]):
                    byte = np.int64(data[here + k] if big else data[here + heads[p] - 1 - k])
                    if count > 2147483648:
                        return row, at
                    count = count * 256 + byte
                here += heads[p]
            if count > n:
                return row, at
            starts[row, p], counts[row, p] = here, count
            here += count * widths[p]
        if here > n:
            return row, at
        at = here
    return len(starts), at


@kernel()
def join_numbers(numbers: np.ndarray, starts: np.ndarray, counts: np.ndarray, out: np.ndarray) -> None:
    """Copy ranges of numbers one behind the other: ``starts`` and ``counts`` (R,) int64, ``out`` float64."""
    at = 0
    for row in range(len(starts)):
        for k in range(counts[row]):
            out[at] = numbers[starts[row] + k]
            at += 1


@kernel()
def join_bytes(data: np.ndarray, starts: np.ndarray, counts: np.ndarray, width: int, out: np.ndarray) -> None:
    """Copy ranges of ``counts`` (R,) values of ``width`` bytes one behind the other; ``out`` uint8."""
    at = 0
    for row in range(len(starts)):
        for k in range(counts[row] * width):
            out[at] = data[starts[row] + k]
            at += 1
