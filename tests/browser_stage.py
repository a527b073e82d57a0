"""The real server, a real browser, and what goes between them: for tests and pictures of the thin client."""

from __future__ import annotations

import base64
import contextlib
import math
import os
import queue
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from torchrender.client.drawing import draw_keyframes
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import cameras_of
from torchrender.wire.containers import KeyframeImage, decode_keyframe
from torchrender.wire.messages import CameraHeader, Keyframe, Message, Type, decode, split_blobs

FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
START_S = 120.0
FRAME_MS = 180_000
"""The first picture in a new environment compiles kernels, beside other tests that do."""
JPEG_READY = "() => window.torchrender?.keyframes.length > 0"
COMPLETE = "() => { const k = window.torchrender?.keyframes[0]; return k && k.received === k.layers; }"
ARRIVED = """() => {
    const k = window.torchrender.keyframes[0], here = window.torchrender.camera.world_from_camera;
    const there = k.camera.world_from_camera;
    return k.samples > 1 && k.received === k.layers && there.every((v, n) => Math.abs(v - here[n]) < 1e-6);
}"""
REFINED = "() => { const k = window.torchrender?.keyframes[0]; return k && k.samples > 1 && k.received === k.layers; }"


def find_chromium() -> str | None:
    """Path of a Chromium, from ``TORCHRENDER_CHROMIUM`` or the usual names."""
    named = os.environ.get("TORCHRENDER_CHROMIUM")
    return named or next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Service:
    """``torchrender serve`` in its own process; keeps its port when it is started again."""

    def __init__(self, scenes: str = "cornell_box,living_room", **settings: Any) -> None:
        self.folder = tempfile.mkdtemp(prefix="torchrender-browser-")
        self.port = 0
        self.process: subprocess.Popen[str] | None = None
        given = {f"TORCHRENDER_{name.upper()}": str(value) for name, value in settings.items()}
        self.environment = os.environ | {"TORCHRENDER_BUILT_IN": scenes, "TORCHRENDER_LOG_LEVEL": "warning"} | given

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def start(self) -> None:
        """Returns when it answers."""
        command = [
            sys.executable,
            "-c",
            "from torchrender.cli.main import main; main()",
            "serve",
            "--data",
            self.folder,
        ]
        command += ["--port", str(self.port)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, env=self.environment, text=True)
        assert self.process.stdout is not None
        timer = threading.Timer(START_S, self.process.kill)
        timer.start()
        try:
            for line in self.process.stdout:
                found = re.search(r"serves on http://[^/]*:(\d+)/", line)
                if found:
                    self.port = int(found[1])
                    return
        finally:
            timer.cancel()
        raise RuntimeError(f"the server ended with {self.process.wait()} before it served")

    def kill(self) -> None:
        """End it as a crash would."""
        assert self.process is not None
        self.process.kill()
        self.process.communicate()

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Let it do nothing for a while; its connections stay open."""
        assert self.process is not None
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """End it properly and remove its folder."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.communicate(timeout=15)
            except subprocess.TimeoutExpired:
                self.kill()
        shutil.rmtree(self.folder, ignore_errors=True)


class Relay:
    """Passes TCP connections on to a local port, late by ``delay_s`` each way; can cut all of them."""

    def __init__(self, port: int, delay_s: float = 0.0) -> None:
        self._to, self._delay = port, delay_s
        self._open: list[socket.socket] = []
        self._door = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self._door.getsockname()[1]}/"

    def cut(self) -> None:
        """Break every connection."""
        while self._open:
            end = self._open.pop()
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def close(self) -> None:
        """Take no more connections, break those there are."""
        with contextlib.suppress(OSError):
            self._door.shutdown(socket.SHUT_RDWR)
        self._door.close()
        self.cut()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near = self._door.accept()[0]
                far = socket.create_connection(("127.0.0.1", self._to))
                self._open += [near, far]
                for source, sink in ((near, far), (far, near)):
                    pipe: queue.Queue[tuple[float, bytes]] = queue.Queue()
                    threading.Thread(target=self._read, args=(source, pipe), daemon=True).start()
                    threading.Thread(target=self._write, args=(sink, pipe), daemon=True).start()

    def _read(self, source: socket.socket, pipe: queue.Queue[tuple[float, bytes]]) -> None:
        data = b""
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                pipe.put((time.monotonic() + self._delay, data))
        pipe.put((time.monotonic() + self._delay, b""))

    def _write(self, sink: socket.socket, pipe: queue.Queue[tuple[float, bytes]]) -> None:
        with contextlib.suppress(OSError):
            while True:
                due, data = pipe.get()
                time.sleep(max(0.0, due - time.monotonic()))
                if not data:
                    return sink.shutdown(socket.SHUT_RDWR)
                sink.sendall(data)


