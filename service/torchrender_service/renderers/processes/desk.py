"""The jobs of a renderer process, inside it: what to do next, and what may come between two passes of a picture."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable

from torchrender.clock import interruptible
from torchrender_service.renderers.processes.messages import Cancel, SentTask

SWITCH_S = 0.0005
"""Of two threads that both want the interpreter each has it so long: a keyframe takes it back some hundred times."""


class Cancelled(BaseException):
    """Nobody waits for the job that runs. No ``Exception``: nothing on the way may take it for an error of its own."""


class Desk:
    """Takes tasks from the thread that reads, and hands them to the one that works.

    Args:
        work: does a task and answers it.
        ahead: what must be done before a task, and has no passes; None: nothing. It is done in another thread, so that
            what comes by the express lane need not wait for it.
    """

    def __init__(
        self,
        work: Callable[[SentTask], None],
        ahead: Callable[[SentTask], Callable[[], None] | None] = lambda _: None,
    ) -> None:
        self._work = work
        self._ahead = ahead
        self._arrived = threading.Condition()
        self._tasks: deque[SentTask] = deque()
        self._express: deque[SentTask] = deque()
        self._unfinished: set[int] = set()
        self._cancelled: set[int] = set()
        self._closed = False
        self._doing: list[int] = []  # serials; the last one is worked on

    def put(self, message: SentTask | Cancel) -> None:
        """From the thread that reads."""
        with self._arrived:
            if isinstance(message, Cancel):
                if message.serial in self._unfinished:
                    self._cancelled.add(message.serial)
                    self._arrived.notify()
                return
            self._unfinished.add(message.serial)
            (self._express if message.express else self._tasks).append(message)
            self._arrived.notify()

    def close(self) -> None:
        """Nothing more will come."""
        with self._arrived:
            self._closed = True
            self._arrived.notify()

    def run(self) -> None:
        """Work until nothing more comes; tasks that stand here then are not begun."""
        while True:
            with self._arrived:
                while not (self._express or self._tasks or self._closed):
                    self._arrived.wait()
                if self._closed:
                    return
                task = self._express.popleft() if self._express else self._tasks.popleft()
            self._do(task)

    def check(self) -> None:
        """Between two passes: stop where nobody waits any more; do what came by the express lane.

        Raises:
            Cancelled: whoever asked for the job has gone.
        """
        if self._closed or self._doing[-1] in self._cancelled:
            raise Cancelled
        while len(self._doing) == 1:
            with self._arrived:
                if not self._express:
                    return
                task = self._express.popleft()
            self._do(task)

    def _do(self, task: SentTask) -> None:
        self._doing.append(task.serial)
        try:
            if len(self._doing) == 1:
                self._make_ready(task)
            with interruptible(self.check):
                self._work(task)
        finally:
            self._doing.pop()
            with self._arrived:
                self._unfinished.discard(task.serial)
                self._cancelled.discard(task.serial)

    def _make_ready(self, task: SentTask) -> None:
        """Have done what must be done ahead, or wait for it no longer than anybody waits for the task."""
        prepare = self._ahead(task)
        if prepare is None:
            return
        done = threading.Event()

        def run() -> None:
            usual = sys.getswitchinterval()
            sys.setswitchinterval(SWITCH_S)
            try:
                prepare()
            finally:
                sys.setswitchinterval(usual)
                with self._arrived:
                    done.set()
                    self._arrived.notify()

        threading.Thread(target=run, name="ahead", daemon=True).start()
        while True:
            with self._arrived:
                while not (self._express or self._closed or done.is_set() or self.cancelled(task)):
                    self._arrived.wait()
                if self._closed or done.is_set() or self.cancelled(task):
                    return
                urgent = self._express.popleft()
            self._do(urgent)

    def cancelled(self, task: SentTask) -> bool:
        """Whether nobody waits for a task any more."""
        return task.serial in self._cancelled
