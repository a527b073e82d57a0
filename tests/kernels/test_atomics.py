"""Atomic operations from many threads, and arrays without owners."""

from __future__ import annotations

import sys
from typing import NamedTuple

import numba
import numpy as np

from torchrender.kernels.atomics import borrowed, fetch_add, foresee, keep, store_max, store_or


class Pair(NamedTuple):
    first: np.ndarray
    inner: tuple[np.ndarray, float]
    number: int


@numba.njit(parallel=True)
def from_threads(total, largest, bits, seen):
    for k in numba.prange(len(seen)):
        seen[fetch_add(total, 0, 1)] = True
        store_max(largest, 0, np.uint64(k * 7919 % len(seen)))
        store_or(bits, k % 3, np.uint64(1) << np.uint64(k % 64))


@numba.njit
def doubled(pair):
    own = borrowed(pair)
    for k in range(len(own.first)):
        own.first[k] = 2 * own.first[k] + own.inner[0][k] * own.inner[1] + own.number
    return own.first.sum()


@numba.njit
def foreseen_sum(rows, order):
    total = 0.0
    for n in range(len(order)):
        foresee(rows, np.uintp(order[n] + 1000 * len(rows)))
        foresee(rows, np.uintp(order[n]))
        total += rows[order[n], 1]
    return total


def test_reading_ahead_changes_nothing_even_beyond_the_end() -> None:
    rows = np.arange(300.0).reshape(100, 3)
    kept = rows.copy()
    assert foreseen_sum(rows, np.arange(99, -1, -1)) == rows[:, 1].sum()
    np.testing.assert_array_equal(rows, kept)


def test_nothing_is_lost_between_threads() -> None:
    count = 30011
    total, largest, bits = np.zeros(2, np.int64), np.zeros(1, np.uint64), np.zeros(3, np.uint64)
    seen = np.zeros(count, np.bool_)
    from_threads(total, largest, bits, seen)
    assert total.tolist() == [count, 0] and seen.all() and largest[0] == count - 1
    assert bits.tolist() == [2**64 - 1] * 3


def test_borrowed_records_are_the_same_memory_and_count_no_references() -> None:
    first, second = np.arange(5.0), np.ones(5)
    before = sys.getrefcount(first), sys.getrefcount(second)
    for _ in range(100):
        first[:] = np.arange(5.0)
        assert doubled(Pair(first, (second, 0.5), 3)) == 2 * 10 + 5 * 3.5
    assert first.tolist() == [2.0 * k + 3.5 for k in range(5)]
    assert (sys.getrefcount(first), sys.getrefcount(second)) == before


@numba.njit
def scratch_of_two_makers():
    """What was lent first, after another array of the same size was made."""
    own = np.full(1000, 7.0)
    lent = borrowed(own)
    other = np.full(1000, 3.0)
    found = lent.sum() + 0.0 * other.sum()
    keep(own)
    return found


def test_lent_scratch_lives_until_it_is_kept_no_longer() -> None:
    for _ in range(20):
        assert scratch_of_two_makers() == 7000.0
