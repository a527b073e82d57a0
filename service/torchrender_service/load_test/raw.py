"""Requests as attackers send them: from an address of their own, byte by byte."""

from __future__ import annotations

import asyncio
import http.client
import json
import sys
from types import TracebackType
from typing import Any

from torchrender_service.load_test.driver import ServerUnderTest


def attacker(number: int) -> str:
    """An address on loopback for each attack, as limits count by address; systems but Linux have one only."""
    return f"127.0.0.{2 + number}" if sys.platform == "linux" else "127.0.0.1"


def post_head(path: str, length: int, kind: str = "application/json") -> bytes:
    """The head of a request."""
    head = f"POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: {kind}\r\ncontent-length: {length}\r\n\r\n"
    return head.encode()


def ask(
    server: ServerUnderTest,
    method: str,
    path: str,
    body: Any = None,
    kind: str = "application/json",
    source: str | None = None,
) -> tuple[int, bytes]:
    """Status and body of an answer; status 0 where there is none. GET comes from honest clients."""
    source = source or ("127.0.0.1" if method == "GET" else server.attacker)
    data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    connection = http.client.HTTPConnection(server.host, server.port, timeout=120.0, source_address=(source, 0))
    try:
        connection.request(method, path, data, {"Content-Type": kind} if data is not None else {})
        answer = connection.getresponse()
        return answer.status, answer.read()
    except (OSError, http.client.HTTPException):
        return 0, b""
    finally:
        connection.close()


class Raw:
    """A bare connection from the attacker's address."""

    def __init__(self, server: ServerUnderTest) -> None:
        self._server = server

    async def __aenter__(self) -> Raw:
        self._reader, self._writer = await asyncio.open_connection(
            self._server.host, self._server.port, local_addr=(self._server.attacker, 0)
        )
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self._writer.transport.abort()

    async def send(self, data: bytes | memoryview) -> None:
        """Send, as fast as the server takes it."""
        self._writer.write(data)
        await self._writer.drain()

    async def until_ended(self) -> None:
        """Until the server closes."""
        while await self._reader.read(4096):
            pass

    async def status(self) -> int:
        """Status of the answer; 0 where the connection ended without one."""
        try:
            line = await asyncio.wait_for(self._reader.readline(), 60.0)
        except (OSError, asyncio.TimeoutError, asyncio.IncompleteReadError):
            return 0
        words = line.split()
        return int(words[1]) if len(words) > 1 and words[1].isdigit() else 0
