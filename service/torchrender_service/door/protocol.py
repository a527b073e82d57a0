"""uvicorn's protocols with deadlines: for headers, bodies, answers that are not read, and idle connections."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from torchrender_service.door.address import peer_of
from torchrender_service.door.connections import Connections
from torchrender_service.errors import ServiceError
from torchrender_service.problems import last_answer
from torchrender_service.settings import Settings

if TYPE_CHECKING:
    from asyncio import BaseTransport

LINGER_S = 5.0
"""After a close the peer may take this long to read what was sent before."""
PROGRESS = 16 * 1024
"""Bytes of a body or of an answer that must go over the wire within each deadline."""
MAX_HEAD = 64 * 1024
"""Bytes of the address of a request, and of all its headers."""
LAST_S = 1.0
"""What still comes is read so long after a last answer: a reset would take it from the peer."""
MAX_DROPPED = 2**22
"""Bytes of a body that are read, and dropped, after its request was answered. Many clients look for the answer once all
is sent; but to read whatever somebody sends is work without end."""
LATE = ServiceError(408, "late", "the request did not come in time")
MALFORMED = ServiceError(400, "malformed", "this is no request of HTTP/1.1 that the server understands")
LONG_ADDRESS = ServiceError(414, "address-too-long", f"an address may have at most {MAX_HEAD} bytes")
LARGE_HEAD = ServiceError(431, "headers-too-large", f"the headers may have at most {MAX_HEAD} bytes together")
FULL = ServiceError(429, "connections", "there are too many connections", retry_after_s=1.0)


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
        self._dropped = 0  # bytes of a body whose request was answered
        self._unsent = 0  # bytes of the answer when its deadline began
        self._head = 0  # bytes of headers that are there
        self._head_came = 0  # bytes since the request began, addresses and unfinished headers included
        self._in_head = False
        self._wrong = MALFORMED  # what is said where the parser gives up
        self._ended = False  # the last answer was given
        if not self.visits.come(self):
            self._ended = True
            self.transport.write(last_answer(FULL))
            self.transport.close()
            return
        self.deadlines.begin("header")

    def connection_lost(self, exc: Exception | None) -> None:
        """Also stop counting it."""
        self.visits.gone(self)
        self.deadlines = Deadlines(self.settings)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """What comes after it was turned away is not looked at."""
        if self._ended or self.transport.is_closing():
            return
        before = self._in_head
        super().data_received(data)
        if before and self._in_head:  # a header is not told before all of it is there
            self._head_came += len(data)
            if self._head_came > 2 * MAX_HEAD:
                self._end(LARGE_HEAD)

    def send_400_response(self, msg: str) -> None:
        """The parser has given up."""
        del msg
        self._end(self._wrong)

    def _end(self, error: ServiceError) -> None:
        """A last answer, where none is under way."""
        self._ended = True
        self.visits.gone(self)
        self.deadlines = Deadlines(self.settings)
        cycle = self.cycle
        if self.transport.is_closing() or (cycle and cycle.response_started and not cycle.response_complete):
            self.transport.abort()
            return
        if cycle is not None:  # a request before it has no answer yet
            cycle.disconnected = True
            cycle.message_event.set()
        self.transport.write(last_answer(error))
        self.transport.write_eof()
        self.loop.call_later(LAST_S, self.transport.abort)

    def _read_no_more(self) -> None:
        """The request was answered: whoever sends on may read that, and is waited for no longer than at any end."""
        if self._ended:
            return
        self._ended = True
        self.transport.pause_reading()
        self.transport.write_eof()
        self._unsent = self._left
        self.deadlines = Deadlines(self.settings)
        self.deadlines.begin("answer" if self._unsent else "close")

    def on_url(self, url: bytes) -> None:
        """A part of the address."""
        super().on_url(url)
        if len(self.url) > MAX_HEAD:
            self._wrong = LONG_ADDRESS
            raise ValueError(LONG_ADDRESS.detail)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header is there."""
        self._head += len(name) + len(value) + 4
        if self._head > MAX_HEAD:
            self._wrong = LARGE_HEAD
            raise ValueError(LARGE_HEAD.detail)
        super().on_header(name, value)

    def on_message_begin(self) -> None:
        """A request begins."""
        super().on_message_begin()
        self._head = self._head_came = 0
        self._in_head = True
        self.deadlines.end("idle")
        self.deadlines.begin("header")

    def on_headers_complete(self) -> None:
        """Its headers are there."""
        self._in_head = False
        self.deadlines.end("header")
        self.deadlines.begin("body")
        self._body = self._dropped = 0
        self.visits.works(self)
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """A part of its body is there."""
        super().on_body(body)
        if self.cycle is not None and self.cycle.response_complete:
            self._dropped += len(body)
            if self._dropped > MAX_DROPPED:
                self._read_no_more()
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
        if reason in ("header", "body"):
            self._end(LATE)
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
