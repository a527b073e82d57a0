"""Stopping in the middle of a keyframe, and what is there after the next start."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from service_server import RunningServer, start_server, stop_server
from torchrender.wire.messages import SUBPROTOCOL, Ack, Bye, Hello, Keyframe, Pose, Welcome, decode, encode

BOX = b'name = "box"\n[[geometry]]\nshape = "box"\nsize = 1.0\n'
KEY = "a-key-of-enough-letters"


def renderers_of(server: RunningServer) -> list[str]:
    found = subprocess.run(["ps", "--ppid", str(server.process.pid), "-o", "pid="], capture_output=True, text=True)
    return found.stdout.split()


def stop_in_a_keyframe(server: RunningServer) -> None:
    """SIGTERM while a client moves: BYE, close 1012, and the process ends by itself."""
    session = server.session(width=120, height=90, layers=4)
    protocols = [SUBPROTOCOL, f"bearer.{session['ticket']}"]
    with connect(f"ws://{server.address}/v1/stream", subprotocols=protocols, compression=None) as ws:  # type: ignore[arg-type]
        ws.send(encode(Hello(versions=(1, 1))))
        welcome = decode(ws.recv(60)).message
        assert isinstance(welcome, Welcome)
        ws.send(encode(Pose(seq=1, time_ms=0.0, camera=welcome.camera)))
        first = decode(ws.recv(60)).message
        assert isinstance(first, Keyframe)
        ws.send(encode(Ack(id=first.id)))
        begin = time.monotonic()
        server.process.send_signal(signal.SIGTERM)
        messages = []
        with pytest.raises(ConnectionClosed) as caught:
            while True:
                messages.append(decode(ws.recv(20)).message)
    assert caught.value.rcvd is not None and caught.value.rcvd.code == 1012
    assert isinstance(messages[-1], Bye) and messages[-1].retry_after_s is not None
    server.process.wait(10)
    assert time.monotonic() - begin < 10


@pytest.mark.skipif(sys.platform == "win32", reason="signals and ps")
def test_a_stopped_server_says_goodbye_and_starts_again_with_its_scenes(tmp_path):
    server = start_server(tmp_path, API_KEY=KEY)
    try:
        key = {"authorization": f"Bearer {KEY}"}
        assert server.ask("GET", "/v1/scenes").status == 401
        assert server.ask("GET", "/metrics", authorization="Bearer wrong-key-of-letters").status == 401
        assert server.ask("GET", "/health").status == 200
        facts = server.ask("POST", "/v1/scenes", BOX, content_type="application/toml", **key).json()
        server.api_key = KEY
        renderers = renderers_of(server)
        assert len(renderers) == 2  # one that renders, one that looked at the upload
        os.kill(int(renderers[0]), signal.SIGKILL)  # as when the system runs out of memory
        body = {"scene": "cornell_box", "width": 32, "height": 24}
        while (answer := server.ask("POST", "/v1/render", body, **key)).status == 503:
            time.sleep(0.1)
        assert answer.status == 200
        renderers = renderers_of(server)
        stop_in_a_keyframe(server)
        assert server.process.returncode == -signal.SIGTERM
        assert not any(subprocess.run(["ps", "-p", pid], capture_output=True).returncode == 0 for pid in renderers)
        assert not any(KEY in line for line in server.log)
    finally:
        stop_server(server)
    again = start_server(tmp_path)
    try:
        assert again.ask("GET", f"/v1/scenes/{facts['id']}").json() == facts
    finally:
        stop_server(again)
