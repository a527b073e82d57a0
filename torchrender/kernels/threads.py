"""Fewer threads for a while."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Parallel kernels that this thread calls take at most ``count`` threads in here."""
    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(count, before)))
    try:
        yield
    finally:
        numba.set_num_threads(before)
