"""The one viewer service of a program: it starts with the first scene that is shown, and ends with the program."""

from __future__ import annotations

import atexit
import logging
import queue
import shutil
import socket
import tempfile
import threading
from collections.abc import Callable, Sequence
from typing import Any

import uvicorn

from torchrender.errors import TorchRenderError
from torchrender.scene.model import Scene
from torchrender.wire.messages import CameraHeader, Picked
from torchrender_service.door.accepting import listening
from torchrender_service.door.protocol import http_protocol
from torchrender_service.renderers.scene_cache import describe
from torchrender_service.settings import Settings
from torchrender_service.viewer.live_scenes import LiveScenes
from torchrender_service.viewer.thread_pool import ThreadPool
from torchrender_service.web.app import make_app
from torchrender_service.web.server import socket_settings
from torchrender_service.web.state import ServiceState

LOG = logging.getLogger("torchrender_service.viewer.live_server")
START_S = 20.0
STOP_S = 2.0
STILL_S = 0.3
FRAMES = ("'self'", "http://127.0.0.1:*", "http://localhost:*", "https://localhost:*", "vscode-webview://*")
"""Pages that show notebooks on this machine."""


class LiveServer:
    """Serves scenes of this program on a port of this machine's loopback address.

    Args:
        port: 0: any that is free.
        hosts: names under which browsers see it, where a proxy shows it, such as ``hub.example.org``.
    """

    def __init__(self, port: int = 0, hosts: Sequence[str] = ()) -> None:
        self.scenes = LiveScenes()
        self.hosts = frozenset(hosts)
        self._folder = tempfile.mkdtemp(prefix="torchrender-viewer-")
        origins = tuple(f"{scheme}://{host}" for host in hosts for scheme in ("http", "https"))
        settings = Settings(
            port=port,
            built_in=(),
            data_dir=self._folder,
            still_s=STILL_S,
            allowed_hosts=tuple(host.partition(":")[0] for host in hosts),
            allowed_origins=origins,
            frame_ancestors=(*FRAMES, *origins),
        )
        app = make_app(settings, lambda *_: ThreadPool(self.scenes))
        self._state: ServiceState = app.state.service
        self._state.around.on_pick = self._picked
        self._controls: dict[str, str] = {}
        self._heard: queue.SimpleQueue[tuple[Callable[[Picked], None], Picked]] = queue.SimpleQueue()
        self._listeners: dict[str, list[Callable[[Picked], None]]] = {}
        config = uvicorn.Config(
            app,
            host=settings.host,
            port=settings.port,
            http=http_protocol(self._state.connections, settings),
            **socket_settings(),
            timeout_graceful_shutdown=1,
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, daemon=True, name="torchrender-viewer-server")
        self._sockets: list[socket.socket] = []

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._server.servers[0].sockets[0].getsockname()[1])

    @property
    def running(self) -> bool:
        """It takes requests."""
        return self._thread.is_alive() and self._server.started

    def start(self) -> None:
        """Returns when it takes requests.

        Raises:
            TorchRenderError: it does not, because the port is in use, for instance.
        """
        config = self._server.config
        used = TorchRenderError(f"the viewer cannot listen on port {config.port}: is it in use?")
        try:
            self._sockets = listening(config.host, config.port, self._state.connections.arrivals)
        except OSError as error:
            raise used from error
        self._thread.start()
        threading.Thread(target=self._tell, daemon=True, name="torchrender-viewer-callbacks").start()
        waited = threading.Event()
        for _ in range(int(START_S / 0.02)):
            if self._server.started or not self._thread.is_alive():
                break
            waited.wait(0.02)
        if not self.running:
            raise used
        self._loop = self._server.servers[0].get_loop()
        atexit.register(self.stop)

    def _run(self) -> None:
        self._server.run(sockets=self._sockets)

    def stop(self) -> None:
        """End it; pages that show its scenes keep their last picture."""
        atexit.unregister(self.stop)
        self._server.should_exit = True
        self._thread.join(STOP_S)
        shutil.rmtree(self._folder, ignore_errors=True)

    def put(self, scene: str, value: Scene) -> None:
        """Show a scene, or what has become of it; any thread may call this."""
        facts = describe(value, self._controls.get(scene))
        self._controls[scene] = facts["controls"]  # a scene that changes is looked at as before
        facts.pop("orthographic")
        self.scenes.put(scene, value)

        def tell() -> None:
            self._state.scenes.put_live(scene, facts)
            self._state.scene_changed(scene)

        self._soon(tell)

    def drop(self, scene: str) -> None:
        """Show it no longer."""
        self._listeners.pop(scene, None)
        self._controls.pop(scene, None)
        self.scenes.drop(scene)

        def tell() -> None:
            self._state.scenes.drop_live(scene)
            self._state.scene_deleted(scene)

        self._soon(tell)

    def listen(self, scene: str, callback: Callable[[Picked], None]) -> None:
        """Call back with every surface that somebody clicks on, in their order, in a thread for all callbacks."""
        self._listeners.setdefault(scene, []).append(callback)

    def camera(self, scene: str) -> CameraHeader | None:
        """Where the page that was opened last looks from; None: there is none."""
        open_ = [s.connection for s in self._state.sessions.of_scene(scene) if s.connection is not None]
        cameras = [c.camera for c in open_ if c.camera is not None]
        return cameras[-1] if cameras else None

    def look(self, scene: str, camera: CameraHeader) -> None:
        """Ask all pages that show a scene to look from there."""

        def tell() -> None:
            for session in self._state.sessions.of_scene(scene):
                if session.connection is not None:
                    session.connection.look(camera)

        self._soon(tell)

    def _soon(self, work: Callable[[], Any]) -> None:
        """In the server's thread, and done when this returns."""
        done = threading.Event()

        def run() -> None:
            try:
                work()
            finally:
                done.set()

        self._loop.call_soon_threadsafe(run)
        if threading.current_thread() is not self._thread:
            done.wait(START_S)

    def _picked(self, scene: str, picked: Picked) -> None:
        for callback in self._listeners.get(scene, []):
            self._heard.put((callback, picked))

    def _tell(self) -> None:
        """Call back, one after the other; a callback that fails says so and stops nothing else."""
        while True:
            callback, picked = self._heard.get()
            try:
                callback(picked)
            except Exception:
                LOG.exception("a callback of a view failed")


_SERVERS: list[LiveServer] = []
_LOCK = threading.Lock()


def live_server(port: int = 0, hosts: Sequence[str] = ()) -> LiveServer:
    """The server of this program; it starts where there is none, or none that goes by these names.

    Raises:
        TorchRenderError: it does not start.
    """
    with _LOCK:
        _SERVERS[:] = [server for server in _SERVERS if server.running]
        for server in _SERVERS:
            if port in (0, server.port) and server.hosts >= set(hosts):
                return server
        server = LiveServer(port, hosts)
        server.start()
        _SERVERS.append(server)
        return server
