"""Wall time per step, and what may come between two steps of whatever is being made."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import NamedTuple


class Interruption:
    """What is called between steps, and the time that it took away."""

    def __init__(self, check: Callable[[], None]) -> None:
        self._check = check
        self.away_s = 0.0

    def __call__(self) -> None:
        """Let others work; what they raise ends whatever is being made."""
        begin = time.perf_counter()
        token = _BETWEEN.set(None)  # what is done meanwhile is not interrupted again
        try:
            self._check()
        finally:
            _BETWEEN.reset(token)
            self.away_s += time.perf_counter() - begin


_BETWEEN: ContextVar[Interruption | None] = ContextVar("between", default=None)


@contextmanager
def interruptible(check: Callable[[], None]) -> Iterator[None]:
    """Pictures that are made inside call ``check`` between their passes: it may do other work, whose time is not
    counted as theirs, or raise to end them."""
    token = _BETWEEN.set(Interruption(check))
    try:
        yield
    finally:
        _BETWEEN.reset(token)


_holding = threading.Lock()
_holders = 0
_collects = False
"""Whether garbage was collected before the first of those who hold that up began."""


@contextmanager
def garbage_left() -> Iterator[None]:
    """No garbage is collected in here, of all threads: a look at everything that a process holds takes as long as a
    picture. What came meanwhile is looked at afterwards, once."""
    global _holders, _collects
    with _holding:
        if _holders == 0:
            _collects = gc.isenabled()
            gc.disable()
        _holders += 1
    try:
        yield
    finally:
        with _holding:
            _holders -= 1
            if _holders == 0 and _collects:
                gc.enable()


_TASKS = Path("/proc/self/task")


class ProcessorTimes(NamedTuple):
    """Seconds that the threads of this process ran, and waited for a processor that others had."""

    ran: float
    waited: float

    @classmethod
    def now(cls) -> ProcessorTimes | None:
        """Since they began; None where the system does not tell (Linux does)."""
        ran = waited = 0
        try:
            for task in _TASKS.iterdir():
                words = (task / "schedstat").read_text().split()
                ran, waited = ran + int(words[0]), waited + int(words[1])
        except (OSError, ValueError, IndexError):  # no Linux, or a thread that ended meanwhile
            return None
        return cls(1e-9 * ran, 1e-9 * waited)

    def share(self, before: ProcessorTimes) -> float:
        """Of waiting, between two times."""
        ran, waited = max(0.0, self.ran - before.ran), max(0.0, self.waited - before.waited)
        return waited / max(ran + waited, 1e-9)


class StepClock:
    """Milliseconds by the name of the step; steps that come again add up.

    Args:
        watched: tell how much of the time passes waiting for a processor.
    """

    def __init__(self, *, watched: bool = False) -> None:
        self.elapsed_ms: dict[str, float] = {}
        self._begin = ProcessorTimes.now() if watched else None

    @property
    def waited(self) -> float:
        """Share of the time since it was made, in which there was something to do, that passed waiting; 0: unknown."""
        now = None if self._begin is None else ProcessorTimes.now()
        return 0.0 if self._begin is None or now is None else now.share(self._begin)

    @contextmanager
    def measure(self, step: str) -> Iterator[None]:
        """Time what runs inside, without what came between its own steps."""
        between = _BETWEEN.get()
        if between is not None:
            between()
        away_s = 0.0 if between is None else between.away_s
        begin = time.perf_counter()
        yield
        passed = time.perf_counter() - begin
        if between is not None:
            passed -= between.away_s - away_s
        self.elapsed_ms[step] = self.elapsed_ms.get(step, 0.0) + 1e3 * passed
