"""Rows with lists in them, against loops over Python's own numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.files.rows import byte_rows, join_bytes, join_numbers, number_rows

Rows = list[tuple[list[int], int, list[int]]]
rows_of_lists = st.lists(
    st.tuples(
        st.lists(st.integers(0, 200), max_size=5), st.integers(0, 200), st.lists(st.integers(0, 60000), max_size=3)
    ),
    max_size=12,
)


@settings(deadline=None, max_examples=60)
@given(rows_of_lists, st.integers(0, 30))
def test_numbers(rows: Rows, cut: int) -> None:
    """Whole rows are found and no others, wherever the numbers end."""
    flat, ends = [], []
    for first, alone, last in rows:
        flat += [len(first), *first, alone, len(last), *last]
        ends.append(len(flat))
    kept = max(len(flat) - cut, 0)
    numbers = np.array(flat[:kept], np.float64)
    starts, counts = np.empty((len(rows), 3), np.int64), np.empty((len(rows), 3), np.int64)
    found, at = number_rows(numbers, np.array([True, False, True]), starts, counts)
    whole = sum(end <= kept for end in ends)
    assert found == whole and at == (ends[whole - 1] if whole else 0)
    for column, of in ((0, 0), (1, 1), (2, 2)):
        count = counts[:whole, column].copy()
        out = np.empty(int(count.sum()))
        join_numbers(numbers, starts[:whole, column].copy(), count, out)
        expected = [v for row in rows[:whole] for v in (row[of] if of != 1 else [row[1]])]  # type: ignore[misc]
        assert out.tolist() == expected


@settings(deadline=None, max_examples=60)
@given(rows_of_lists, st.integers(0, 40), st.booleans())
def test_bytes(rows: Rows, cut: int, big: bool) -> None:
    order = ">" if big else "<"
    data, ends = b"", []
    for first, alone, last in rows:
        data += np.array([len(first)], "u1").tobytes() + np.array(first, order + "u2").tobytes()
        data += np.array([alone], "u1").tobytes()
        data += np.array([len(last)], order + "i4").tobytes() + np.array(last, order + "i4").tobytes()
        ends.append(len(data))
    kept = max(len(data) - cut, 0)
    raw = np.frombuffer(data[:kept], np.uint8)
    heads, widths = np.array([1, 0, 4]), np.array([2, 1, 4])
    starts, counts = np.empty((len(rows), 3), np.int64), np.empty((len(rows), 3), np.int64)
    found, at = byte_rows(raw, heads, widths, big, starts, counts)
    whole = sum(end <= kept for end in ends)
    assert found == whole and at == (ends[whole - 1] if whole else 0)
    for column, kind in ((0, "u2"), (1, "u1"), (2, "i4")):
        count, width = counts[:whole, column].copy(), int(widths[column])
        out = np.empty(int(count.sum()) * width, np.uint8)
        join_bytes(raw, starts[:whole, column].copy(), count, width, out)
        expected = [v for row in rows[:whole] for v in ([row[1]] if column == 1 else row[column])]  # type: ignore[misc]
        assert out.view(order + kind).tolist() == expected


@pytest.mark.parametrize("count", [-1.0, 0.5, np.nan, np.inf, 1e300])
def test_counts_that_are_none(count: float) -> None:
    starts, counts = np.empty((1, 1), np.int64), np.empty((1, 1), np.int64)
    assert number_rows(np.array([count, 1.0]), np.array([True]), starts, counts) == (-1, 0)


def test_counts_beyond_all_bytes() -> None:
    """Eight bytes of a count may be any number: nothing overflows."""
    starts, counts = np.empty((1, 1), np.int64), np.empty((1, 1), np.int64)
    raw = np.full(64, 255, np.uint8)
    assert byte_rows(raw, np.array([8]), np.array([8]), False, starts, counts) == (0, 0)
