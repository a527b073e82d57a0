"""Real servers for tests, with small limits."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PIPE = subprocess.PIPE
START_S = 280.0
LIMITS = {
    "BUILT_IN": "cornell_box",
    "THREADS": "1",
    "RENDERERS": "1",
    "MAX_PIXELS": "20000",
    "MAX_STREAM_PIXELS": "20000",
    "MAX_SESSIONS": "16",
    "RESUME_S": "4",
    "MAX_UPLOAD_BYTES": "200000",
    "MAX_CONTAINER_BYTES": "400000",
    "MAX_BODY_BYTES": "40000",
    "MAX_TRIANGLES": "20000",
    "MAX_TEXTURE_PIXELS": "65536",
    "MAX_VIEWS": "4",
    "STALL_S": "3",
    "HELLO_S": "1.0",
    "TICKET_S": "20",
    "STILL_S": "0.2",
    "BATCH_RENDERER": "false",
    "SPARE_RENDERER": "false",
    "INSPECT_S": "250",
    "REQUESTS_PER_S": "100000",
}


@dataclass
class Answer:
    """A response of the service."""

    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class RunningServer:
    """A server process."""

    process: subprocess.Popen[str]
    url: str
    log: list[str]
    api_key: str | None = None

    @property
    def address(self) -> str:
        """Host and port."""
        return self.url.removeprefix("http://")

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> Answer:
        """One request; dictionaries are sent as JSON."""
        data = body
        if body is not None and not isinstance(body, bytes):
            data = json.dumps(body).encode()
            headers = {"content_type": "application/json", **headers}
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        request = urllib.request.Request(self.url + path, data, names, method=method)
        try:
            with urllib.request.urlopen(request, timeout=250) as response:
                return Answer(response.status, {k.lower(): v for k, v in response.headers.items()}, response.read())
        except urllib.error.HTTPError as error:
            with error:
                return Answer(error.code, {k.lower(): v for k, v in error.headers.items()}, error.read())

    def gauge(self, name: str) -> int:
        """A value of /metrics, whatever its labels."""
        text = self.ask("GET", "/metrics").body.decode()
        return next(int(found[1]) for found in re.finditer(rf"^torchrender_{name}(?:{{.*}})? (\d+)$", text, re.M))

    def session(self, **wishes: Any) -> dict[str, Any]:
        """A new session for a small view."""
        body = {"scene": "cornell_box", "width": 64, "height": 48, "layers": 0, **wishes}
        key = {} if self.api_key is None else {"authorization": f"Bearer {self.api_key}"}
        answer = self.ask("POST", "/v1/sessions", body, **key)
        assert answer.status == 201, answer.body
        return dict(answer.json())


ON_RAY = "TORCHRENDER_TESTS_ON_RAY"
"""Of the environment: with any value, servers for tests are one replica on Ray Serve."""


def start_on_ray(data: Path, **settings: str) -> RunningServer:
    """The same service on Ray Serve."""
    given = {name.lower(): value for name, value in {**LIMITS, **settings}.items()}
    words = [f"{name}={value}" for name, value in {"num_cpus": "2", "data_dir": str(data), **given}.items()]
    with socket.socket() as made:
        made.bind(("127.0.0.1", 0))
        port = made.getsockname()[1]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("TORCHRENDER_")}
    command = [sys.executable, "-m", "torchrender_service.ray_local", "--port", str(port), *words]
    return wait_for_line(subprocess.Popen(command, env=environment, stdout=PIPE, stderr=PIPE, text=True))


def start_server(data: Path, **settings: str) -> RunningServer:
    """Start a server and wait until it says where it is."""
    if os.environ.get(ON_RAY):
        return start_on_ray(data, **settings)
    environment = {k: v for k, v in os.environ.items() if not k.startswith("TORCHRENDER_")}
    environment |= {f"TORCHRENDER_{k}": v for k, v in {**LIMITS, **settings}.items()}
    command = [sys.executable, "-m", "torchrender.cli", "serve", "--port", "0", "--data", str(data)]
    return wait_for_line(subprocess.Popen(command, env=environment, stdout=PIPE, stderr=PIPE, text=True))


def wait_for_line(process: subprocess.Popen[str]) -> RunningServer:
    """Until it says where it is."""
    assert process.stdout is not None and process.stderr is not None
    log: list[str] = []
    threading.Thread(target=lambda: log.extend(process.stderr or []), daemon=True).start()
    line = process.stdout.readline()
    while line and "http://" not in line:
        line = process.stdout.readline()
    assert "torchrender serves on http://127.0.0.1:" in line, (line, log)
    return RunningServer(process, line.split()[-1].rstrip("/"), log)


def stop_server(server: RunningServer) -> None:
    """End it, politely first."""
    server.process.terminate()
    try:
        server.process.wait(15)
    finally:
        server.process.kill()
        server.process.wait()
        for stream in (server.process.stdout, server.process.stderr):
            if stream is not None:
                stream.close()
