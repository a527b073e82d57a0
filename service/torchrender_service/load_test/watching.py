"""What honest clients notice while something happens to the server, and what it takes."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable
from dataclasses import dataclass, field

from torchrender_service.load_test.driver import LoadClient, ServerUnderTest, percentile
from torchrender_service.load_test.raw import ask

HEALTH_S = 0.05


@dataclass(eq=False)
class Seen:
    """What honest clients notice, and what the server takes, in one stretch of time."""

    latencies_s: list[float] = field(default_factory=list)
    health_s: list[float] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)
    log_bytes: float = 0.0
    seconds: float = 0.0
    server_s: float = 0.0  # processor time of the server process
    renderers_s: float = 0.0  # of its children

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


async def watch(server: ServerUnderTest, sessions: list[LoadClient], work: Awaitable[None]) -> Seen:
    """What is seen while something happens."""
    seen, begin, log, used = Seen(), time.perf_counter(), server.log_bytes(), server.processor_s()
    for one in sessions:
        one.latencies_s.clear()

    async def ask_health() -> None:
        while True:
            began = time.perf_counter()
            status, _ = await asyncio.to_thread(ask, server, "GET", "/health")
            seen.health_s.append(time.perf_counter() - began if status == 200 else float("inf"))
            seen.memory_mb.append(server.memory_mb())
            await asyncio.sleep(HEALTH_S)

    asking = asyncio.create_task(ask_health())
    await work
    asking.cancel()
    await asyncio.gather(asking, return_exceptions=True)
    seen.latencies_s = [s for one in sessions for s in one.latencies_s]
    seen.seconds = time.perf_counter() - begin
    seen.log_bytes = server.log_bytes() - log
    seen.server_s, seen.renderers_s = (now - then for now, then in zip(server.processor_s(), used, strict=True))
    return seen
