"""Processes that give way stand still while a keyframe is made that somebody moves by.

The system gives them the cores that a keyframe leaves over, and takes these back when they are wanted. But threads of a
keyframe meet many times, and each time the last one waits for its core; and what all cores share, the largest cache and
the way to memory, has no order of who comes first. So where keyframes are made on all cores, whatever nobody waits for
that urgently is stopped until they are done.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from time import monotonic

LONGEST_S = 0.1
"""A keyframe that takes longer is none that somebody moves by: whoever stands still goes on."""
SHARE = 0.25
"""Of the time that they stood still they have run at least so much before they are stopped again."""
_STOP: signal.Signals | None = getattr(signal, "SIGSTOP", None)
_GO: signal.Signals | None = getattr(signal, "SIGCONT", None)


class Pauses:
    """Stops processes and lets them go on; without effect where the system has no such signals.

    Args:
        renderers: that share all cores: while fewer make keyframes there are cores for others.
    """

    def __init__(self, renderers: int = 1) -> None:
        self._renderers = renderers
        self._making: set[str] = set()
        self._aside: set[asyncio.subprocess.Process] = set()
        self._stopped = False
        self._since = 0.0  # that they run, or stand still
        self._stood_s = 0.0  # the last time
        self._timer: asyncio.TimerHandle | None = None

    def note(self, renderer: str, making: bool) -> None:
        """A renderer makes a keyframe from now on, or none any more."""
        if making == (renderer in self._making):
            return
        (self._making.add if making else self._making.discard)(renderer)
        if self._stopped and not self._wanted:
            self._go_on()
        elif making:
            self._stop()

    def join(self, process: asyncio.subprocess.Process | None) -> None:
        """This one gives way from now on."""
        if process is None or process in self._aside:
            return
        self._aside.add(process)
        if self._stopped:
            _send(process, _STOP)
        else:
            self._stop()

    def leave(self, process: asyncio.subprocess.Process | None) -> None:
        """This one has nothing to do any more, or is waited for."""
        if process is None or process not in self._aside:
            return
        self._aside.discard(process)
        if self._stopped:
            _send(process, _GO)

    @property
    def _wanted(self) -> bool:
        return len(self._making) >= self._renderers

    def _stop(self) -> None:
        now = monotonic()
        enough = now - self._since >= SHARE * self._stood_s
        if self._stopped or not (self._aside and self._wanted and enough):
            return
        self._stopped, self._since = True, now
        self._timer = asyncio.get_running_loop().call_later(LONGEST_S, self._go_on)
        for process in self._aside:
            _send(process, _STOP)

    def _go_on(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        now = monotonic()
        self._stopped, self._stood_s, self._since = False, now - self._since, now
        for process in self._aside:
            _send(process, _GO)


def _send(process: asyncio.subprocess.Process, number: signal.Signals | None) -> None:
    if number is not None and process.returncode is None:
        with contextlib.suppress(ProcessLookupError):  # it ended just now
            process.send_signal(number)
