"""A slow, shaky link on loopback: a relay that delays what goes through it.

TCP hides loss from programs: a lost segment comes again after the retransmission time, and everything behind it waits.
So loss here is a delay of one round trip and 200 ms now and then, and the order stays.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from dataclasses import dataclass
from types import TracebackType

from torchrender.checks import checked_fields

CHUNK = 16384
RETRANSMISSION_S = 0.2


@dataclass(frozen=True, kw_only=True)
@checked_fields
class LinkOptions:
    """Of both directions."""

    round_trip_s: float = 0.0
    jitter_s: float = 0.0  # each way, up or down
    loss: float = 0.0  # share of segments


class Link:
    """Relays connections to ``(host, port)``; an async context manager that gives its own port."""

    def __init__(self, host: str, port: int, options: LinkOptions, seed: int = 0) -> None:
        self._target = (host, port)
        self._options = options
        self._random = random.Random(seed)
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self.port = 0

    async def __aenter__(self) -> Link:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        assert self._server is not None
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            other_reader, other_writer = await asyncio.open_connection(*self._target)
        except OSError:
            writer.close()
            return
        for source, target in ((reader, other_writer), (other_reader, writer)):
            task = asyncio.create_task(self._relay(source, target))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _relay(self, source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
        """Bytes wait in a queue until their time has come; what is on the link does not hold up reading."""
        loop = asyncio.get_running_loop()
        queue: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()

        async def deliver() -> None:
            while True:
                due, data = await queue.get()
                await asyncio.sleep(max(0.0, due - loop.time()))
                if not data:
                    return
                target.write(data)
                await target.drain()

        delivery = asyncio.create_task(deliver())
        last = 0.0
        try:
            with contextlib.suppress(ConnectionError):
                while data := await source.read(CHUNK):
                    last = max(last, loop.time() + self._delay())
                    queue.put_nowait((last, data))
                queue.put_nowait((last, b""))
                await delivery
        finally:
            delivery.cancel()
            target.close()

    def _delay(self) -> float:
        options = self._options
        delay = options.round_trip_s / 2 + self._random.uniform(-1.0, 1.0) * options.jitter_s
        if self._random.random() < options.loss:
            delay += options.round_trip_s + RETRANSMISSION_S
        return max(0.0, delay)
