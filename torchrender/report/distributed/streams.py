"""Streams over two replicas of Ray Serve beside a server of two renderers: who is refused, how quick, and what a kill
costs."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, WebSocketException

from torchrender.errors import TorchRenderError
from torchrender.report.distributed.cluster import RayUnderTest, running_on_ray
from torchrender.report.distributed.watching import SCENE, cpu_s, health_s, looking
from torchrender.wire.messages import SUBPROTOCOL, Bye, Keyframe, decode
from torchrender_service.load_test.driver import (
    MAX_BYTES,
    POSES_PER_S,
    LoadClient,
    ServerUnderTest,
    client,
    open_stream,
    percentile,
    running_server,
)

VIEW = {"width": 160, "height": 90, "layers": 0}
"""Of a stream where only its coming and going counts."""
POSES_S = 1.0 / POSES_PER_S
"""Between two poses of a client that wants all it can get."""
NO_LIMITS = ("max_sessions", "max_sessions_per_address", "requests_per_s", "connections_per_s")
SETTINGS = {
    **dict.fromkeys(NO_LIMITS, "100000"),
    "built_in": SCENE,
    "threads": "1",
    "renderers": "1",
    "spare_renderer": "false",
    "batch_renderer": "false",
    "still_s": "86400",  # keyframes of moving views alone: pictures at rest take whatever time is left
    "log_level": "warning",
    "max_requests_per_address": "512",
}
READY_S = 120.0


@dataclass(frozen=True, kw_only=True)
class StreamEffort:
    """How long everything is measured."""

    seconds: float = 12.0
    clients: int = 8  # that keep all renderers busy
    opened: int = 100
    asked: int = 300  # /health


QUICK = StreamEffort(seconds=3.0, clients=4, opened=12, asked=50)


def server_record(effort: StreamEffort) -> dict[str, Any]:
    """A server with two renderers."""
    with ready(running_server(**{**SETTINGS, "renderers": "2"})) as server:
        return asyncio.run(served(server, effort))


def replica_record(effort: StreamEffort, *, haproxy: bool = False) -> dict[str, Any]:
    """Two replicas with a renderer each, behind Ray's proxy or HAProxy.

    Raises:
        TorchRenderError: HAProxy is not installed.
    """
    with ready(running_on_ray(2, haproxy, **SETTINGS)) as server:
        found = asyncio.run(served(server, effort))
        found["opened"] = asyncio.run(opened(server, effort))
        found["compressed"] = asyncio.run(compressed(server))
        return found | {"upload_s": upload_seen_s(server)}


def lost_record(effort: StreamEffort) -> dict[str, Any]:
    """Two replicas of which one is killed; and when it is back, one taken away."""
    with ready(running_on_ray(2, False, **SETTINGS)) as server:
        found = asyncio.run(killed(server, effort))
        end = time.monotonic() + READY_S
        while len(server.replicas()) < 2 and time.monotonic() < end:
            time.sleep(0.2)
        time.sleep(2.0)
        return {"killed": found, "scaled": asyncio.run(scaled_down(server))}


@contextmanager
def ready(starting: Any) -> Iterator[Any]:
    """A server whose renderers are there, all of them.

    Raises:
        TorchRenderError: it does not get ready.
    """
    with starting as server:
        end, row = time.monotonic() + READY_S, 0
        while row < 8:  # requests go to the replicas by chance
            try:
                server.get("/ready")
                row += 1
            except HTTPError:
                row = 0
                time.sleep(0.2)
            if time.monotonic() > end:
                raise TorchRenderError("the server does not get ready")
        yield server


async def served(server: ServerUnderTest, effort: StreamEffort) -> dict[str, Any]:
    """Health, one client at leisure, as many as keep all busy, one that wants all it can get, and as many that tell the
    same view again and again."""
    answers = await asyncio.to_thread(health_s, server, effort.asked)
    before = cpu_s(server)[1]
    await asyncio.sleep(effort.seconds / 3)
    idle = (cpu_s(server)[1] - before) / (effort.seconds / 3)
    leisure = await looking(server, 1, effort.seconds / 2, period_s=0.25)
    busy = await looking(server, effort.clients, effort.seconds, period_s=POSES_S)
    half = await looking(server, effort.clients, effort.seconds, period_s=1.0)
    alone = await looking(server, 1, effort.seconds / 2, period_s=POSES_S)
    standing = await looking(server, effort.clients, effort.seconds / 2, period_s=POSES_S, reach=0.0)
    return {
        "health_ms": [1e3 * percentile(answers, share) for share in (0.5, 0.99)],
        "memory_mb": server.memory_mb(),
        "idle_cpu_s": idle,
        "alone": alone,
        "standing": standing,
        "leisure": leisure,
        "busy": busy,
        "half": half,
    }


async def opened(server: RayUnderTest, effort: StreamEffort) -> dict[str, Any]:
    """Streams that are opened all at once, each until its first keyframe."""

    async def one() -> str:
        try:
            async with client(server, SCENE, **VIEW) as made:
                await made.send_pose()
                while await asyncio.wait_for(made.receive(), 60.0) is None:
                    continue
        except (OSError, WebSocketException, asyncio.TimeoutError) as error:
            return type(error).__name__
        return ""

    begin = time.perf_counter()
    said = await asyncio.gather(*(one() for _ in range(effort.opened)))
    refused = [what for what in said if what]
    return {
        "asked": effort.opened,
        "refused": len(refused),
        "why": sorted(set(refused)),
        "s": time.perf_counter() - begin,
    }


async def compressed(server: RayUnderTest) -> dict[str, Any]:
    """What a client that offers compression, as browsers do, gets from the proxy."""
    session = await asyncio.to_thread(server.post, "/v1/sessions", {"scene": SCENE, **VIEW})
    ticket = json.loads(session)["ticket"]
    url = f"ws://{server.host}:{server.port}/v1/stream"
    protocols: Any = [SUBPROTOCOL, f"bearer.{ticket}"]
    async with connect(url, subprotocols=protocols, compression="deflate", max_size=MAX_BYTES) as socket:
        return {"deflate": bool(socket.protocol.extensions)}


def upload_seen_s(server: RayUnderTest) -> float:
    """Seconds from the answer to an upload until both replicas know it: 20 answers in a row."""
    data = b'name = "box"\n[[geometry]]\nshape = "box"\nsize = 1.5\n'
    request = Request(server.url + "/v1/scenes", data, {"Content-Type": "application/toml"}, method="POST")
    with urlopen(request, timeout=120) as response:
        scene = json.loads(response.read())["id"]
    begin = since = time.monotonic()
    row = 0
    while row < 20:
        try:
            server.get(f"/v1/scenes/{scene}")
            row += 1
        except HTTPError:
            row, since = 0, time.monotonic()
    return since - begin


async def killed(server: RayUnderTest, effort: StreamEffort) -> dict[str, Any]:
    """One of two replicas is killed: when its clients have a keyframe again, and what the others notice."""
    back: list[float] = []
    killed_at = 0.0

    async def hold(first: LoadClient) -> None:
        with suppress(ConnectionClosed):
            await first.look_around(period_s=0.5)
        resume = first.welcome.resume
        while True:
            try:
                async with open_stream(server, resume, pose_at=first.welcome.camera) as again:
                    while await again.receive() is None:
                        continue
                    back.append(time.perf_counter() - killed_at)
                    await again.look_around(period_s=0.5)
            except (OSError, WebSocketException):
                await asyncio.sleep(0.1)

    async with AsyncExitStack() as stack:
        clients = [await stack.enter_async_context(client(server, SCENE, **VIEW)) for _ in range(4)]
        holding = [asyncio.create_task(hold(c)) for c in clients]
        await asyncio.sleep(effort.seconds / 2)
        before = [len(c.latencies_s) for c in clients]
        killed_at = time.perf_counter()
        os.kill(server.replicas()[0], signal.SIGKILL)
        await asyncio.sleep(effort.seconds)
        for one in holding:
            one.cancel()
        await asyncio.gather(*holding, return_exceptions=True)
    stayed = [c for c, n in zip(clients, before, strict=True) if len(c.latencies_s) > n + effort.seconds]
    earlier = [t for c, n in zip(clients, before, strict=True) if c in stayed for t in c.latencies_s[:n]]
    later = [t for c, n in zip(clients, before, strict=True) if c in stayed for t in c.latencies_s[n:]]
    return {
        "clients": len(clients),
        "lost": len(clients) - len(stayed),
        "back_s": sorted(back),
        "p95_ms": [1e3 * percentile(earlier, 0.95), 1e3 * percentile(later, 0.95)],
    }


async def scaled_down(server: RayUnderTest) -> dict[str, Any]:
    """From two replicas to one: what their clients are told."""
    said: list[tuple[str, int | None, float]] = []
    begin = 0.0

    async def hear(made: LoadClient) -> None:
        reason = ""
        try:
            while True:
                message = decode(await made.socket.recv(decode=False)).message
                if isinstance(message, Bye):
                    reason = message.reason
                elif isinstance(message, Keyframe):
                    continue
        except ConnectionClosed as closed:
            code = None if closed.rcvd is None else closed.rcvd.code
            said.append((reason, code, time.perf_counter() - begin))

    async with AsyncExitStack() as stack:
        clients = [await stack.enter_async_context(client(server, SCENE, **VIEW)) for _ in range(8)]
        hearing = [asyncio.create_task(hear(c)) for c in clients]
        await asyncio.sleep(1.0)
        begin = time.perf_counter()
        server.scale(1)
        end = time.monotonic() + 20.0
        while not said and time.monotonic() < end:
            await asyncio.sleep(0.1)
        await asyncio.sleep(2.0)
        for one in hearing:
            one.cancel()
        await asyncio.gather(*hearing, return_exceptions=True)
    return {"clients": len(clients), "told": said}
