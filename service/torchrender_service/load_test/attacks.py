"""What one client without a key can do to the others: nine attacks, each beside ten honest sessions."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from torchrender_service.load_test.driver import ServerUnderTest
from torchrender_service.load_test.files import large_texture_glb, long_key_toml, long_name_glb
from torchrender_service.load_test.raw import Raw, ask, post_head


@dataclass(frozen=True, kw_only=True)
class Attack:
    """``play`` goes on until it is ended, or returns what it found out; ``prepare`` makes what it sends; ``once``: what
    it did to the service as it was when the attack was found, by hand and not beside honest sessions."""

    name: str
    once: str
    play: Callable[[ServerUnderTest], Awaitable[str]]
    prepare: Callable[[], Any] = lambda: None
    slower: float = 1.10  # p95 of honest sessions at most, as a multiple of what it is without
    longer: float = 1.0  # goes on so many times as long as others at most
    watched: float = 1.0  # at least so many times as long as without it, for what comes once must not be all of it


PICTURE = {"scene": "cornell_box", "width": 64, "height": 48}
HUGE = {"scene": "cornell_box", "width": 2560, "height": 1440}
PIECE = 2**16
"""Bytes of a body that are sent at a time."""


async def half_sent_headers(server: ServerUnderTest) -> str:
    """1,100 connections that send a part of their headers; those that are ended come again."""
    opened = 0

    async def one() -> None:
        nonlocal opened
        while True:
            try:
                async with Raw(server) as raw:
                    opened += 1
                    await raw.send(b"GET / HTTP/1.1\r\nhost: local")
                    await raw.until_ended()
            except OSError:
                pass
            await asyncio.sleep(0.2)

    await asyncio.gather(*(one() for _ in range(1100)))
    return ""


@lru_cache(maxsize=1)
def _textures() -> list[bytes]:
    return [large_texture_glb(8192, number) for number in range(5)]


async def textures(server: ServerUnderTest) -> str:
    """Five scenes of a few hundred KB whose texture has 8192 x 8192 texels, and a picture of each."""
    statuses = []
    for body in _textures():
        status, answer = await asyncio.to_thread(ask, server, "POST", "/v1/scenes", body, "model/gltf-binary")
        statuses.append(status)
        if status in (200, 201):
            scene = json.loads(answer)["id"]
            statuses.append(
                (await asyncio.to_thread(ask, server, "POST", "/v1/render", {**PICTURE, "scene": scene}))[0]
            )
            await asyncio.to_thread(ask, server, "DELETE", f"/v1/scenes/{scene}")
    good = all(status in (200, 201, 422, 429) for status in statuses)
    return f"answers {', '.join(map(str, statuses))}{'' if good else ' MISSED'}"


async def clients_that_left(server: ServerUnderTest) -> str:
    """20 pictures that are asked for and not waited for, again and again; then a small one that is."""
    body = json.dumps({**PICTURE, "width": 640, "height": 480, "options": {"supersample": 1.0}}).encode()
    for _ in range(3):
        for _ in range(20):
            async with Raw(server) as raw:
                await raw.send(post_head("/v1/render", len(body)) + body)
                await asyncio.sleep(0.01)
    begin = time.perf_counter()
    await asyncio.to_thread(ask, server, "POST", "/v1/render", PICTURE)
    return f"the next picture after {time.perf_counter() - begin:.1f} s"


async def large_pictures(server: ServerUnderTest) -> str:
    """Two clients that render 2560 x 1440 all the time."""

    async def one() -> None:
        while True:
            await asyncio.to_thread(ask, server, "POST", "/v1/render", HUGE)

    await asyncio.gather(one(), one())
    return ""


async def killed_renderer(server: ServerUnderTest) -> str:
    """The renderer of all sessions is killed, as when the system runs out of memory."""
    killed, begin = server.renderer_pid(), time.perf_counter()
    os.kill(killed, signal.SIGKILL)
    while killed in server.children() and time.perf_counter() - begin < 1.0:  # until the server has noticed
        await asyncio.sleep(0.01)
    while (await asyncio.to_thread(ask, server, "POST", "/v1/render", PICTURE))[0] != 200:
        await asyncio.sleep(0.05)
    took = time.perf_counter() - begin
    deaths = b'torchrender_renderer_deaths_total{renderer="' in await asyncio.to_thread(server.get, "/metrics")
    return f"the next picture after {took:.1f} s, {'counted' if deaths else 'not counted MISSED'}"


@lru_cache(maxsize=1)
def _large_json() -> bytes:
    return b'{"container": "' + b"A" * 84_000_000


async def large_json(server: ServerUnderTest) -> str:
    """84 MB of JSON as the body of /v1/reproject."""
    body, status = memoryview(_large_json()), 0
    while True:
        async with Raw(server) as raw:
            with contextlib.suppress(OSError):
                await raw.send(post_head("/v1/reproject", len(body)))
                for begin in range(0, len(body), PIECE):  # the whole would be copied, while others are measured
                    await raw.send(body[begin : begin + PIECE])
            status = await raw.status()
        if status not in (0, 413, 429, 503):
            return f"status {status} MISSED"
        await asyncio.sleep(0.05)


async def slow_uploads(server: ServerUnderTest) -> str:
    """Eight uploads that drip, while somebody else uploads."""

    async def drip() -> None:
        while True:
            with contextlib.suppress(OSError):
                async with Raw(server) as raw:
                    await raw.send(post_head("/v1/scenes", 10_000, "application/toml"))
                    for _ in range(10_000):
                        await raw.send(b"#")
                        await asyncio.sleep(0.2)

    dripping = [asyncio.create_task(drip()) for _ in range(8)]
    await asyncio.sleep(1.0)
    begin = time.perf_counter()
    text = f'name = "n{begin}"\n[[geometry]]\nshape = "box"\n'.encode()
    status, _ = await asyncio.to_thread(ask, server, "POST", "/v1/scenes", text, "application/toml", "127.0.0.1")
    took = time.perf_counter() - begin
    for task in dripping:
        task.cancel()
    await asyncio.gather(*dripping, return_exceptions=True)
    return f"another upload: {status} after {took:.1f} s{'' if status == 201 else ' MISSED'}"


async def long_names(server: ServerUnderTest) -> str:
    """A scene whose name has 3 MB."""
    data = long_name_glb(3_000_000)
    status, answer = await asyncio.to_thread(ask, server, "POST", "/v1/scenes", data, "model/gltf-binary")
    listed = len((await asyncio.to_thread(ask, server, "GET", "/v1/scenes"))[1])
    if status == 201:
        await asyncio.to_thread(ask, server, "DELETE", f"/v1/scenes/{json.loads(answer)['id']}")
    return f"upload {status}, the list has {listed} bytes{'' if listed < 20_000 else ' MISSED'}"


async def long_keys(server: ServerUnderTest) -> str:
    """A dotted key of 90 KB in a scene file, while somebody else uploads."""
    begin = time.perf_counter()
    bad = asyncio.to_thread(ask, server, "POST", "/v1/scenes", long_key_toml(90_000), "application/toml")
    text = f'name = "k{begin}"\n[[geometry]]\nshape = "box"\n'.encode()
    good = asyncio.to_thread(ask, server, "POST", "/v1/scenes", text, "application/toml", "127.0.0.1")
    (status, _), (other, _) = await asyncio.gather(bad, good)
    took = time.perf_counter() - begin
    fine = status == 422 and other == 201
    return f"refused with {status}, another upload: {other}, both after {took:.1f} s{'' if fine else ' MISSED'}"


ATTACKS = (
    Attack(
        name="1,100 connections with half-sent headers",
        once="everything down, 174 MB of log in a minute",
        play=half_sent_headers,
    ),
    Attack(
        name="five scenes with a texture of 8192 × 8192",
        once="7.7 GB until deleted, every later scene refused",
        play=textures,
        prepare=_textures,
        longer=4.0,
    ),
    Attack(name="pictures whose clients leave", once="the next picture after 32 s", play=clients_that_left),
    Attack(
        name="two clients that render 2560 × 1440",
        once="pose to keyframe 86 ms → 19.3 s",
        play=large_pictures,
        slower=2.0,
    ),
    Attack(name="a renderer is killed", once="2.2 s; an idle one never came back", play=killed_renderer, watched=4.0),
    Attack(name="84 MB of JSON to /v1/reproject", once="/health 3.7 s, 2.1 GB", play=large_json, prepare=_large_json),
    Attack(name="eight uploads that drip", once="nobody else could upload", play=slow_uploads),
    Attack(name="a scene with a name of 3 MB", once="list, WELCOME and page broken for all", play=long_names),
    Attack(name="a dotted key of 90 KB", once="10.6 s, and other uploads waited", play=long_keys),
)
