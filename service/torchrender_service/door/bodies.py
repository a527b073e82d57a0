"""How large the body of a request may be, and how much of all large ones may be under way and in memory at a time."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from starlette.requests import Request
from starlette.types import Scope

from torchrender_service.door.rates import Quota
from torchrender_service.errors import ServiceError
from torchrender_service.settings import Settings

LARGE = ("/v1/scenes", "/v1/style", "/v1/photos", "/v1/keyframes", "/v1/fog", "/v1/reproject")
JSON_BYTES = 2**22
"""Of bodies that carry a file as base64 within JSON: parsing them holds everybody up for a few milliseconds."""
RETRY_S = 2.0


class Bodies:
    """Limits of all bodies of the service."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.uploads = Quota("uploads", settings.max_uploads, settings.max_uploads_per_address)
        self.stopping = False
        self._buffered = 0

    def of(self, scope: Scope) -> int:
        """Bytes that the body may have."""
        path, settings = scope["path"], self._settings
        if path in ("/v1/scenes", "/v1/style", "/v1/photos"):
            return settings.max_upload_bytes
        if path == "/v1/keyframes":
            return settings.max_container_bytes
        if path in ("/v1/reproject", "/v1/fog"):
            whole = settings.max_container_bytes if path == "/v1/reproject" else settings.max_upload_bytes
            return max(settings.max_body_bytes, min(JSON_BYTES, whole * 4 // 3 + 2**16))
        return settings.max_body_bytes

    def is_large(self, scope: Scope) -> bool:
        """Only so many of these at a time."""
        return scope["method"] == "POST" and scope["path"] in LARGE

    @asynccontextmanager
    async def read(self, request: Request) -> AsyncIterator[bytes]:
        """The whole body, whose room in memory is taken until the end of the block.

        Raises:
            ServiceError: 503, there is no room now.
        """
        parts: list[bytes] = []
        size = 0
        try:
            async for part in request.stream():
                if self._buffered + len(part) > self._settings.max_buffered_bytes:
                    detail = "too many large bodies are in memory already"
                    raise ServiceError(503, "busy", detail, retry_after_s=RETRY_S)
                parts.append(part)
                size += len(part)
                self._buffered += len(part)
            whole = b"".join(parts)
            parts.clear()
            yield whole
        finally:
            self._buffered -= size
