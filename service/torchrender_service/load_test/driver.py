"""Servers and clients of the load test."""

from __future__ import annotations

import asyncio
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from torchrender.errors import TorchRenderError
from torchrender.wire.messages import (
    SUBPROTOCOL,
    Ack,
    Bye,
    CameraHeader,
    Hello,
    Keyframe,
    Pose,
    Problem,
    Welcome,
    decode,
    encode,
)
from torchrender_service.settings import PREFIX

POSES_PER_S = 30.0
MAX_BYTES = 2**26


class LoadTestError(TorchRenderError):
    """The server under test does something that makes measuring pointless."""


@dataclass(eq=False)
class ServerUnderTest:
    """A server process of its own; ``process`` is None where another program started it."""

    process: subprocess.Popen[str] | None
    pid: int
    host: str
    port: int
    log: Path | None = None
    attacker: str = "127.0.0.1"
    """Address that attacks come from: limits count by address."""

    def log_bytes(self) -> int:
        """What the server has written to its log."""
        return 0 if self.log is None else self.log.stat().st_size

    def children(self) -> list[int]:
        """Processes of its renderers."""
        return family(self.pid)[1:]

    def renderer_pid(self, name: str = "0") -> int:
        """Process of a renderer, of the only one that streams have, as the log tells: others stand ready, or start.

        Raises:
            LoadTestError: the log does not tell.
        """
        for line in reversed([] if self.log is None else self.log.read_text().splitlines()):
            if '"message": "renderer started"' in line and (told := json.loads(line))["renderer"] == name:
                return int(told["pid"])
        raise LoadTestError(f"the log tells of no renderer {name}")

    @property
    def url(self) -> str:
        """Address for HTTP."""
        return f"http://{self.host}:{self.port}"

    def get(self, path: str) -> bytes:
        """Body of a GET request."""
        with urllib.request.urlopen(self.url + path, timeout=60) as response:
            return bytes(response.read())

    def post(self, path: str, body: dict[str, Any], timeout_s: float = 300.0) -> bytes:
        """Body of the answer to a POST request with JSON."""
        headers = {"Content-Type": "application/json"}
        request = urllib.request.Request(self.url + path, json.dumps(body).encode(), headers, method="POST")
        with urllib.request.urlopen(request, timeout=timeout_s) as response:
            return bytes(response.read())

    def gauge(self, name: str) -> float:
        """A value of /metrics."""
        for line in self.get("/metrics").decode().splitlines():
            if line.startswith(f"torchrender_{name} "):
                return float(line.split()[1])
        raise LoadTestError(f"/metrics has no {name}")

    def memory_mb(self) -> float:
        """Resident memory of the server and its renderers; 0 where the system does not tell."""
        return sum(resident_mb(pid) for pid in family(self.pid))

    def processor_s(self) -> tuple[float, float]:
        """Processor time of the server alone, and of all its children, ended ones included."""
        own, ended = processor_s(self.pid)
        return own, ended + sum(sum(processor_s(pid)) for pid in self.children())

    def aside_s(self) -> dict[int, float]:
        """Processor time of each child but the renderer that streams have."""
        own = self.renderer_pid()
        return {pid: sum(processor_s(pid)) for pid in self.children() if pid != own}


