"""Wall time per step."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StepClock:
    """Milliseconds by the name of the step; steps that come again add up."""

    def __init__(self) -> None:
        self.elapsed_ms: dict[str, float] = {}

    @contextmanager
    def measure(self, step: str) -> Iterator[None]:
        """Time what runs inside."""
        begin = time.perf_counter()
        yield
        self.elapsed_ms[step] = self.elapsed_ms.get(step, 0.0) + 1e3 * (time.perf_counter() - begin)
