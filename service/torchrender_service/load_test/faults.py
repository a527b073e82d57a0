"""Bad messages, killed connections, hundreds of connects, memory over time, and the end of the server."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import random
import signal
import statistics
import time
from collections import Counter

import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from torchrender.wire.messages import SUBPROTOCOL, Bye, Keyframe, Pose, decode, encode
from torchrender_service.load_test.driver import LoadTestError, ServerUnderTest, client
from torchrender_service.load_test.rows import Effort, Row

SMALL = {"width": 96, "height": 54, "layers": 0}
SAMPLE_S = 1.0
WARM_UP = 0.5  # share of the soak that is left out of the growth: processes start, and each loads what it needs once


async def message_rows(server: ServerUnderTest, effort: Effort) -> list[Row]:
    """Messages that are cut off, changed or random, each on a connection that was good before."""
    noise, outcomes = random.Random(0), Counter[str]()
    before = server.memory_mb()
    for number in range(30 if effort.quick else 300):
        async with client(server, "cornell_box", **SMALL) as one:
            good = encode(Pose(seq=1, time_ms=0.0, camera=one.welcome.camera))
            kind = ("cut off", "changed", "random", "oversized")[number % 4]
            data = {
                "cut off": good[: noise.randrange(len(good))],
                "changed": _changed(good, noise),
                "random": noise.randbytes(noise.randrange(1, 2000)),
                "oversized": bytes(70_000),
            }[kind]
            outcomes[f"{kind}: {await _outcome(one.socket, data)}"] += 1
    grown = server.memory_mb() - before
    alive = json.loads(server.get("/health"))["status"] == "ok"
    bad = sum(count for text, count in outcomes.items() if "nothing" in text and not text.startswith("changed"))
    return [
        Row(
            what="messages that are cut off, changed, random or oversized",
            goal="typed error or clean close; never a crash",
            measured="; ".join(f"{text} {count}" for text, count in sorted(outcomes.items())),
            met=alive and bad == 0,
            details={"memory_mb": grown},
        )
    ]


def _changed(good: bytes, noise: random.Random) -> bytes:
    data = bytearray(good)
    for _ in range(noise.randint(1, 20)):
        data[noise.randrange(len(data))] = noise.randrange(256)
    return bytes(data)


async def _outcome(ws: ClientConnection, data: bytes) -> str:
    """What the server does about a message: "error", "close CODE", or "nothing" within a moment."""
    try:
        await ws.send(data)
        while True:
            answer = await asyncio.wait_for(ws.recv(), 1.0)
            assert isinstance(answer, bytes)
            kind = type(decode(answer).message).__name__
            if kind == "Problem":
                return "error"
            if kind == "Keyframe":
                return "keyframe"
    except asyncio.TimeoutError:
        return "nothing"
    except ConnectionClosed as error:
        return f"close {error.rcvd.code if error.rcvd else 1006}"


async def connection_rows(server: ServerUnderTest, effort: Effort) -> list[Row]:
    """Connections that break, and more connects than anybody needs."""
    count = 10 if effort.quick else 50

    async def broken() -> None:
        with contextlib.suppress(ConnectionClosed):
            async with client(server, "cornell_box", **SMALL) as one:
                await one.send_pose()
                one.socket.transport.abort()

    for _ in range(count // 5):
        await asyncio.gather(*(broken() for _ in range(5)))
    begin = time.perf_counter()
    while server.gauge("streams") > 0 and time.perf_counter() - begin < 30:
        await asyncio.sleep(0.1)
    left = server.gauge("streams")
    attempts, refused = 400 if not effort.quick else 100, Counter[str]()

    async def knock() -> None:
        try:
            async with connect(
                f"ws://{server.host}:{server.port}/v1/stream",
                subprotocols=[SUBPROTOCOL, "bearer.x"],  # type: ignore[list-item]
                compression=None,
            ):
                refused["accepted"] += 1
        except InvalidStatus as error:
            refused[str(error.response.status_code)] += 1

    begin = time.perf_counter()
    for _ in range(attempts // 20):
        await asyncio.gather(*(knock() for _ in range(20)))
    rate = attempts / (time.perf_counter() - begin)
    return [
        Row(
            what=f"{count} connections killed in the middle of a keyframe",
            goal="nothing stays behind",
            measured=f"{left:.0f} streams left",
            met=left == 0,
        ),
        Row(
            what="connects without a ticket",
            goal="≥ 200/s, each refused",
            measured=f"{rate:.0f}/s; " + ", ".join(f"{n} × {code}" for code, n in refused.items()),
            met=rate >= 200.0 and set(refused) == {"403"},
        ),
    ]


async def soak_rows(server: ServerUnderTest, effort: Effort) -> list[Row]:
    """Many sessions that walk, some of which come and go, while memory is watched."""
    seconds = 20.0 if effort.quick else effort.soak_s
    samples: list[tuple[float, float]] = []
    end = time.perf_counter() + seconds
    received: list[int] = []

    async def one_session(number: int) -> None:
        while (left := end - time.perf_counter()) > 0.5:
            stay = left if number % 5 else min(left, 20.0)
            async with client(server, "cornell_box", **SMALL) as one:
                await one.walk(stay, period_s=20.0, reach=0.05)
                received.append(one.received)

    async def watch() -> None:
        while time.perf_counter() < end:
            samples.append((time.perf_counter(), server.memory_mb()))
            await asyncio.sleep(SAMPLE_S)

    watching = asyncio.create_task(watch())
    await asyncio.gather(*(one_session(number) for number in range(effort.sessions)))
    await watching
    if not samples or samples[0][1] == 0.0:
        raise LoadTestError("the memory of other processes is not known on this system")
    settled = [s for s in samples if s[0] > samples[0][0] + WARM_UP * seconds]
    times, sizes = (np.array(column) for column in zip(*settled))
    per_hour = 100.0 * 3600.0 * float(np.polyfit(times - times[0], sizes, 1)[0]) / statistics.median(sizes)
    return [
        Row(
            what=f"{effort.sessions} sessions for {seconds / 60:.1f} minutes: memory of all processes",
            goal="growth < 5 % in an hour",
            measured=f"{per_hour:+.1f} % in an hour by a straight line through the second half, {len(settled)} samples "
            f"(median {statistics.median(sizes):.0f} MB); {sum(received)} keyframes",
            met=per_hour < 5.0,
            details={"growth_percent_per_hour": per_hour, "memory_mb": [round(s, 1) for _, s in samples]},
        )
    ]


async def shutdown_rows(server: ServerUnderTest, effort: Effort) -> list[Row]:
    """SIGTERM while a client walks. The server is gone afterwards."""
    messages: list[object] = []
    async with client(server, effort.scene, width=effort.size[0], height=effort.size[1]) as one:
        await one.walk(1.0)
        await one.send_pose(0.2)
        begin = time.perf_counter()
        os.kill(server.pid, signal.SIGTERM)
        code = 0
        try:
            while True:
                data = await asyncio.wait_for(one.socket.recv(), 20.0)
                assert isinstance(data, bytes)
                messages.append(decode(data).message)
        except ConnectionClosed as error:
            code = error.rcvd.code if error.rcvd else 1006
    assert server.process is not None
    await asyncio.to_thread(server.process.wait, 30)
    took = time.perf_counter() - begin
    said = any(isinstance(m, Bye) for m in messages)
    return [
        Row(
            what="SIGTERM in the middle of a keyframe",
            goal="BYE, close 1012, exit within 10 s",
            measured=f"{'BYE, ' if said else ''}close {code}, exit after {took:.1f} s",
            met=said and code == 1012 and took < 10.0,
        )
    ]


async def sample_keyframe(server: ServerUnderTest, effort: Effort) -> bytes:
    """The first message of a stream, as it came."""
    async with client(server, effort.scene, width=effort.size[0], height=effort.size[1], layers=0) as one:
        await one.send_pose()
        while True:
            data = await one.socket.recv()
            assert isinstance(data, bytes)
            if isinstance(decode(data).message, Keyframe):
                return data
