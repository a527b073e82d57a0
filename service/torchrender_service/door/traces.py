"""Spans of OpenTelemetry for requests and jobs, where its package is there; what collects them is set up outside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any


def _tracer() -> Any:
    try:
        return import_module("opentelemetry.trace").get_tracer("torchrender_service")
    except ImportError:
        return None


TRACER = _tracer()


@contextmanager
def span(name: str, facts: Mapping[str, str]) -> Iterator[Any]:
    """A span around the block; None where nobody traces."""
    if TRACER is None:
        yield None
        return
    with TRACER.start_as_current_span(name, attributes=dict(facts)) as made:
        yield made
