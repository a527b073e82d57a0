"""Other numbers of threads for a while."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba


def most_threads() -> int:
    """As many as parallel kernels may ever take in this process."""
    return int(numba.config.NUMBA_NUM_THREADS)


@contextmanager
def exact_threads(count: int) -> Iterator[None]:
    """Parallel kernels that this thread calls take so many threads in here, also more than just before."""
    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(count, most_threads())))
    try:
        yield
    finally:
        numba.set_num_threads(before)


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Parallel kernels that this thread calls take at most ``count`` threads in here."""
    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(count, before)))
    try:
        yield
    finally:
        numba.set_num_threads(before)
