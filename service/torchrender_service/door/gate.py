"""Addresses whose new connections wait outside: the system drops what begins them, before it is any work here.

A filter of the listening socket (Linux: ``SO_ATTACH_FILTER``, classic BPF) looks at the source of each packet. Who is
shut out gets no answer; the system of a peer asks again by itself, after a second at first. So a peer that has only
been too quick is let in somewhat later, and one that opens thousands a second costs nothing.
"""

from __future__ import annotations

import ctypes
import logging
import socket
import struct
import sys
from collections.abc import Callable
from typing import Any

LOG = logging.getLogger("torchrender_service.door.gate")
SHUT_S, LONGEST_S = 1.0, 8.0
"""For an address that opens too many connections; twice as long each time it goes on."""
FORGET_S = 10.0
"""After so long an address counts as a new one."""
MOST_SHUT = 32
"""Addresses at a time; others are turned away one by one."""
_ATTACH, _DETACH = 26, 27  # of SOL_SOCKET
_SOURCE = {socket.AF_INET: (12, 4), socket.AF_INET6: (8, 16)}  # place and bytes in the header of IP
_NET = 0xFFF00000  # offsets from here on count from that header
_LOAD, _EQUAL, _RETURN = 0x20, 0x15, 0x06


class Gate:
    """Who is shut out of some listening sockets, and until when.

    Args:
        told: called with an address and seconds whenever one is shut out.
    """

    def __init__(self, told: Callable[[str, float], Any] = lambda *_: None) -> None:
        self._told = told
        self._doors: list[socket.socket] = []
        self._until: dict[str, float] = {}
        self._last: dict[str, tuple[float, float]] = {}  # seconds that each was shut out for last, and the end of it
        self._works = sys.platform == "linux"

    def add(self, door: socket.socket) -> None:
        """A listening socket, of IPv4 or IPv6 alone."""
        self._doors.append(door)

    def shut(self, address: str, now: float) -> None:
        """Let new connections of an address wait for a while; where the system cannot, nothing happens."""
        if not self._works or address in self._until or len(self._until) >= MOST_SHUT:
            return
        before, end = self._last.get(address, (0.0, 0.0))
        seconds = min(LONGEST_S, 2.0 * before) if before and now - end < FORGET_S else SHUT_S
        self._until[address] = now + seconds
        self._last = {a: (s, e) for a, (s, e) in self._last.items() if now - e < FORGET_S}
        self._last[address] = seconds, now + seconds
        self._renew()
        self._told(address, seconds)

    def open(self, now: float) -> None:
        """Let those in whose time is over."""
        over = [address for address, until in self._until.items() if now >= until]
        for address in over:
            del self._until[address]
        if over:
            self._renew()

    def _renew(self) -> None:
        self._doors = [door for door in self._doors if door.fileno() >= 0]
        for door in self._doors:
            own = [packed for packed in (_packed(door.family, a) for a in self._until) if packed is not None]
            try:
                if own:
                    _attach(door, own)
                else:
                    door.setsockopt(socket.SOL_SOCKET, _DETACH, 0)
            except FileNotFoundError:  # it has no filter
                continue
            except OSError as error:
                LOG.warning("the system filters no connections: %s", error)
                self._works = False
                self._until.clear()
                return


def _packed(family: int, address: str) -> bytes | None:
    """The bytes of an address as packets have them; None where it is of another family."""
    try:
        return socket.inet_pton(family, address.partition("%")[0])
    except (OSError, ValueError):
        return None


def _attach(door: socket.socket, addresses: list[bytes]) -> None:
    """Drop all packets of these sources."""
    program = ctypes.create_string_buffer(program_of(door.family, addresses))
    told = struct.pack("HP", (len(program) - 1) // 8, ctypes.addressof(program))
    door.setsockopt(socket.SOL_SOCKET, _ATTACH, told)


def program_of(family: int, addresses: list[bytes]) -> bytes:
    """Instructions, of eight bytes each: compare the source word by word with each address."""
    place, size = _SOURCE[socket.AddressFamily(family)]
    steps: list[tuple[int, int, int, int]] = []  # what, steps to skip where it holds and where not, number
    for address in addresses:
        for word in range(0, size, 4):
            left = 2 * (size - word) // 4 - 1  # until this address is done, its verdict included
            steps += [(_LOAD, 0, 0, _NET + place + word)]
            steps += [(_EQUAL, 0, left, int.from_bytes(address[word : word + 4], "big"))]
        steps += [(_RETURN, 0, 0, 0)]
    steps += [(_RETURN, 0, 0, 0xFFFFFFFF)]
    return b"".join(struct.pack("=HBBI", *step) for step in steps)
