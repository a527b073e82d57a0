"""Counters, gauges and histograms in the text format of Prometheus."""

from __future__ import annotations

import bisect
from collections import defaultdict
from collections.abc import Mapping

PREFIX = "torchrender_"
CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)

HELP = {
    "requests": "HTTP requests by route and status.",
    "request_seconds": "Time until the response was complete.",
    "job_seconds": "Time that a renderer worked on a job.",
    "renderers_restarted": "Renderers that died or took too long.",
    "renderer_deaths": "Renderers that ended by themselves or were killed from outside.",
    "renderer_memory_bytes": "Resident memory of each renderer after its last job.",
    "renderer_kept_bytes": "What each renderer keeps of scenes and pictures.",
    "renderer_evictions": "Scenes and histories that a renderer dropped to make room.",
    "queue_wait_seconds": "Time that jobs waited for a renderer, by class.",
    "jobs_cancelled": "Jobs whose client went away.",
    "connections": "Connections that are open.",
    "connections_ended": "Connections that the server closed, by the deadline that passed.",
    "addresses_shut_out": "Times that new connections of an address were left waiting for some seconds.",
    "keyframes": "Keyframes sent.",
    "keyframe_bytes": "Bytes of all messages of those keyframes.",
    "keyframe_latency_seconds": "From a pose's arrival to the acknowledgement of its keyframe.",
    "stream_errors": "Messages that could not be used, by kind.",
    "streams_dropped": "Streams that the server closed, by reason.",
    "rejected": "Requests refused by a limit, by kind.",
    "sessions": "Sessions of all replicas, connected or not.",
    "streams": "Streams that are connected.",
    "jobs": "Jobs waiting or running.",
    "scenes": "Scenes, built-in ones included.",
}

Labels = tuple[tuple[str, str], ...]


class Metrics:
    """What the service counts; used from one thread.

    Args:
        labels: of all values.
    """

    def __init__(self, labels: Mapping[str, str] | None = None) -> None:
        self._own = tuple(sorted((labels or {}).items()))
        self._counters: dict[tuple[str, Labels], float] = defaultdict(float)
        self._gauges: dict[tuple[str, Labels], float] = {}
        self._histograms: dict[tuple[str, Labels], list[float]] = {}

    def count(self, name: str, amount: float = 1.0, **labels: str) -> None:
        """Add to a counter."""
        self._counters[name, self._with_own(labels)] += amount

    def observe(self, name: str, seconds: float, **labels: str) -> None:
        """Add to a histogram."""
        key = name, self._with_own(labels)
        row = self._histograms.setdefault(key, [0.0] * (len(BUCKETS) + 2))
        row[bisect.bisect_left(BUCKETS, seconds)] += 1
        row[-1] += seconds

    def set(self, name: str, value: float, **labels: str) -> None:
        """Set a gauge."""
        self._gauges[name, self._with_own(labels)] = value

    def total(self, name: str, but: tuple[str, str]) -> tuple[float, float]:
        """Sum and count of a histogram over all labels, except those with the label ``but``."""
        rows = [row for (own, labels), row in self._histograms.items() if own == name and but not in labels]
        return sum(row[-1] for row in rows), sum(sum(row[:-1]) for row in rows)

    def text(self, gauges: Mapping[str, float]) -> str:
        """All values, with ``gauges`` as they are now."""
        lines: list[str] = []
        for name, value in sorted(gauges.items()):
            lines += [*_head(name, "gauge"), f"{PREFIX}{name}{_labels(self._own)} {value:g}"]
        for name in sorted({name for name, _ in self._gauges}):
            lines += _head(name, "gauge")
            rows = sorted((labels, value) for (n, labels), value in self._gauges.items() if n == name)
            lines += [f"{PREFIX}{name}{_labels(labels)} {value:.17g}" for labels, value in rows]
        for name in sorted({name for name, _ in self._counters}):
            lines += _head(f"{name}_total", "counter", name)
            rows = sorted((labels, value) for (n, labels), value in self._counters.items() if n == name)
            lines += [f"{PREFIX}{name}_total{_labels(labels)} {value:.17g}" for labels, value in rows]
        for name in sorted({name for name, _ in self._histograms}):
            lines += _head(name, "histogram")
            for (other, labels), row in sorted(self._histograms.items()):
                if other == name:
                    lines += _histogram(name, labels, row)
        return "\n".join(lines) + "\n"

    def _with_own(self, labels: dict[str, str]) -> Labels:
        return tuple(sorted((labels | dict(self._own)).items()))


def _head(name: str, kind: str, documented: str | None = None) -> list[str]:
    return [f"# HELP {PREFIX}{name} {HELP[documented or name]}", f"# TYPE {PREFIX}{name} {kind}"]


def _labels(labels: Labels) -> str:
    if not labels:
        return ""
    escaped = ((k, v.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")) for k, v in labels)
    return "{" + ",".join(f'{k}="{v}"' for k, v in escaped) + "}"


def _histogram(name: str, labels: Labels, row: list[float]) -> list[str]:
    lines, total = [], 0.0
    for edge, count in zip((*(f"{b:g}" for b in BUCKETS), "+Inf"), row[:-1]):
        total += count
        lines.append(f"{PREFIX}{name}_bucket{_labels((*labels, ('le', edge)))} {total:g}")
    lines.append(f"{PREFIX}{name}_sum{_labels(labels)} {row[-1]:.9g}")
    lines.append(f"{PREFIX}{name}_count{_labels(labels)} {total:g}")
    return lines
