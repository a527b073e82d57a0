"""uvicorn's protocols with deadlines: for headers, bodies, answers that are not read, and idle connections."""

from __future__ import annotations

import asyncio
import json
import time
from typing import TYPE_CHECKING, Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from torchrender_service.door.address import peer_of
from torchrender_service.door.connections import Connections
from torchrender_service.settings import Settings

if TYPE_CHECKING:
    from asyncio import BaseTransport

LINGER_S = 5.0
"""After a close the peer may take this long to read what was sent before."""
PROGRESS = 16 * 1024
"""Bytes of a body or of an answer that must go over the wire within each deadline."""
LATE = "the request did not come in time"


class Deadlines:
    """What a connection is waited for, and since when."""

    def __init__(self, settings: Settings) -> None:
        self._limits = {
            "header": settings.header_s,
            "body": settings.body_s,
            "idle": settings.idle_s,
            "answer": settings.write_s,
            "close": LINGER_S,
        }
        self._since: dict[str, float] = {}

    def begin(self, what: str) -> None:
        """From now on it is waited for; again: progress was made."""
        self._since[what] = time.monotonic()

    def end(self, *what: str) -> None:
        """It is there."""
        for one in what:
            self._since.pop(one, None)

    def missed(self, now: float) -> str | None:
        """What is waited for since too long."""
        return next((what for what, since in self._since.items() if now - since > self._limits[what]), None)


class PatientProtocol(HttpToolsProtocol):
    """HTTP, with limits to the patience. Made for a server by :func:`http_protocol`."""

    visits: Connections
    settings: Settings

    def connection_made(self, transport: BaseTransport) -> None:
        """Let it in, or close it at once."""
        super().connection_made(transport)  # type: ignore[arg-type]
        self.address = peer_of(transport.get_extra_info("peername"))
        self.deadlines = Deadlines(self.settings)
        self._body = 0  # bytes since the deadline began
        self._unsent = 0  # bytes of the answer when its deadline began
        if not self.visits.come(self):
            self.transport.abort()
            return
        self.deadlines.begin("header")

    def connection_lost(self, exc: Exception | None) -> None:
        """Also stop counting it."""
        self.visits.gone(self)
        self.deadlines = Deadlines(self.settings)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """What comes after it was turned away is not looked at."""
        if not self.transport.is_closing():
            super().data_received(data)

    def on_message_begin(self) -> None:
        """A request begins."""
        super().on_message_begin()
        self.deadlines.end("idle")
        self.deadlines.begin("header")

    def on_headers_complete(self) -> None:
        """Its headers are there."""
        self.deadlines.end("header")
        self.deadlines.begin("body")
        self._body = 0
        self.visits.works(self)
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """A part of its body is there."""
        super().on_body(body)
        self._body += len(body)
        if self._body >= PROGRESS:
            self._body = 0
            self.deadlines.begin("body")

    def on_message_complete(self) -> None:
        """All of it is there."""
        self.deadlines.end("body")
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """The answer is on its way."""
        if self.transport is not None and not self.transport.is_closing() and not self.pipeline:
            self.deadlines.begin("idle")
            self.visits.waits(self)
        elif self.transport is not None and self.transport.is_closing():
            self._unsent = self._left
            self.deadlines.begin("answer" if self._unsent else "close")
        super().on_response_complete()
        self._unset_keepalive_if_required()  # the deadline for idle connections does it

    @property
    def _left(self) -> int:
        """Bytes that the peer has not taken."""
        return int(self.transport.get_write_buffer_size())

    def pause_writing(self) -> None:
        """The peer does not read as fast as it is answered."""
        super().pause_writing()
        self._unsent = self._left
        self.deadlines.begin("answer")

    def resume_writing(self) -> None:
        """It has caught up."""
        super().resume_writing()
        self.deadlines.end("answer")

    def overdue(self, now: float) -> str | None:
        """See :class:`Visitor`."""
        missed = self.deadlines.missed(now)
        if missed == "body" and self.flow.read_paused:  # the server's own fault
            self.deadlines.begin("body")
            return None
        if missed in ("answer", "close"):
            left = self._left
            if 0 < left <= self._unsent - PROGRESS:
                self._unsent = left
                self.deadlines.begin(missed)
                return None
        return missed

    def turn_away(self, reason: str) -> None:
        """See :class:`Visitor`: with an answer where a request has begun and none was sent."""
        self.visits.gone(self)
        started = self.cycle is not None and self.cycle.response_started and not self.cycle.response_complete
        if reason in ("header", "body") and not started and not self.transport.is_closing():
            self.transport.write(_late())
            self.transport.close()
            self.loop.call_later(1.0, self.transport.abort)
        else:
            self.transport.abort()

    def handle_websocket_upgrade(self) -> None:
        """The connection goes on as a stream."""
        super().handle_websocket_upgrade()
        protocol: Any = self.transport.get_protocol()
        if protocol is not self:
            self.deadlines = Deadlines(self.settings)
            self.visits.gone(self)
            protocol.taken_over(self.visits, self.address)


class StreamProtocol(WebSocketsSansIOProtocol):
    """Lets the application cut off a peer that does not read; closing would wait for it."""

    visits: Connections | None = None
    address = ""

    def taken_over(self, visits: Connections, address: str) -> None:
        """It was a connection of HTTP before, and is counted on."""
        self.visits, self.address = visits, address
        if not visits.come(self):
            self.transport.abort()
            return
        visits.works(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Also stop counting it."""
        if self.visits is not None:
            self.visits.gone(self)
        super().connection_lost(exc)

    def overdue(self, now: float) -> str | None:
        """See :class:`Visitor`: streams keep deadlines of their own."""
        del now
        return None

    def turn_away(self, reason: str) -> None:
        """See :class:`Visitor`."""
        del reason
        self.transport.abort()

    def handle_connect(self, event: Request) -> None:
        """Tell the application how."""
        super().handle_connect(event)
        scope: Any = getattr(self, "scope", None)
        if scope is not None:
            scope["extensions"]["torchrender.abort"] = self.transport.abort

    async def send(self, message: Any) -> None:
        """Also end connections that were refused or closed, whatever the peer does."""
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True  # the refusal was the whole handshake
        if message["type"] == "websocket.close":
            self.loop.call_later(LINGER_S, self.transport.abort)


def http_protocol(visits: Connections, settings: Settings) -> type[asyncio.Protocol]:
    """The protocol class for a server."""
    return type("ServerProtocol", (PatientProtocol,), {"visits": visits, "settings": settings})


def _late() -> bytes:
    problem = {"type": "urn:torchrender:problem:late", "title": "Too late", "status": 408, "detail": LATE}
    body = json.dumps(problem).encode()
    head = f"HTTP/1.1 408 Request Timeout\r\ncontent-type: application/problem+json\r\ncontent-length: {len(body)}"
    return head.encode() + b"\r\nconnection: close\r\n\r\n" + body
