"""Fewer threads, and as many as before afterwards."""

from __future__ import annotations

import pytest

from torchrender.kernels.compile import thread_count
from torchrender.kernels.threads import limited_threads


def test_threads_come_back_even_after_an_error() -> None:
    before = thread_count()
    with limited_threads(1):
        assert thread_count() == 1
        with limited_threads(before + 5):  # never more than there were
            assert thread_count() == 1
    with limited_threads(0):
        assert thread_count() == 1
    assert thread_count() == before
    with pytest.raises(ZeroDivisionError), limited_threads(1):
        raise ZeroDivisionError
    assert thread_count() == before
