"""Addresses that are shut out of a listening socket, by the system itself."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys

import pytest

from torchrender_service.door import accepting
from torchrender_service.door.accepting import Arrivals, listening
from torchrender_service.door.connections import Connections
from torchrender_service.door.gate import FORGET_S, LONGEST_S, MOST_SHUT, SHUT_S, Gate, program_of
from torchrender_service.metrics import Metrics
from torchrender_service.settings import Settings

OTHER, HONEST = "127.0.0.9", "127.0.0.1"
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such filter")


def gets_in(door: socket.socket, source: str) -> bool:
    """Whether a connection from an address is made at once."""
    with socket.socket(door.family) as one:
        one.bind((source, 0))
        one.settimeout(0.2)
        try:
            one.connect(door.getsockname())
        except TimeoutError:
            return False
        return True


@needs_linux
def test_who_is_shut_out_waits_and_others_do_not() -> None:
    arrivals = Arrivals(Settings())
    (door,) = listening(HONEST, 0, arrivals)
    with door:
        door.listen(16)
        assert gets_in(door, OTHER)
        arrivals.gate.shut(OTHER, 50.0)
        assert not gets_in(door, OTHER) and gets_in(door, HONEST)
        arrivals.gate.open(50.0 + 0.9 * SHUT_S)
        assert not gets_in(door, OTHER)
        arrivals.gate.open(50.0 + SHUT_S)
        assert gets_in(door, OTHER)


@needs_linux
def test_a_connection_that_is_made_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accepting, "TOLD_PER_S", 0)
    arrivals = Arrivals(Settings(connections_per_s=1))
    (door,) = listening(HONEST, 0, arrivals)
    with door:
        door.listen(16)
        first = socket.create_connection(door.getsockname(), source_address=(OTHER, 0))
        taken, _ = door.accept()
        more = [socket.create_connection(door.getsockname(), source_address=(OTHER, 0)) for _ in range(3)]
        for _ in range(8):  # a turn is short
            with contextlib.suppress(BlockingIOError):
                door.accept()[0].close()
        assert not gets_in(door, OTHER), "who opens too many is shut out"
        first.sendall(b"still here")
        taken.settimeout(2.0)
        assert taken.recv(100) == b"still here"
        for one in (first, taken, *more):
            one.close()


def test_who_goes_on_waits_longer_and_is_forgotten_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    told: list[float] = []
    gate, now = Gate(lambda _, seconds: told.append(seconds)), 100.0
    for _ in range(6):
        gate.shut(OTHER, now)
        gate.shut(OTHER, now)  # nothing new
        now += told[-1]
        gate.open(now)
    assert told == [SHUT_S, 2 * SHUT_S, 4 * SHUT_S, LONGEST_S, LONGEST_S, LONGEST_S]
    gate.shut(OTHER, now + FORGET_S)
    assert told[-1] == SHUT_S
    for k in range(2 * MOST_SHUT):
        gate.shut(f"192.0.2.{k}", now)
    assert len(gate._until) == MOST_SHUT, "a filter has room for so many"


def test_who_is_shut_out_is_counted() -> None:
    metrics = Metrics()
    connections = Connections(Settings(), metrics)
    connections._shut_out(OTHER, 1.0)
    assert "torchrender_addresses_shut_out_total 1" in metrics.text({})


def run(program: bytes, header: bytes) -> int:
    """The verdict of the instructions on a packet with this header: the system's interpreter in a few lines."""
    steps = [struct.unpack("=HBBI", program[k : k + 8]) for k in range(0, len(program), 8)]
    at, found = 0, 0
    while True:
        what, yes, no, number = steps[at]
        at += 1
        if what == 0x20:
            found = int.from_bytes(header[number - 0xFFF00000 :][:4], "big")
        elif what == 0x15:
            at += yes if found == number else no
        else:
            return int(number)


@pytest.mark.parametrize(
    ("family", "place", "addresses"),
    [
        (socket.AF_INET, 12, ("192.0.2.1", "192.0.2.7", "198.51.100.1", "193.0.2.1")),
        (socket.AF_INET6, 8, ("2001:db8::1", "2001:db8::2", "2001:db8:1::1", "::1")),
    ],
)
def test_the_filter_drops_these_sources_alone(family: int, place: int, addresses: tuple[str, ...]) -> None:
    packed = [socket.inet_pton(family, one) for one in addresses]
    program = program_of(family, packed[:2])
    verdicts = [run(program, bytes(place) + one + bytes(16)) for one in packed]
    assert verdicts == [0, 0, 0xFFFFFFFF, 0xFFFFFFFF]


@needs_linux
def test_addresses_of_ipv6_are_shut_out_too() -> None:
    arrivals = Arrivals(Settings())
    try:
        (door,) = listening("::1", 0, arrivals)
    except OSError:
        pytest.skip("no IPv6 here")
    with door:
        door.listen(16)
        assert gets_in(door, "::1")
        arrivals.gate.shut("::1", 50.0)
        arrivals.gate.shut(OTHER, 50.0)  # has no meaning here
        assert not gets_in(door, "::1")
