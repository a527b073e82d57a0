"""Clients that look about, and what processes use meanwhile."""

from __future__ import annotations

import asyncio
import os
import statistics
import time
from contextlib import AsyncExitStack
from http.client import HTTPConnection
from typing import Any

from torchrender.errors import TorchRenderError
from torchrender.report.distributed.cluster import command_line, descendants
from torchrender_service.load_test.driver import ServerUnderTest, client, percentile

SCENE = "cornell_box"
LOOKED_AT = {"width": 640, "height": 360, "layers": 0}
"""Of one whose keyframes count: what the page asks for on a laptop."""
TICKS = os.sysconf("SC_CLK_TCK")


def health_s(server: ServerUnderTest, count: int) -> list[float]:
    """Seconds of answers, one after the other over one connection."""
    found = []
    asking = HTTPConnection(server.host, server.port, timeout=30.0)
    for _ in range(count + 10):
        begin = time.perf_counter()
        asking.request("GET", "/health")
        with asking.getresponse() as response:
            response.read()
        found.append(time.perf_counter() - begin)
        if response.status != 200:
            raise TorchRenderError(f"/health answers {response.status}")
    asking.close()
    return found[10:]


async def looking(
    server: ServerUnderTest, count: int, seconds: float, *, period_s: float, reach: float = 0.08
) -> dict[str, Any]:
    """Clients that look to and fro: keyframes a second, their latency, and what was computed meanwhile.

    Args:
        reach: to each side, in diagonals of the scene; 0: they tell the same view again and again, which needs no
            keyframe.
    """
    async with AsyncExitStack() as stack:
        clients = [await stack.enter_async_context(client(server, SCENE, **LOOKED_AT)) for _ in range(count)]
        looks = [
            asyncio.create_task(
                c.look_around(reach=reach, period_s=period_s, begin_s=period_s * k / count, overtaken=False)
            )
            for k, c in enumerate(clients)
        ]
        await asyncio.sleep(max(1.0, seconds / 4))
        before, made = [len(c.latencies_s) for c in clients], [c.received for c in clients]
        spent, size = cpu_s(server), sum(c.bytes for c in clients)
        begin = time.perf_counter()
        await asyncio.sleep(seconds)
        took = time.perf_counter() - begin
        renderers, rest = (b - a for a, b in zip(spent, cpu_s(server), strict=True))
        size, keyframes = sum(c.bytes for c in clients) - size, sum(c.received for c in clients) - sum(made)
        for look in looks:
            look.cancel()
        await asyncio.gather(*looks, return_exceptions=True)
    times = [t for c, n in zip(clients, before, strict=True) for t in c.latencies_s[n:]]
    rendered = [ms for c, n in zip(clients, made, strict=True) for ms in c.render_ms[n:]]
    return {
        "sessions": count,
        "period_s": period_s,
        "keyframes_per_s": keyframes / took,
        "latency_ms": [1e3 * percentile(times, share) for share in (0.5, 0.95)] if times else [0.0, 0.0],
        "render_ms": [statistics.fmean(rendered), statistics.pstdev(rendered)] if rendered else [0.0, 0.0],
        "keyframe_bytes": size / max(1, keyframes),
        "renderer_cpu_s": renderers / took,
        "other_cpu_s": rest / took,
    }


def cpu_s(server: ServerUnderTest) -> tuple[float, float]:
    """Seconds of a core that renderers have used so far, and all else: servers, proxies, and this process."""
    renderers = rest = 0.0
    for pid in {*descendants(server.pid), os.getpid()}:
        try:
            with open(f"/proc/{pid}/stat") as file:
                fields = file.read().rpartition(")")[2].split()
        except OSError:
            continue
        used = (int(fields[11]) + int(fields[12])) / TICKS
        renders = "renderers.worker" in command_line(pid)
        renderers, rest = (renderers + used, rest) if renders else (renderers, rest + used)
    return renderers, rest