@dataclass
class Visit:
    """An open page with everything that it said and received."""

    page: Any  # playwright.sync_api.Page
    problems: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)
    received: list[bytes] = field(default_factory=list)
    sent: list[bytes] = field(default_factory=list)

    @classmethod
    def begin(cls, context: Any, url: str, **query: Any) -> Visit:
        """Open the page in a browser context."""
        visit = cls(context.new_page())
        page = visit.page
        page.on("pageerror", lambda error: visit.problems.append(str(error)))
        page.on("console", lambda line: line.type in ("error", "warning") and visit.problems.append(line.text))
        page.on("request", lambda request: visit.requests.append(request.url))
        page.on("websocket", visit._listen)
        page.goto(url + "?" + "&".join(f"{name}={value}" for name, value in query.items()))
        return visit

    def _listen(self, stream: Any) -> None:
        self.requests.append(stream.url)
        stream.on("framereceived", lambda data: isinstance(data, bytes) and self.received.append(data))
        stream.on("framesent", lambda data: isinstance(data, bytes) and self.sent.append(data))

    def wait(self, condition: str, timeout: float = FRAME_MS) -> None:
        """Until a JavaScript condition holds."""
        self.page.wait_for_function(condition, timeout=timeout)

    def rest(self) -> None:
        """Until what was pressed, dragged and let go is done and the view stands still."""
        frames = self.state("stats")["frames"]
        self.wait(f"() => window.torchrender.stats.frames > {frames + 1} && !window.torchrender.moving")

    def hold(self, key: str, seconds: float = 0.4) -> None:
        """Press a key for a while, and wait until the view stands still."""
        self.page.keyboard.down(key)
        self.page.wait_for_timeout(1000 * seconds)
        # A busy machine may have drawn nothing meanwhile, and keys move the view from frame to frame.
        self.page.evaluate(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))"
        )
        self.page.keyboard.up(key)
        self.rest()

    def state(self, name: str) -> Any:
        """A property of ``window.torchrender``."""
        return self.page.evaluate(f"() => window.torchrender.{name}")

    def capture(self, **options: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """The client's own picture (H,W,3) uint8 and which pixels samples cover (H,W) bool."""
        script = """
            const { width, height, pixels } = window.torchrender.capture(given.options);
            return [width, height, text(pixels)];
        """
        width, height, text = run_script(self.page, script, options=options)
        pixels = np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)
        return pixels[..., :3], pixels[..., 3] > 0

    def messages(self, kind: Type) -> list[Message]:
        """What the page sent, of one type."""
        return [decode(data).message for data in self.sent if data[5] == kind]

    @property
    def keyframe_count(self) -> int:
        """Messages with a layer of a keyframe that the page has received; others tell that the server is there."""
        return sum(data[5] == Type.KEYFRAME for data in self.received)

    def wait_for_message(self, kind: Type, fits: Callable[[Any], bool]) -> None:
        """Until the page has sent a message of one type that fits."""
        end = time.monotonic() + FRAME_MS / 1000
        while not any(fits(message) for message in self.messages(kind)):
            assert time.monotonic() < end, f"none of {self.messages(kind)} fits"
            self.page.wait_for_timeout(20)

    def layers(self, number: int) -> list[bytes]:
        """The messages of keyframe ``number``, layer by layer."""
        found = {}
        for data in self.received:
            message = decode(data).message
            if isinstance(message, Keyframe) and message.id == number:
                found[message.layer] = data
        return [found[layer] for layer in sorted(found)]


def says(page: Any, selector: str, text: str, timeout: float = FRAME_MS) -> None:
    """Wait until an element's text contains another: the page may write it after what a test waited for."""
    from playwright.sync_api import expect

    expect(page.locator(selector)).to_contain_text(text, timeout=timeout)


def run_script(page: Any, script: str, **values: Any) -> Any:
    """What a script in the page returns; ``values`` are its ``given``. Byte strings travel as base64, both ways."""
    packed = {k: base64.b64encode(v).decode() if isinstance(v, bytes) else v for k, v in values.items()}
    helpers = """
        const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
        const text = (array) => {
            const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
            let out = "";
            for (let i = 0; i < bytes.length; i += 8192) out += String.fromCharCode(...bytes.subarray(i, i + 8192));
            return btoa(out);
        };
    """
    return page.evaluate(f"async (given) => {{ {helpers} {script} }}", packed)


def camera_of(view: dict[str, Any]) -> Cameras:
    """A camera of the page."""
    return cameras_of(msgspec.convert(view, CameraHeader))


def moved(view: dict[str, Any], right: float, down: float, forward: float) -> dict[str, Any]:
    """A camera of the page, moved along its own axes, scene units."""
    matrix = np.array(view["world_from_camera"]).reshape(4, 4)
    matrix[:3, 3] += matrix[:3, :3] @ (right, down, forward)
    return view | {"world_from_camera": matrix.reshape(-1).tolist()}


def pictures_of(messages: list[bytes]) -> list[KeyframeImage]:
    """KEYFRAME messages, decoded by the service's own code."""
    found = []
    for data in messages:
        received = decode(data)
        assert isinstance(received.message, Keyframe)
        found.append(decode_keyframe(received.message, split_blobs(received), received.blobs))
    return found


def reprojected(pictures: list[KeyframeImage], camera: Cameras) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """What Python draws of them: display colours (H,W,3) uint8 and validity (H,W)."""
    codes = torch.stack([picture.codes for picture in pictures]).float()
    result = draw_keyframes(pictures, camera, colors=codes)
    return result.color[0].round().numpy().astype(np.uint8), result.valid[0].numpy()


def psnr(first: np.ndarray[Any, Any], second: np.ndarray[Any, Any], counted: np.ndarray[Any, Any]) -> float:
    """Of uint8 pictures (H,W,3), over the counted pixels (H,W); at most 99 dB."""
    difference = (first.astype(np.float64) - second.astype(np.float64))[counted]
    return min(99.0, 10 * math.log10(255**2 / max(float((difference**2).mean()), 1e-9)))


def grown(mask: np.ndarray[Any, Any], steps: int = 1) -> np.ndarray[Any, Any]:
    """A mask (H,W), larger by ``steps`` pixels in all eight directions."""
    out = mask
    for _ in range(steps):
        padded = np.pad(out, 1)
        height, width = mask.shape
        out = np.logical_or.reduce([padded[j : j + height, i : i + width] for j in range(3) for i in range(3)])
    return out


def to_repository(name: str) -> Path:
    """A path in the repository."""
    return Path(__file__).resolve().parent.parent / name
