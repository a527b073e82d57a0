"""What honest clients notice while something happens to the server, and what it takes."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import time
from collections.abc import AsyncIterator, Awaitable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from torchrender_service.load_test.driver import (
    LoadClient,
    ServerUnderTest,
    all_processor_s,
    family,
    percentile,
    processor_s,
)
from torchrender_service.load_test.raw import ask

HEALTH_S = 0.05
BLOCK_S = 0.5
"""Latencies within such a time hang together: a hold-up makes several late."""
DISTURBED = 0.15
"""Cores that other programs take, from which on a time says little about the server."""
LEAST = 6
"""Blocks without others; with fewer all count."""
DRAWS = 2000
SURE = 0.9


@dataclass(eq=False)
class Seen:
    """What honest clients notice, and what the server takes, in one stretch of time."""

    blocks: list[list[float]] = field(default_factory=list)  # latencies, seconds, of each BLOCK_S
    disturbed: list[list[float]] = field(default_factory=list)  # of each in which others took some of this machine
    health_s: list[float] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)
    log_bytes: float = 0.0
    seconds: float = 0.0
    server_s: float = 0.0  # processor time of the server process
    renderers_s: float = 0.0  # of its children

    @classmethod
    def together(cls, stretches: Sequence[Seen]) -> Seen:
        """Several stretches as one."""
        made = cls()
        for one in stretches:
            for each in fields(cls):
                setattr(made, each.name, getattr(made, each.name) + getattr(one, each.name))
        return made

    @property
    def counted(self) -> list[list[float]]:
        """The blocks that count: those that nobody disturbed, unless these are too few to say anything."""
        return self.blocks if len(self.blocks) >= LEAST else [*self.blocks, *self.disturbed]

    @property
    def latencies_s(self) -> list[float]:
        """From a pose to its keyframe, in the blocks that count."""
        return [value for block in self.counted for value in block]

    @property
    def p95_ms(self) -> float:
        """From a pose to its keyframe; infinite where none came."""
        return 1e3 * percentile(self.latencies_s, 0.95) if self.latencies_s else math.inf

    @property
    def health_ms(self) -> float:
        """p99 of /health."""
        return 1e3 * percentile(self.health_s, 0.99)

    @property
    def log_per_minute(self) -> float:
        """Bytes that the log grew by, in a minute."""
        return 60.0 * self.log_bytes / max(self.seconds, 1e-9)


class Change(NamedTuple):
    """p95 of one stretch as a multiple of another's, and the interval that holds it with probability SURE."""

    times: float
    low: float
    high: float

    def __str__(self) -> str:
        if not math.isfinite(self.times):
            return "not known"
        percent = (100.0 * (value - 1.0) for value in self)
        return "{:+.0f} % [{:+.0f}, {:+.0f}]".format(*percent)

    def decides(self, limit: float) -> bool:
        """Whether it lies on one side of a limit for sure."""
        return self.high <= limit or self.low > limit


UNKNOWN = Change(math.inf, 0.0, math.inf)


def change_of(before: Seen, during: Seen, seed: int = 0) -> Change:
    """How p95 changed. The interval is a bootstrap one: blocks of time are drawn anew, with replacement."""
    if not before.latencies_s or not during.latencies_s:
        return UNKNOWN
    rng = np.random.default_rng(seed)
    drawn = [_drawn_p95(seen, rng) for seen in (during, before)]
    low, high = np.quantile(drawn[0] / drawn[1], [(1.0 - SURE) / 2.0, (1.0 + SURE) / 2.0])
    return Change(during.p95_ms / before.p95_ms, float(low), float(high))


def _drawn_p95(seen: Seen, rng: np.random.Generator) -> np.ndarray[Any, Any]:
    """(DRAWS,) p95 of blocks that were drawn: each latency counts as often as its block came."""
    blocks = [block for block in seen.counted if block]
    values = np.array([value for block in blocks for value in block])
    block_of = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
    order = np.argsort(values)
    often = rng.multinomial(len(blocks), np.full(len(blocks), 1.0 / len(blocks)), size=DRAWS)
    passed = often[:, block_of[order]].cumsum(axis=1)
    at = (passed >= np.ceil(0.95 * passed[:, -1:])).argmax(axis=1)
    found: np.ndarray[Any, Any] = values[order][at]
    return found


def left_out(stretches: list[Seen]) -> str:
    """How much was disturbed, in words."""
    disturbed = sum(len(one.disturbed) for one in stretches)
    if not disturbed:
        return ""
    share = 100 * disturbed / (disturbed + sum(len(one.blocks) for one in stretches))
    told = "left out" if all(one.counted is one.blocks for one in stretches) else "disturbed, and too much to leave out"
    return f", {share:.0f} % {told}"


class Others:
    """How much of this machine programs take that have nothing to do with the test.

    Args:
        server: its processes, those of this one and their children are the test's own.
    """

    def __init__(self, server: ServerUnderTest) -> None:
        self._server = server
        self._last = self._now()

    def cores(self) -> float:
        """Since the last look; 0 where the system does not tell."""
        before, self._last = self._last, self._now()
        passed, busy, own = (now - then for now, then in zip(self._last, before, strict=True))
        return max(0.0, busy - own) / max(passed, 1e-3)

    def _now(self) -> tuple[float, float, float]:
        """A clock, seconds that all processes ran, and those of the test."""
        apart = [pid for pid in family(os.getpid())[1:] if pid != self._server.pid]
        own = sum(processor_s(os.getpid())) + sum(self._server.processor_s())
        return time.perf_counter(), all_processor_s(), own + sum(sum(processor_s(pid)) for pid in apart)


@contextlib.asynccontextmanager
async def noting(server: ServerUnderTest, sessions: Sequence[LoadClient], seen: Seen) -> AsyncIterator[None]:
    """Latencies of these clients become blocks of what is seen, for as long as this lasts; those from a time in which
    others took some of this machine apart."""
    others = Others(server)
    for one in sessions:
        one.latencies_s.clear()

    def note() -> None:
        found = seen.disturbed if others.cores() > DISTURBED else seen.blocks
        found.append([value for one in sessions for value in one.latencies_s])
        for one in sessions:
            one.latencies_s.clear()

    async def cut() -> None:
        while True:
            await asyncio.sleep(BLOCK_S)
            note()

    cutting = asyncio.create_task(cut())
    try:
        yield
    finally:
        cutting.cancel()
        await asyncio.gather(cutting, return_exceptions=True)
        note()


async def watch(server: ServerUnderTest, sessions: list[LoadClient], work: Awaitable[None]) -> Seen:
    """What is seen while something happens."""
    seen, begin, log, used = Seen(), time.perf_counter(), server.log_bytes(), server.processor_s()

    async def ask_health() -> None:
        while True:
            began = time.perf_counter()
            status, _ = await asyncio.to_thread(ask, server, "GET", "/health")
            seen.health_s.append(time.perf_counter() - began if status == 200 else float("inf"))
            seen.memory_mb.append(server.memory_mb())
            await asyncio.sleep(HEALTH_S)

    async with noting(server, sessions, seen):
        asking = asyncio.create_task(ask_health())
        await work
        asking.cancel()
        await asyncio.gather(asking, return_exceptions=True)
    seen.seconds = time.perf_counter() - begin
    seen.log_bytes = server.log_bytes() - log
    seen.server_s, seen.renderers_s = (now - then for now, then in zip(server.processor_s(), used, strict=True))
    return seen
