"""The stream of a real server over real sockets: what goes well, and everything a client may do wrong."""

from __future__ import annotations

import base64
import contextlib
import os
import random
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from websockets.client import ClientProtocol
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

from service_server import RunningServer
from torchrender.wire.messages import (
    SUBPROTOCOL,
    Ack,
    Bye,
    CameraHeader,
    Hello,
    Keyframe,
    Message,
    Pose,
    Problem,
    Resync,
    Settings,
    Welcome,
    decode,
    encode,
)

BOX = b'name = "box"\n[[geometry]]\nshape = "box"\nsize = 1.0\n'
HELLO = encode(Hello(versions=(1, 1), color=("jpeg", "webp")))


@contextlib.contextmanager
def open_stream(server: RunningServer, ticket: str | None, **rest: Any) -> Iterator[ClientConnection]:
    protocols = [SUBPROTOCOL] + ([] if ticket is None else [f"bearer.{ticket}"])
    url = f"ws://{server.address}/v1/stream"
    with connect(url, subprotocols=protocols, compression=None, max_size=2**24, **rest) as ws:  # type: ignore[arg-type]
        yield ws


@contextlib.contextmanager
def stream(server: RunningServer, **wishes: Any) -> Iterator[tuple[ClientConnection, Welcome]]:
    """A stream after HELLO and WELCOME; ends its session."""
    with open_stream(server, server.session(**wishes)["ticket"]) as ws:
        ws.send(HELLO)
        welcome = decode(ws.recv(20)).message
        assert isinstance(welcome, Welcome)
        yield ws, welcome
        with contextlib.suppress(ConnectionClosed):
            ws.send(encode(Bye(reason="done")))


def pose(camera: CameraHeader, seq: int = 1, x: float = 0.0, **rest: Any) -> bytes:
    matrix = list(camera.world_from_camera)
    matrix[3] += x
    moved = msgspec.structs.replace(camera, world_from_camera=tuple(matrix))
    return encode(Pose(seq=seq, time_ms=5.0, camera=moved, **{"moving": False, **rest}))


def receive(ws: ClientConnection, timeout: float = 30.0) -> Message:
    data = ws.recv(timeout)
    assert isinstance(data, bytes)
    return decode(data).message


def receive_keyframe(ws: ClientConnection, *, ack: bool = True) -> Keyframe:
    message = receive(ws)
    assert isinstance(message, Keyframe), message
    if ack and message.layer == 0:
        ws.send(encode(Ack(id=message.id)))
    return message


def receive_pose(ws: ClientConnection, seq: int) -> Keyframe:
    """The first keyframe of a pose; refinements of earlier ones may come before."""
    while (keyframe := receive_keyframe(ws)).pose < seq:
        pass
    assert keyframe.pose == seq and not keyframe.still
    return keyframe


def closed_with(ws: ClientConnection, timeout: float = 20.0) -> tuple[int, list[Message]]:
    """The close code, and what came before."""
    seen: list[Message] = []
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        try:
            data = ws.recv(max(0.1, end - time.monotonic()))
        except ConnectionClosed as error:
            return (error.rcvd.code if error.rcvd else 1006), seen
        assert isinstance(data, bytes)
        seen.append(decode(data).message)
    raise AssertionError("not closed in time")


# ---------------------------------------------------------------- going well


def test_a_keyframe_then_its_refinement(server: RunningServer) -> None:
    with stream(server, layers=1, overscan=1.25) as (ws, welcome):
        assert welcome.credits == 2 and welcome.scene["id"] == "cornell_box"
        assert ws.subprotocol == SUBPROTOCOL
        ws.send(pose(welcome.camera))
        first, extra = receive_keyframe(ws), receive_keyframe(ws)
        assert (first.layer, extra.layer, first.layers, first.id) == (0, 1, 2, extra.id)
        assert (first.pose, first.time_ms, first.still) == (1, 5.0, False)
        assert (first.camera.width, first.camera.height) == (80, 60)
        assert first.plan is not None and extra.plan is None
        assert first.mask is None and extra.mask is not None
        still, _ = receive_keyframe(ws), receive_keyframe(ws)
        assert still.still and still.color.codec == "webp" and still.samples == 1
        smooth, _ = receive_keyframe(ws), receive_keyframe(ws)
        assert smooth.still and smooth.samples == 5 and smooth.id == still.id + 1
        with pytest.raises(TimeoutError):
            ws.recv(0.7)


