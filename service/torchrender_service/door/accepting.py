"""Listening sockets that turn connections away at once where one address opens too many a second.

A connection that becomes a transport and a protocol costs the server a tenth of a millisecond, one that is turned away
here a hundredth: who opens thousands a second takes nothing from the others. Some hundred a second are told why, with
429; the rest are reset, and where the system can do it their address is shut out for a while, see :mod:`gate`.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time
from collections.abc import Callable
from typing import Any

from torchrender_service.door.address import peer_of
from torchrender_service.door.gate import Gate
from torchrender_service.errors import ServiceError
from torchrender_service.problems import last_answer
from torchrender_service.settings import Settings

BURST_S = 2.0
"""So many seconds' connections may come together."""
TURN_S, AT_ONCE = 0.0005, 4
"""For new connections, and so many that are let in, before whoever is connected has a turn: a thousand that come
together wait for each other, and no keyframe for all of them. Each is a task, a transport and a protocol to be made,
and a keyframe has a handful of turns on its way."""
MOST_ADDRESSES = 4096
TOLD_PER_S = 100
"""Answers to those that are turned away, of all addresses: each leaves the system something to wait for."""
BUSY = last_answer(ServiceError(429, "connections-a-second", "too many new connections a second", retry_after_s=1.0))
_AT_ONCE = struct.pack("ii", 1, 0)  # SO_LINGER: reset, nothing is left to wait for


class Arrivals:
    """How many connections each address may open now: a bucket that fills by so many a second.

    Args:
        refused: told of every connection that is not let in.
        gate: where those wait that open far too many.
    """

    def __init__(self, settings: Settings, refused: Callable[[], Any] = lambda: None, gate: Gate | None = None) -> None:
        self._rate = float(settings.connections_per_s)
        self._trusted = frozenset(settings.trusted_proxies)
        self._refused = refused
        self.gate = gate or Gate()
        self._left: dict[str, tuple[float, float]] = {}  # by address: how many, and when
        self._told, self._second = 0, 0  # answers in a second, and which

    def let_in(self, address: str, now: float) -> bool:
        """Count a connection."""
        if address in self._trusted:
            return True
        most = self._rate * BURST_S
        left, since = self._left.get(address, (most, now))
        left = min(most, left + (now - since) * self._rate)
        if left < 1.0:
            self._left[address] = (left, now)
            self._refused()
            return False
        if len(self._left) >= MOST_ADDRESSES and address not in self._left:
            self._forget(now)
        self._left[address] = (left - 1.0, now)
        return True

    def tells(self, now: float) -> bool:
        """Whether one more is told why it is turned away, in this second."""
        if int(now) != self._second:
            self._told, self._second = 0, int(now)
        self._told += 1
        return self._told <= TOLD_PER_S

    def _forget(self, now: float) -> None:
        """Drop the addresses whose bucket is full again; all, where none is."""
        self._left = {a: (n, t) for a, (n, t) in self._left.items() if now - t < BURST_S}
        if len(self._left) >= MOST_ADDRESSES:
            self._left.clear()


class DoorSocket(socket.socket):
    """A listening socket that hands on only who is let in."""

    arrivals: Arrivals | None = None
    _turn = 0.0  # when it began; 0: none is under way
    _handed = 0  # connections in this turn

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection that is let in.

        Raises:
            BlockingIOError: there is none now, or others have a turn first.
        """
        if not self._turn:
            self._handed = 0
        begin = self._turn or time.monotonic()
        self._turn = 0.0  # over, unless a connection is handed on
        while self._handed < AT_ONCE and (now := time.monotonic()) - begin < TURN_S:
            connection, peer = super().accept()
            if self.arrivals is None or self.arrivals.let_in(peer_of(peer), now):
                self._turn, self._handed = begin, self._handed + 1
                return connection, peer
            with connection, contextlib.suppress(OSError):
                if self.arrivals.tells(now):
                    _tell(connection)
                else:
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
                    self.arrivals.gate.shut(peer_of(peer), now)
        raise BlockingIOError


def _tell(connection: socket.socket) -> None:
    """Say why, without waiting; what was asked is read if it is there, else the system would reset the connection."""
    connection.setblocking(False)
    connection.send(BUSY)
    connection.recv(65536)


def listening(host: str, port: int, arrivals: Arrivals) -> list[socket.socket]:
    """Bound sockets for every address of ``host``.

    Raises:
        OSError: an address cannot be used.
    """
    made: list[socket.socket] = []
    try:
        for family, kind, protocol, _, address in socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        ):
            one = DoorSocket(family, kind, protocol)
            made.append(one)
            one.arrivals = arrivals
            arrivals.gate.add(one)
            if sys.platform != "win32":
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            one.setblocking(False)
            one.bind(address)
    except OSError:
        for opened in made:
            opened.close()
        raise
    return made
