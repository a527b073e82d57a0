"""What a study says while it runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def part(name: str) -> Iterator[None]:
    """Say on standard error which part has been measured, and the seconds that it took."""
    begin = time.perf_counter()
    yield
    sys.stderr.write(f"{name}: {time.perf_counter() - begin:.1f} s\n")
    sys.stderr.flush()