def test_moving_brings_new_keyframes_and_standing_none(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        ws.send(pose(welcome.camera, 1))
        receive_keyframe(ws)
        for seq in range(2, 6):
            ws.send(pose(welcome.camera, seq, 0.05 * seq, moving=True, velocity=(0.5, 0.0, 0.0)))
            keyframe = receive_pose(ws, seq)
            assert keyframe.camera.world_from_camera[3] != welcome.camera.world_from_camera[3]


def test_settings_bring_a_fresh_keyframe(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        ws.send(pose(welcome.camera))
        assert receive_keyframe(ws).layers == 1
        while receive_keyframe(ws).samples == 1:
            pass
        ws.send(encode(Settings(budget_ms=500.0, layers=1)))
        fresh = receive_keyframe(ws)
        assert fresh.layers == 2 and fresh.plan is not None


def test_a_client_without_webp_gets_jpeg(server: RunningServer) -> None:
    with open_stream(server, server.session()["ticket"]) as ws:
        ws.send(encode(Hello(versions=(0, 3), color=("jpeg",), max_pixels=1000)))
        welcome = receive(ws)
        assert isinstance(welcome, Welcome)
        ws.send(pose(welcome.camera))
        keyframes = [receive_keyframe(ws), receive_keyframe(ws)]
        assert [k.still for k in keyframes] == [False, True]
        for keyframe in keyframes:
            assert keyframe.color.codec == "jpeg"
            assert keyframe.camera.width * keyframe.camera.height <= 1000
        ws.send(encode(Bye(reason="done")))
        assert closed_with(ws)[0] == 1000


def test_two_keyframes_on_the_way_and_a_resync(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        ws.send(pose(welcome.camera, 1))
        first = receive_keyframe(ws, ack=False)
        ws.send(pose(welcome.camera, 2, 0.2))
        second = receive_keyframe(ws, ack=False)
        ws.send(pose(welcome.camera, 3, 0.4))
        with pytest.raises(TimeoutError):
            ws.recv(0.4)
        ws.send(encode(Resync(last=first.id)))
        assert receive_pose(ws, 3).id > second.id
        ws.send(encode(Ack(id=second.id)))  # late: no longer counted
        ws.send(encode(Ack(id=12345)))
        ws.send(pose(welcome.camera, 4, 0.6))
        receive_pose(ws, 4)


def test_a_broken_connection_goes_on_with_its_resume_ticket(server: RunningServer) -> None:
    ticket = server.session(layers=1)["ticket"]
    for _ in range(3):
        with open_stream(server, ticket) as ws:
            ws.send(HELLO)
            welcome = receive(ws)
            assert isinstance(welcome, Welcome) and welcome.limits["layers"] == 1
            ws.send(pose(welcome.camera))
            assert receive_keyframe(ws).layer == 0
            ws.socket.shutdown(socket.SHUT_RDWR)
            ticket = welcome.resume
    with open_stream(server, ticket) as ws:
        ws.send(HELLO)
        receive(ws)
        ws.send(encode(Bye(reason="done")))
        assert closed_with(ws)[0] == 1000
    assert refused(server, ticket) == 403  # goodbye ends the session


# ------------------------------------------------------------- before accept


def refused(server: RunningServer, ticket: str | None, **rest: Any) -> int:
    with pytest.raises(InvalidStatus) as caught, open_stream(server, ticket, **rest):
        pass
    response = caught.value.response
    assert response.headers["content-type"] == "application/problem+json"
    return response.status_code


def test_tickets_and_origins_are_checked_before_accept(server: RunningServer) -> None:
    assert refused(server, None) == 401
    assert refused(server, "nonsense") == 403
    ticket = server.session()["ticket"]
    assert refused(server, ticket, origin="http://evil.example") == 403
    assert handshake(server, ticket, host="evil.example").startswith(b"HTTP/1.1 421")
    with open_stream(server, ticket, origin=server.url) as ws:  # what was refused did not use it up
        ws.send(HELLO)
        receive(ws)
        ws.send(encode(Bye(reason="done")))
    assert refused(server, ticket) == 403
    with pytest.raises(InvalidStatus) as caught, connect(f"ws://{server.address}/v1/stream", compression=None):
        pass
    assert caught.value.response.status_code == 400


def test_more_sessions_than_allowed(server: RunningServer) -> None:
    tickets, there = [], server.gauge("sessions")  # what earlier tests left, and what may end meanwhile
    while (
        answer := server.ask("POST", "/v1/sessions", {"scene": "cornell_box", "width": 32, "height": 24})
    ).status == 201:
        tickets.append(answer.json()["ticket"])
        assert len(tickets) <= 16
    assert len(tickets) >= 16 - there
    assert answer.status == 429 and int(answer.headers["retry-after"]) >= 1
    for ticket in tickets:
        with open_stream(server, ticket) as ws:
            ws.send(HELLO)
            receive(ws)
            ws.send(encode(Bye(reason="done")))
            closed_with(ws)
    with stream(server) as (_, welcome):  # there is room again
        assert welcome.credits == 2


def handshake(server: RunningServer, ticket: str, *, host: str = "", wait: bool = True) -> bytes:
    """The start of the answer to a hand-made handshake."""
    address, port = server.address.split(":")
    with socket.create_connection((address, int(port)), timeout=20) as plain:
        key = base64.b64encode(os.urandom(16)).decode()
        plain.sendall(
            f"GET /v1/stream HTTP/1.1\r\nHost: {host or server.address}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n"
            f"Sec-WebSocket-Protocol: {SUBPROTOCOL}, bearer.{ticket}\r\n\r\n".encode()
        )
        return plain.recv(100) if wait else b""


def test_hundreds_of_connects_a_second(server: RunningServer) -> None:
    for count in range(200):
        wait = count % 3 == 0  # some do not wait for the answer
        answer = handshake(server, "x", wait=wait)
        assert answer.startswith(b"HTTP/1.1 403") if wait else not answer
    assert server.ask("GET", "/health").status == 200
    assert not [line for line in server.log if '"error"' in line]


# ------------------------------------------------------------- going wrong


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (HELLO[:-1], 1002),
        (HELLO[:7], 1002),
        (b"", 1002),
        (random.Random(1).randbytes(500), 1002),
        (b"TRDI" + bytes([9]) + HELLO[5:], 1002),
        (encode(Hello(versions=(2, 9))), 1002),
        (encode(Hello(versions=(1, 1), depth=("png",))), 1002),
        (encode(Bye(reason="?")), 1002),
        (b"x" * 65_537, 1009),
    ],
)
def test_a_first_message_that_is_no_hello(server: RunningServer, data: bytes, code: int) -> None:
    with open_stream(server, server.session()["ticket"]) as ws:
        ws.send(data)
        found, seen = closed_with(ws)
        assert found == code
        if code == 1002:
            assert isinstance(seen[0], Problem) and isinstance(seen[-1], Bye)


def test_text_and_silence_instead_of_hello(server: RunningServer) -> None:
    with open_stream(server, server.session()["ticket"]) as ws:
        ws.send("hello")
        assert closed_with(ws)[0] == 1002
    with open_stream(server, server.session()["ticket"]) as ws:
        assert closed_with(ws)[0] == 1002


def test_bad_values_are_named_and_the_stream_goes_on(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        bad = msgspec.structs.replace(welcome.camera, world_from_camera=(2.0,) * 16)
        ws.send(encode(Pose(seq=1, time_ms=0.0, camera=bad)))
        problem = receive(ws)
        assert isinstance(problem, Problem) and problem.status == 422 and "world_from_camera" in problem.detail
        broken = bytearray(pose(welcome.camera, 2))
        at = broken.index(b"time_ms") + 8
        broken[at : at + 8] = b"\x7f\xf8" + bytes(6)  # NaN
        ws.send(bytes(broken))
        problem = receive(ws)
        assert isinstance(problem, Problem) and "time_ms" in problem.detail
        ws.send(pose(welcome.camera, 3))
        assert receive_keyframe(ws).pose == 3


def test_too_many_bad_values_end_the_stream(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        bad = msgspec.structs.replace(welcome.camera, width=0)
        with contextlib.suppress(ConnectionClosed):
            for seq in range(20):
                ws.send(encode(Pose(seq=seq, time_ms=0.0, camera=bad)))
        code, seen = closed_with(ws)
        assert code == 1008
        assert sum(isinstance(m, Problem) for m in seen) == 16


def test_poses_that_cannot_be_rendered_count_too(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        bad = msgspec.structs.replace(welcome.camera, world_from_camera=(2.0,) * 16)
        for seq in range(16):
            ws.send(encode(Pose(seq=seq, time_ms=0.0, camera=bad)))
            problem = receive(ws)
            assert isinstance(problem, Problem) and problem.status == 422
        assert closed_with(ws)[0] == 1008


def test_a_second_hello_is_named(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        ws.send(HELLO)
        problem = receive(ws)
        assert isinstance(problem, Problem) and "HELLO" in problem.detail
        ws.send(pose(welcome.camera, 1))
        assert receive_keyframe(ws).pose == 1


@pytest.mark.parametrize("seed", range(4))
def test_random_bytes_in_the_middle(server: RunningServer, seed: int) -> None:
    noise = random.Random(seed)
    with stream(server) as (ws, welcome):
        ws.send(pose(welcome.camera))
        with contextlib.suppress(ConnectionClosed):
            for _ in range(5):
                data = bytearray(pose(welcome.camera, 2))
                for _ in range(noise.randint(1, 30)):
                    data[noise.randrange(len(data))] = noise.randrange(256)
                ws.send(bytes(data))
            ws.send(b"TRDI\1\3")
        code, _ = closed_with(ws)
        assert code in (1002, 1008)


def test_who_does_not_acknowledge_is_dropped(server: RunningServer) -> None:
    with stream(server) as (ws, welcome):
        ws.send(pose(welcome.camera))
        begin = time.monotonic()
        code, seen = closed_with(ws)
        assert code == 1008
        assert 1.2 < time.monotonic() - begin < 10
        assert sum(isinstance(m, Keyframe) for m in seen) <= 2
        assert isinstance(seen[-1], Bye)


def test_who_never_reads_is_cut_off_and_others_go_on(server: RunningServer) -> None:
    """The peer does not even take what the system buffers for it."""
    session = server.session(width=140, height=110, layers=4)
    camera = msgspec.convert(session["camera"], CameraHeader)
    host, port = server.address.split(":")
    protocol = ClientProtocol(
        parse_uri(f"ws://{server.address}/v1/stream"),
        subprotocols=[Subprotocol(SUBPROTOCOL), Subprotocol(f"bearer.{session['ticket']}")],
    )
    with socket.socket() as plain:
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        plain.connect((host, int(port)))
        protocol.send_request(protocol.connect())
        plain.sendall(b"".join(protocol.data_to_send()))
        protocol.receive_data(plain.recv(4096))
        for message in (HELLO, pose(camera), pose(camera, 2, 0.2)):
            protocol.send_binary(message)
        plain.sendall(b"".join(protocol.data_to_send()))
        with stream(server) as (other, its_welcome):
            end, seq = time.monotonic() + 4.0, 0
            while time.monotonic() < end:
                seq += 1
                other.send(pose(its_welcome.camera, seq, 0.1 * (seq % 7), moving=True))
                receive_keyframe(other)
            assert seq > 3
        wait_for_streams(server, 0)


def wait_for_streams(server: RunningServer, count: int) -> None:
    end = time.monotonic() + 10
    while server.gauge("streams") != count:
        assert time.monotonic() < end
        time.sleep(0.1)


def test_a_scene_deleted_while_it_is_streamed(server: RunningServer) -> None:
    facts = server.ask("POST", "/v1/scenes", BOX, content_type="application/toml").json()
    with stream(server, scene=facts["id"]) as (ws, welcome), stream(server) as (other, its_welcome):
        ws.send(pose(welcome.camera))
        receive_keyframe(ws)
        assert server.ask("DELETE", f"/v1/scenes/{facts['id']}").status == 204
        code, seen = closed_with(ws)
        assert code == 4404
        assert any(isinstance(m, Problem) and m.status == 404 for m in seen) and isinstance(seen[-1], Bye)
        other.send(pose(its_welcome.camera))
        assert receive_keyframe(other).layer == 0
    assert refused(server, welcome.resume) == 403


def test_killed_connections_leave_nothing(server: RunningServer) -> None:
    def one() -> None:
        with open_stream(server, server.session()["ticket"]) as ws:
            ws.send(HELLO)
            welcome = receive(ws)
            assert isinstance(welcome, Welcome)
            ws.send(pose(welcome.camera))
            ws.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            ws.socket.close()

    threads = [threading.Thread(target=one) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wait_for_streams(server, 0)
