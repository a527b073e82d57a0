"""Structured logs: one JSON object a line on standard error, without secrets."""

from __future__ import annotations

import json
import logging
import re
import sys
import time
from typing import Any

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


def set_up_logs(level: str) -> None:
    """Send everything to standard error as JSON lines."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    # Handshakes carry tickets; what matters of a connection is logged by the stream itself.
    for name in ("uvicorn.access", "uvicorn.error", "websockets"):
        logging.getLogger(name).setLevel("WARNING")
