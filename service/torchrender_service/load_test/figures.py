"""How quick single pictures are, whether budgets are kept, and how soon the service is there."""

from __future__ import annotations

import asyncio
import json
import statistics
import time
import urllib.request

from torchrender_service.load_test.driver import ServerUnderTest, running_server
from torchrender_service.load_test.raw import ask
from torchrender_service.load_test.rows import Effort, Row

LITTLE = {"scene": "cornell_box", "width": 160, "height": 120}
ASKERS = 8
WARM_UP_S, STEADY, WARM_UPS = 3.0, 1.05, (3, 6)
"""Pictures are asked for until a stretch of so many seconds brings hardly more than the one before; stretches, least
and most."""
OFF = 0.10
HONEST = "127.0.0.1"


def _render(server: ServerUnderTest, body: dict[str, object]) -> tuple[int, float]:
    """Status and seconds of a picture."""
    begin = time.perf_counter()
    status, _ = ask(server, "POST", "/v1/render", body, source=HONEST)
    return status, time.perf_counter() - begin


async def throughput_rows(server: ServerUnderTest, effort: Effort) -> list[Row]:
    """Small pictures as fast as they come, once the rate shows that the process that helps out has started."""

    async def asked(seconds: float) -> float:
        begin, done = time.perf_counter(), 0

        async def asking() -> None:
            nonlocal done
            while time.perf_counter() < begin + seconds:
                status, _ = await asyncio.to_thread(_render, server, LITTLE)
                done += status == 200

        await asyncio.gather(*(asking() for _ in range(ASKERS)))
        return done / (time.perf_counter() - begin)

    rates: list[float] = []
    while len(rates) < WARM_UPS[0] or (rates[-1] > STEADY * rates[-2] and len(rates) < WARM_UPS[1]):
        rates.append(await asked(WARM_UP_S))
    rate = await asked(5.0 if effort.quick else 15.0)
    return [
        Row(
            what=f"pictures of cornell_box, 160 × 120, {ASKERS} clients",
            goal="≥ 60/s",
            measured=f"{rate:.0f}/s",
            met=rate >= 60.0,
        )
    ]


async def budget_rows(server: ServerUnderTest, effort: Effort) -> list[Row]:
    """The same view again and again within a budget, from the second picture on."""
    rows = []
    for budget_ms in (500.0, 100.0):
        body = {"scene": effort.scene, "width": 640, "height": 360, "budget_ms": budget_ms}
        took = []
        for _ in range(5 if effort.quick else 15):
            request = await asyncio.to_thread(_plan, server, body)
            took.append(request["measured_ms"])
        later = took[1:]
        worst = max(later) / budget_ms - 1.0
        rows.append(
            Row(
                what=f"{effort.scene} by REST within {budget_ms:.0f} ms, 640 × 360",
                goal="±10 % at most from the second picture on (less where everything fits)",
                measured=f"{took[0]:.0f} ms, then {min(later):.0f} to {max(later):.0f} ms, "
                f"median {statistics.median(later):.0f}",
                met=worst <= OFF,
            )
        )
    return rows


def _plan(server: ServerUnderTest, body: dict[str, object]) -> dict[str, float]:
    """What a picture took, as the server says."""
    data, headers = json.dumps(body).encode(), {"Content-Type": "application/json"}
    request = urllib.request.Request(server.url + "/v1/render", data, headers, method="POST")
    with urllib.request.urlopen(request, timeout=300) as response:
        response.read()
        timing = dict(part.split(";dur=") for part in response.headers["Server-Timing"].split(", "))
    return {"measured_ms": float(timing["total"])}


async def start_rows(effort: Effort) -> list[Row]:
    """From the start of a process to its first picture, with the kernels of an earlier one."""
    begin = time.perf_counter()
    with running_server(built_in=effort.scene, log_level="warning") as server:
        while (await asyncio.to_thread(ask, server, "GET", "/ready"))[0] != 200:
            await asyncio.sleep(0.05)
        ready = time.perf_counter() - begin
        body: dict[str, object] = {"scene": effort.scene, "width": 320, "height": 180}
        _, first = await asyncio.to_thread(_render, server, body)
        _, second = await asyncio.to_thread(_render, server, body)
    return [
        Row(what="start of the server until /ready", goal="≤ 4 s", measured=f"{ready:.1f} s", met=ready <= 4.0),
        Row(
            what=f"first picture after /ready, {effort.scene}, 320 × 180, and the next one",
            goal="≤ 10 s, ≤ 0.5 s",
            measured=f"{first:.2f} s, {second:.2f} s",
            met=first <= 10.0 and second <= 0.5,
        ),
    ]
