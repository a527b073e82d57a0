"""Checks before any work is done: host, origin, API key, size of the body; and what is noted about every request."""

from __future__ import annotations

import hmac
import logging
import time
from collections.abc import MutableMapping
from typing import Any

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.problems import problem_response
from torchrender_service.settings import LOOPBACK_NAMES, Settings

LOG = logging.getLogger("torchrender_service.web.guard")
SAFE = ("GET", "HEAD", "OPTIONS")
_SECURITY = ((b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer"))


class Guard:
    """ASGI middleware around the whole application."""

    def __init__(self, app: ASGIApp, settings: Settings, metrics: Metrics) -> None:
        self._app = app
        self._settings = settings
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begin, status = time.monotonic(), 500

        async def noting(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message.get("headers", []), *_SECURITY]
            await send(message)

        try:
            self._check(scope)
            await self._app(scope, self._limited(scope, receive), noting)
        except ServiceError as error:
            self._metrics.count("rejected", kind=error.kind)
            await problem_response(error)(scope, receive, noting)
        finally:
            self._note(scope, status, time.monotonic() - begin)

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route = getattr(scope.get("route"), "path", "other")
        self._metrics.count("requests", method=_method(scope), route=route, status=str(status))
        self._metrics.observe("request_seconds", seconds, route=route)
        level = logging.DEBUG if route in ("/health", "/ready", "/metrics") else logging.INFO
        facts = {"method": _method(scope), "route": route, "status": status, "ms": round(1e3 * seconds, 1)}
        LOG.log(level, "request", extra=facts)

    def _check(self, scope: Scope) -> None:
        headers = Headers(scope=scope)
        check_host(headers, self._settings)
        if scope["method"] not in SAFE:
            check_origin(headers, self._settings)
        if scope["path"].startswith("/v1/") or scope["path"] == "/metrics":
            check_key(headers, self._settings)
        length = headers.get("content-length")
        limit = self._limit(scope)
        if length is not None and length.isdecimal() and int(length[:20]) > limit:
            raise ServiceError(413, "body-too-large", f"the body may have at most {limit} bytes, it has {length[:20]}")

    def _limit(self, scope: Scope) -> int:
        path = scope["path"]
        if path in ("/v1/scenes", "/v1/style", "/v1/photos"):
            return self._settings.max_upload_bytes
        if path == "/v1/fog":
            return self._settings.max_upload_bytes * 4 // 3 + 2**20
        # The container travels as base64 within JSON.
        return (
            self._settings.max_container_bytes * 4 // 3 + 2**16
            if path == "/v1/reproject"
            else self._settings.max_body_bytes
        )

    def _limited(self, scope: Scope, receive: Receive) -> Receive:
        """Bodies of unknown length are counted while they come."""
        limit, size = self._limit(scope), 0

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
    if origin is None or origin in settings.allowed_origins:
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
