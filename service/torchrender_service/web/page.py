"""The files of the page: compressed once, and not sent again where a browser has them."""

from __future__ import annotations

import asyncio
import gzip
import os
from typing import Any

import zstandard
from starlette.datastructures import Headers
from starlette.responses import RedirectResponse, Response
from starlette.routing import Match, Mount
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Scope

COMPRESSED = (".html", ".js", ".mjs", ".css", ".svg", ".md", ".json")
CODINGS = ("zstd", "gzip")
"""The first one that a browser takes is used."""
LEVEL = {"zstd": 19, "gzip": 9}


def _compress(data: bytes, coding: str) -> bytes:
    if coding == "zstd":
        # Browsers refuse windows of more than 8 MB.
        return zstandard.ZstdCompressor(level=LEVEL[coding]).compress(data)
    return gzip.compress(data, LEVEL[coding], mtime=0)


def coding_of(accepted: str) -> str | None:
    """The content coding that a browser takes (RFC 9110, section 12.5.3); None: as it is."""
    words = [word.strip().lower().partition(";") for word in accepted.split(",")]
    taken = {name.strip() for name, _, rest in words if rest.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00")}
    return next((coding for coding in CODINGS if coding in taken), None)


class PageMount(Mount):
    """The page at every path but those of the interface: there a wrong method is told as such (405)."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Whether a file could be meant."""
        if scope["path"].removeprefix(scope.get("root_path", "")).startswith("/v1/"):
            return Match.NONE, {}
        return super().matches(scope)


class PageFiles(StaticFiles):
    """Static files, compressed where that helps.

    Args:
        start: scene that an address without words leads to; empty: the page's own choice.
    """

    def __init__(self, *, start: str = "", **rest: Any) -> None:
        super().__init__(**rest)
        self._start = start
        self._made: dict[tuple[str, str, float], bytes] = {}

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The file; every answer is asked for again each time, and not sent again while it is the same."""
        if self._start and path in (".", "index.html") and not scope.get("query_string"):
            return RedirectResponse(f"?scene={self._start}", headers={"Cache-Control": "no-cache"})
        response = await super().get_response(path, scope)
        response.headers["Cache-Control"] = "no-cache"
        name = getattr(response, "path", None)
        if name is None or response.status_code != 200 or not str(name).endswith(COMPRESSED):
            return response
        response.headers.append("Vary", "Accept-Encoding")
        headers = Headers(scope=scope)
        coding = coding_of(headers.get("accept-encoding", ""))
        if coding is None:
            return response
        data = await self._file(str(name), coding)
        kept = {k: v for k, v in response.headers.items() if k not in ("content-length", "accept-ranges", "etag")}
        kept |= {"Content-Encoding": coding, "ETag": f'W/"{response.headers["etag"].strip(chr(34))}-{coding}"'}
        if headers.get("if-none-match") == kept["ETag"]:
            return NotModifiedResponse(Headers(kept))
        return Response(data, headers=kept)

    async def _file(self, name: str, coding: str) -> bytes:
        key = name, coding, os.stat(name).st_mtime
        if key not in self._made:
            with open(name, "rb") as file:
                data = file.read()
            self._made[key] = await asyncio.to_thread(_compress, data, coding)
        return self._made[key]
