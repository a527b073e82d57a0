"""Checks before any work is done: how much, host, origin, API key, size of the body; and what is noted of requests."""

from __future__ import annotations

import asyncio
import hmac
import logging
import re
import secrets
import time
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from typing import Any

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from torchrender_service.door.address import UNKNOWN, client_of
from torchrender_service.door.bodies import Bodies
from torchrender_service.door.policy import security_headers
from torchrender_service.door.rates import Quota, Rates
from torchrender_service.door.traces import span
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.problems import problem_response
from torchrender_service.settings import LOOPBACK_NAMES, Settings

LOG = logging.getLogger("torchrender_service.door.guard")
SAFE = ("GET", "HEAD", "OPTIONS")
ALWAYS = ("/health", "/ready", "/metrics")
"""Answered however much else there is to do."""
PIECE = 2**18
"""Bytes of an answer that are handed on at a time: the rest waits until the peer has taken them."""
_ID = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(eq=False, kw_only=True)
class Visit:
    """What is known about a request, for its log line."""

    client: str = UNKNOWN
    id: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


def visit_of(scope: Scope) -> Visit:
    """What the guard noted about a request; an empty one where there was no guard."""
    found = scope.get("torchrender.visit")
    return found if isinstance(found, Visit) else Visit()


class Guard:
    """ASGI middleware around the whole application."""

    def __init__(self, app: ASGIApp, settings: Settings, metrics: Metrics, bodies: Bodies) -> None:
        self._app = app
        self._settings = settings
        self._metrics = metrics
        self._bodies = bodies
        self._rates = Rates(settings)
        self._requests = Quota("requests", settings.max_requests, settings.max_requests_per_address)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        self._arrive(scope)
        if scope["type"] == "websocket":
            await self._stream(scope, receive, send)
            return
        begin, status, visit = time.monotonic(), 500, visit_of(scope)
        started = False
        added = [*security_headers(scope, self._settings.frame_ancestors), (b"x-request-id", visit.id.encode())]

        async def noting(message: Message) -> None:
            nonlocal status, started
            if message["type"] == "http.response.start":
                started, status = True, message["status"]
                message["headers"] = [*message.get("headers", []), *added]
            await _send_in_pieces(message, send)

        try:
            with self._admitted(scope), span(_method(scope), {"request": visit.id, "path": scope["path"][:200]}):
                await self._app(scope, self._limited(scope, receive), noting)
        except asyncio.CancelledError:
            if not self._bodies.stopping or started:
                raise
            await problem_response(stopping())(scope, receive, noting)
        except ServiceError as error:
            self._metrics.count("rejected", kind=error.kind)
            await problem_response(error)(scope, receive, noting)
        finally:
            self._note(scope, status, time.monotonic() - begin)

    async def _stream(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Tickets are looked at by the route; here only how often somebody tries."""
        try:
            self._rates.check(visit_of(scope).client)
        except ServiceError as error:
            self._metrics.count("rejected", kind=error.kind)
            await WebSocket(scope, receive, send).send_denial_response(problem_response(error))
            return
        await self._app(scope, receive, send)

    def _arrive(self, scope: Scope) -> None:
        """Take the prefix of a proxy off the path, and note who asks."""
        root = self._settings.root_path
        if root and (scope["path"] == root or scope["path"].startswith(root + "/")):
            scope["path"] = scope["path"][len(root) :] or "/"
            scope["raw_path"] = scope["path"].encode("utf-8", "replace")
        given = Headers(scope=scope).get("x-request-id", "")
        name = given if _ID.fullmatch(given) else secrets.token_hex(8)
        scope["torchrender.visit"] = Visit(client=client_of(scope, self._settings.trusted_proxies), id=name)

    @contextmanager
    def _admitted(self, scope: Scope) -> Iterator[None]:
        """Let a request in that may come now."""
        client = visit_of(scope).client
        self._rates.check(client)
        self._check(scope)
        if scope["path"] in ALWAYS:
            yield
            return
        if self._bodies.stopping:
            raise stopping()
        large = self._bodies.uploads.take(client) if self._bodies.is_large(scope) else nullcontext()
        with self._requests.take(client), large:
            yield

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route, visit = getattr(scope.get("route"), "path", "other"), visit_of(scope)
        self._metrics.count("requests", method=_method(scope), route=route, status=str(status))
        self._metrics.observe("request_seconds", seconds, route=route)
        level = logging.DEBUG if route in ALWAYS else logging.INFO
        facts = {"method": _method(scope), "route": route, "status": status, "ms": round(1e3 * seconds, 1)}
        LOG.log(level, "request", extra={"request": visit.id, "client": visit.client, **facts, **visit.facts})

    def _check(self, scope: Scope) -> None:
        headers = Headers(scope=scope)
        check_host(headers, self._settings)
        api = scope["path"].startswith("/v1/")
        if scope["method"] not in SAFE or (api and scope["path"] != "/v1/openapi.json"):
            check_origin(headers, self._settings)
        if api or scope["path"] == "/metrics":
            check_key(headers, self._settings)
        coding = headers.get("content-encoding", "").strip().lower()
        if coding not in ("", "identity"):
            raise ServiceError(415, "content-encoding", f"bodies must come as they are, not with {coding[:40]!r}")
        length = headers.get("content-length")
        limit = self._bodies.of(scope)
        if length is not None and length.isdecimal() and int(length[:20]) > limit:
            raise ServiceError(413, "body-too-large", f"the body may have at most {limit} bytes, it has {length[:20]}")

    def _limited(self, scope: Scope, receive: Receive) -> Receive:
        """Bodies of unknown length are counted while they come."""
        limit, size = self._bodies.of(scope), 0

        async def counting() -> Message:
            nonlocal size
            message: MutableMapping[str, Any] = await receive()
            if message["type"] == "http.request":
                size += len(message.get("body", b""))
                if size > limit:
                    # The framework turns other errors into 400.
                    raise HTTPException(413, f"the body may have at most {limit} bytes")
            return message

        return counting


async def _send_in_pieces(message: Message, send: Send) -> None:
    """Hand a large answer on as fast as the peer takes it, not all at once."""
    body = message.get("body", b"") if message["type"] == "http.response.body" else b""
    if len(body) <= PIECE:
        await send(message)
        return
    view, more = memoryview(body), message.get("more_body", False)
    for begin in range(0, len(view), PIECE):
        last = begin + PIECE >= len(view)
        await send({**message, "body": bytes(view[begin : begin + PIECE]), "more_body": more or not last})


def stopping() -> ServiceError:
    """What whoever asks is told once the server begins nothing new."""
    return ServiceError(503, "stopping", "the server is stopping", retry_after_s=5.0)


def check_host(headers: Headers, settings: Settings) -> None:
    """Refuse names of other sites: a page there could otherwise reach a service on loopback (DNS rebinding).

    Raises:
        ServiceError: 421.
    """
    name = _host_name(headers.get("host", ""))
    known = {*settings.allowed_hosts, *LOOPBACK_NAMES, settings.host}
    if name not in known and (settings.loopback or settings.allowed_hosts):
        raise ServiceError(421, "host", "the Host header does not name this service")


def check_origin(headers: Headers, settings: Settings) -> None:
    """Refuse requests that pages of other sites make; programs send no Origin.

    Raises:
        ServiceError: 403.
    """
    origin = headers.get("origin")
    if origin is None:
        # Pictures, scripts and the like of other pages come without an Origin; browsers say so in their own words.
        if headers.get("sec-fetch-site", "").lower() not in ("cross-site", "same-site"):
            return
    elif origin in settings.allowed_origins:
        return
    host = headers.get("host", "")
    if origin not in (f"http://{host}", f"https://{host}"):
        raise ServiceError(403, "origin", "requests from pages of other sites are not allowed")


def check_key(headers: Headers, settings: Settings) -> None:
    """Compare the API key where one is set.

    Raises:
        ServiceError: 401.
    """
    if settings.api_key is None:
        return
    scheme, _, given = headers.get("authorization", "").partition(" ")
    if scheme.lower() != "bearer" or not hmac.compare_digest(given.strip().encode(), settings.api_key.encode()):
        raise ServiceError(401, "api-key", "send the API key: Authorization: Bearer KEY")


def _host_name(host: str) -> str:
    """Without the port; brackets of IPv6 addresses stay."""
    if host.startswith("["):
        return host.partition("]")[0] + "]"
    return host.partition(":")[0].lower()


def _method(scope: Scope) -> str:
    """Clients may send any word: only known ones become labels."""
    method = scope["method"]
    return method if method in (*SAFE, "POST", "PUT", "PATCH", "DELETE") else "OTHER"