@contextmanager
def running_server(**settings: str) -> Iterator[ServerUnderTest]:
    """A fresh server with settings as in the environment, in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "log").open("w") as log:
        environment = {k: v for k, v in os.environ.items() if not k.startswith(PREFIX)}
        environment |= {f"{PREFIX}{k.upper()}": v for k, v in settings.items()}
        command = [sys.executable, "-m", "torchrender.cli", "serve", "--port", "0", "--data", folder]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=log, text=True)
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if "http://" not in line:
                raise LoadTestError(f"the server does not start: {(Path(folder) / 'log').read_text()[-500:]}")
            host, _, port = line.split("http://")[1].strip().rstrip("/").partition(":")
            yield ServerUnderTest(process, process.pid, host, int(port), Path(folder) / "log")
        finally:
            process.terminate()
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()


@dataclass(eq=False)
class LoadClient:
    """One simulated client: walks to and fro, acknowledges, counts."""

    socket: ClientConnection
    welcome: Welcome
    opened_at: float
    latencies_s: list[float] = field(default_factory=list)  # from a pose to layer 0 of its keyframe
    render_ms: list[float] = field(default_factory=list)
    received: int = 0  # keyframes
    bytes: int = 0
    problems: int = 0
    counts_overtaken: bool = False  # a pose that has a keyframe only by a later one was waited for until then
    _sent: dict[int, float] = field(default_factory=dict)
    _number: int = 0

    async def send_pose(self, x: float = 0.0, speed: float = 0.0, *, moving: bool = True) -> None:
        """A pose ``x`` scene units to the right of the start."""
        camera = self.welcome.camera
        m = list(camera.world_from_camera)
        right = (m[0], m[4], m[8])
        for k in range(3):
            m[4 * k + 3] += x * right[k]
        self._number += 1
        self._sent[self._number] = time.perf_counter()
        moved: CameraHeader = msgspec.structs.replace(camera, world_from_camera=tuple(m))
        velocity = tuple(speed * r for r in right)
        await self.socket.send(
            encode(Pose(seq=self._number, time_ms=0.0, camera=moved, velocity=velocity, moving=moving))
        )

    async def receive(self) -> Keyframe | None:
        """The next message, acknowledged; None for anything but a keyframe."""
        data = await self.socket.recv()
        assert isinstance(data, bytes)
        message = decode(data).message
        self.bytes += len(data)
        if isinstance(message, Problem):
            self.problems += 1
        if not isinstance(message, Keyframe):
            return None
        if message.layer == 0:
            self.received += 1
            self.render_ms.append(message.render_ms)
            self._note(message)
            await self.socket.send(encode(Ack(id=message.id)))
        return message

    def _note(self, keyframe: Keyframe) -> None:
        """How long its pose was waited for."""
        now, pose = time.perf_counter(), keyframe.pose
        answered = [sent for k, sent in self._sent.items() if k == pose or (self.counts_overtaken and k < pose)]
        if not keyframe.still:
            self.latencies_s += [now - sent for sent in answered]
        self._sent = {k: v for k, v in self._sent.items() if k > pose}

    async def walk(
        self, seconds: float, *, reach: float = 0.03, period_s: float = 4.0, poses_per_s: float = POSES_PER_S
    ) -> None:
        """Walk to and fro, ``reach`` scene diagonals to each side."""
        size = reach * float(self.welcome.scene["diagonal"])
        reader = asyncio.create_task(self._read())
        try:
            begin = time.perf_counter()
            while (now := time.perf_counter() - begin) < seconds:
                phase = 2.0 * math.pi * now / period_s
                await self.send_pose(size * math.sin(phase), 2.0 * math.pi / period_s * size * math.cos(phase))
                await asyncio.sleep(1.0 / poses_per_s)
        finally:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)

    async def look_around(
        self, *, reach: float = 0.08, period_s: float = 1.0, begin_s: float = 0.0, overtaken: bool = True
    ) -> None:
        """Jump to and fro for ever, ``reach`` scene diagonals to each side and standing between: every pose needs a
        keyframe at once, so that its time is that of the picture and not of waiting until one is needed.

        Poses go out by the clock, however late the one before was: sessions that begin one after the other would else
        fall into step at the first hold-up, and wait for each other ever after.

        ``overtaken``: a pose that has a keyframe only by a later one counts as well, so that latencies are one a pose
        and not one a keyframe."""
        size, side = reach * float(self.welcome.scene["diagonal"]), 1.0
        self.counts_overtaken = overtaken
        reader = asyncio.create_task(self._read())
        loop = asyncio.get_running_loop()
        try:
            due = loop.time() + begin_s
            while True:
                await asyncio.sleep(due - loop.time())
                await self.send_pose(side * size)
                side = -side
                due += period_s * max(1.0, math.ceil((loop.time() - due) / period_s))
        finally:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)

    async def _read(self) -> None:
        while True:
            await self.receive()


@asynccontextmanager
async def client(
    server: ServerUnderTest, scene: str, *, port: int | None = None, **wishes: Any
) -> AsyncIterator[LoadClient]:
    """A connected client; ``port`` is that of a link to the server."""
    body = {"scene": scene, "width": 320, "height": 180, "layers": 1, **wishes}
    session = json.loads(await asyncio.to_thread(server.post, "/v1/sessions", body))
    async with open_stream(server, session["ticket"], port) as made:
        yield made


@asynccontextmanager
async def open_stream(
    server: ServerUnderTest, ticket: str, port: int | None = None, *, pose_at: CameraHeader | None = None
) -> AsyncIterator[LoadClient]:
    """A client with a ticket; says goodbye at the end. ``pose_at``: a pose goes out together with HELLO."""
    url = f"ws://{server.host}:{port or server.port}/v1/stream"
    protocols: Any = [SUBPROTOCOL, f"bearer.{ticket}"]
    async with connect(url, subprotocols=protocols, compression=None, max_size=MAX_BYTES) as socket:
        opened_at = time.perf_counter()
        await socket.send(encode(Hello(versions=(1, 1), color=("jpeg", "webp"))))
        if pose_at is not None:
            await socket.send(encode(Pose(seq=0, time_ms=0.0, camera=pose_at)))
        data = await socket.recv()
        assert isinstance(data, bytes)
        welcome = decode(data).message
        if not isinstance(welcome, Welcome):
            raise LoadTestError(f"HELLO was answered with {welcome}")
        yield LoadClient(socket, welcome, opened_at)
        try:
            await socket.send(encode(Bye(reason="done")))
        except ConnectionClosed:
            return


def percentile(values: list[float], share: float) -> float:
    """The value that ``share`` of all lie at or below; NaN where there are none."""
    if not values:
        return math.nan
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, max(0, math.ceil(share * len(ordered)) - 1))]


def family(pid: int) -> list[int]:
    """A process and its children."""
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return [pid]
    return [pid, *(int(child) for child in text.split())]


def processor_s(pid: int) -> tuple[float, float]:
    """Processor time of a process, and of those of its children that have ended; 0 where the system does not tell."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0, 0.0
    user, system, children_user, children_system = (int(word) / os.sysconf("SC_CLK_TCK") for word in words[11:15])
    return user + system, children_user + children_system


def all_processor_s() -> float:
    """Processor time of all processes of this machine, interrupts left out; 0 where the system does not tell."""
    try:
        words = Path("/proc/stat").read_text().split()
    except OSError:
        return 0.0
    user, nice, system = (int(word) / os.sysconf("SC_CLK_TCK") for word in words[1:4])
    return user + nice + system


def resident_mb(pid: int) -> float:
    """Of a process; 0 where the system does not tell."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError, ValueError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
