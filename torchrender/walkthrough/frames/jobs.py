"""Work on photos side by side, with bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import torch

T = TypeVar("T")
R = TypeVar("R")


class Jobs:
    """A few threads: most of the work on a photo is done by libraries that let go of the interpreter."""

    def __init__(self) -> None:
        self._count = max(torch.get_num_threads(), 1)
        self._pool = ThreadPoolExecutor(self._count)
        self._open: deque[Future[Any]] = deque()

    def start(self, work: Callable[..., object], *arguments: object) -> None:
        """Begin some work; waits while too much is begun already."""
        while len(self._open) >= 2 * self._count:
            self._open.popleft().result()
        self._open.append(self._pool.submit(work, *arguments))

    def finish(self) -> None:
        """Wait for all work, and raise what it raised."""
        while self._open:
            self._open.popleft().result()

    def ordered(self, work: Callable[[T], R], items: Iterable[T]) -> Iterator[tuple[T, R]]:
        """Each item with what ``work`` made of it, in order; only a few are worked on ahead."""
        waiting: deque[tuple[T, Future[R]]] = deque()
        for item in items:
            waiting.append((item, self._pool.submit(work, item)))
            if len(waiting) > self._count:
                first, future = waiting.popleft()
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()
