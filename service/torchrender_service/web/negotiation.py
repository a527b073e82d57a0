"""Which of several representations a client wants (RFC 9110, section 12.5.1), and what is said beside one."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

from torchrender_service.errors import ServiceError

_MAX_RANGES = 32
_MAX_WARNING_BYTES = 4000


def negotiate(accept: str | None, offered: Sequence[str]) -> str:
    """The media type out of ``offered`` that the Accept header likes best; among equals the first one offered.

    Raises:
        ServiceError: 406, none of them.
    """
    if accept is None or not accept.strip():
        return offered[0]
    ranges = [_parse(part) for part in accept.split(",")[:_MAX_RANGES]]
    best, chosen = 0.0, None
    for media_type in offered:
        fitting = [(precision, q) for name, q in ranges if (precision := _precision(name, media_type)) > 0]
        quality = max(fitting)[1] if fitting else 0.0
        if quality > best:
            best, chosen = quality, media_type
    if chosen is None:
        raise ServiceError(406, "not-acceptable", f"Accept must allow one of {', '.join(offered)}")
    return chosen


def warning_headers(warnings: Sequence[str]) -> dict[str, str]:
    """What is said beside a result that is no JSON: a JSON list, as many of them as a header may hold."""
    kept = list(warnings)
    while kept and len(json.dumps(kept)) > _MAX_WARNING_BYTES:
        kept.pop()
    return {"Torchrender-Warnings": json.dumps(kept)} if kept else {}


def _parse(part: str) -> tuple[str, float]:
    name, *parameters = (word.strip().lower() for word in part.split(";"))
    quality = 1.0
    for parameter in parameters:
        key, _, value = parameter.partition("=")
        if key.strip() == "q":
            try:
                quality = float(value)
            except ValueError:
                quality = 0.0
    return name, quality if math.isfinite(quality) and 0.0 <= quality <= 1.0 else 0.0


def _precision(name: str, media_type: str) -> int:
    """3: that very type, 2: all of its kind, 1: everything, 0: another one."""
    if name == media_type:
        return 3
    if name == media_type.partition("/")[0] + "/*":
        return 2
    return 1 if name == "*/*" else 0
