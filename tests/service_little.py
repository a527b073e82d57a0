"""The service in a thread of the test, with nobody who renders: for what happens before any rendering."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from service_parts import FakePool
from service_server import RunningServer
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.asked import Asked
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import CheckKeyframes, Job, Locate, Render
from torchrender_service.settings import Settings, read_settings
from torchrender_service.web.server import Server, make_server

PICTURE = bytes(24 * 2**20)
FACTS = {
    "name": "box",
    "triangles": 12,
    "lights": 0,
    "cameras": [],
    "bounds": [[0.0] * 3, [1.0] * 3],
    "diagonal": 1.7,
    "animations": {},
    "report": {},
}


class PatientPool(FakePool):
    """Renders large empty pictures, or when told to wait, until somebody gives up."""

    def __init__(self, settings: Settings, metrics: Metrics) -> None:
        del settings, metrics
        super().__init__()
        self.waits = False
        self.begun = threading.Event()
        self.given_up = threading.Event()
        self.asked: list[Asked | None] = []

    async def run(
        self, job: Job, *, renderer: RendererHandle | None = None, asked: Asked | None = None
    ) -> dict[str, Any]:
        self.asked.append(asked)
        if self.waits:
            self.begun.set()
            try:
                await asyncio.sleep(60.0)
            except asyncio.CancelledError:
                self.given_up.set()
                raise
        return await super().run(job, renderer=renderer, asked=asked)

    def answer(self, job: Job) -> dict[str, Any]:
        if isinstance(job, Render):
            return {"file": PICTURE, "plan": {"rows": []}, "timings_ms": {}, "warnings": []}
        if isinstance(job, Locate):
            return super().answer(job)
        if isinstance(job, CheckKeyframes):
            return {}
        return dict(FACTS)


class LittleServer(RunningServer):
    """A server of this process."""

    server: Server

    @property
    def state(self) -> Any:
        app: Any = self.server.config.app
        return app.state.service

    @property
    def pool(self) -> PatientPool:
        found: PatientPool = self.state.pool
        return found

    def connect(self, source: str = "127.0.0.1", room: int | None = None) -> socket.socket:
        """A bare connection from an address of this machine."""
        host, _, port = self.address.partition(":")
        made = socket.socket()
        if room is not None:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, room)
        made.bind((source, 0))
        made.settimeout(20.0)
        made.connect((host, int(port)))
        return made

    def counted(self, name: str, **labels: str) -> float:
        """A counter's value."""
        counters = self.state.metrics._counters
        return float(counters[name, tuple(sorted(labels.items()))])


@contextmanager
def little_server(data: Path, **settings: Any) -> Iterator[LittleServer]:
    """A server with these settings, until the end of the block."""
    given = {"port": 0, "data_dir": str(data), "built_in": ["cornell_box"], **settings}
    server = make_server(read_settings(None, {}, **given), PatientPool)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    end = time.monotonic() + 60.0
    while not server.started:
        assert thread.is_alive() and time.monotonic() < end, "the server does not start"
        time.sleep(0.01)
    host, port = server.servers[0].sockets[0].getsockname()[:2]
    running = LittleServer(None, f"http://{host}:{port}", [])  # type: ignore[arg-type]
    running.server = server
    try:
        yield running
    finally:
        server.should_exit = True
        thread.join(30.0)
        assert not thread.is_alive(), "the server does not stop"
