"""Times as ratios: the candidates take turns within one run, so that a busy machine slows all of them alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Timing:
    """Milliseconds over the runs."""

    median: float
    least: float
    greatest: float
    runs: int

    @classmethod
    def of(cls, seconds: list[float]) -> Timing:
        """From the seconds of each run."""
        ms = [1e3 * s for s in seconds]
        return cls(statistics.median(ms), min(ms), max(ms), len(ms))

    def record(self) -> dict[str, float]:
        """For JSON."""
        return {k: round(float(v), 3) for k, v in asdict(self).items()}


def take_turns(candidates: Mapping[str, Callable[[], object]], *, runs: int = 9, warm_up: int = 2) -> dict[str, Timing]:
    """Time every candidate ``runs`` times, in turn, after ``warm_up`` unmeasured rounds."""
    seconds: dict[str, list[float]] = {name: [] for name in candidates}
    for turn in range(warm_up + runs):
        for name, work in candidates.items():
            begin = time.perf_counter()
            work()
            if turn >= warm_up:
                seconds[name].append(time.perf_counter() - begin)
    return {name: Timing.of(values) for name, values in seconds.items()}
