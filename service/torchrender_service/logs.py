"""Structured logs: one JSON object a line on standard error, without secrets.

Warnings are lines of it, too, each once a scene, and whoever asked for the job that warns is told as well.
"""

from __future__ import annotations

import json
import logging
import re
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from torchrender.errors import TorchRenderWarning

LOG = logging.getLogger("torchrender_service.logs")
LOG_BYTES_PER_S = 15_000.0
LOG_BURST_BYTES = 64_000.0
MOST_KNOWN = 1000
"""Warnings that are known to have been logged: then these are forgotten, and some come once more."""
_STANDARD = {
    *logging.LogRecord("", 0, "", 0, "", None, None).__dict__,
    "message",
    "asctime",
    "color_message",
    "taskName",
}
_SECRET = re.compile(r"(?i)(bearer[ .]+|\bticket=|\bkey=)[A-Za-z0-9_.~+/=-]+")


class JsonLines(logging.Formatter):
    """Time, level, logger, message and whatever else a record carries."""

    def format(self, record: logging.LogRecord) -> str:
        """One line."""
        values: dict[str, Any] = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created)) + f".{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        values |= {k: v for k, v in record.__dict__.items() if k not in _STANDARD}
        if record.exc_info:
            values["exception"] = self.formatException(record.exc_info)
        return _SECRET.sub(r"\1***", json.dumps(values, default=str))


class Budget(logging.StreamHandler[TextIO]):
    """Writes to a stream, and no more than so many bytes a second: whoever floods the service must not fill its disk.

    What does not fit is left out and counted; a line tells how many, once there is room again.
    """

    def __init__(self, stream: TextIO, bytes_per_s: float = LOG_BYTES_PER_S, burst: float = LOG_BURST_BYTES) -> None:
        super().__init__(stream)
        self._rate, self._burst = bytes_per_s, burst
        self._room, self._since = burst, time.monotonic()
        self._left_out = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Write it if there is room."""
        now = time.monotonic()
        self._room = min(self._burst, self._room + (now - self._since) * self._rate)
        self._since = now
        if self._room <= 0.0:
            self._left_out += 1
            return
        if self._left_out:
            count, self._left_out = self._left_out, 0
            text = f"{count} records were left out: there were too many"
            self.emit(logging.LogRecord(__name__, logging.WARNING, __file__, 0, text, None, None))
        text = self.format(record)
        self._room -= len(text) + 1
        try:
            self.stream.write(text + self.terminator)
            self.flush()
        except Exception:
            self.handleError(record)


def set_up_logs(level: str) -> None:
    """Send everything to standard error as JSON lines, warnings of Python, too."""
    handler = Budget(sys.stderr)
    handler.setFormatter(JsonLines())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    # Handshakes carry tickets; what matters of a connection is logged by the stream itself.
    for name in ("uvicorn.access", "uvicorn.error", "websockets"):
        logging.getLogger(name).setLevel("WARNING")
    listen()


@dataclass(frozen=True, eq=False)
class _Job:
    scene: str  # id; empty: none
    said: dict[str, type[Warning]] = field(default_factory=dict)


_JOB: ContextVar[_Job | None] = ContextVar("job", default=None)


@contextmanager
def hearing(scene: str) -> Iterator[Mapping[str, type[Warning]]]:
    """Warnings of this thread are those of a job about a scene, until the block ends; :func:`heard` tells them, and so
    does what the block is given, by text."""
    job = _Job(scene)
    token = _JOB.set(job)
    try:
        yield job.said
    finally:
        _JOB.reset(token)


def pass_on(said: Mapping[str, type[Warning]]) -> None:
    """What was heard elsewhere on behalf of the job of this thread, and is logged already, is heard by that, too."""
    job = _JOB.get()
    if job is not None:
        job.said.update(said)


@contextmanager
def collecting() -> Iterator[list[str]]:
    """All warnings inside, of any kind, each text once, in a list that is full when the block ends. They are shown, or
    logged, as they would have been without it."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        yield texts
    texts += dict.fromkeys(str(one.message) for one in said)
    for one in said:
        warnings.showwarning(one.message, one.category, one.filename, one.lineno)


def heard(*but: type[Warning]) -> list[str]:
    """What the job of this thread warned of so far but for some kinds, each text once; nothing where nobody listens."""
    job = _JOB.get()
    return [] if job is None else [text for text, kind in job.said.items() if not issubclass(kind, but)]


def listen() -> None:
    """Hear every warning of this process from now on, instead of printing it."""
    known: set[tuple[str, str]] = set()
    lock = threading.Lock()

    def hear(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        del file, line
        text, job = str(message), _JOB.get()
        scene = "" if job is None else job.scene
        if job is not None and issubclass(category, TorchRenderWarning):
            job.said[text] = category
        with lock:
            if (scene, text) in known:
                return
            if len(known) >= MOST_KNOWN:
                known.clear()
            known.add((scene, text))
        told = {"kind": category.__name__, "at": f"{Path(filename).name}:{lineno}"}
        LOG.warning("%s", text, extra=told | ({"scene": scene} if scene else {}))

    warnings.simplefilter("always", TorchRenderWarning)  # each job's client is told, not the first one's alone
    warnings.showwarning = hear
