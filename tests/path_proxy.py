"""A small server before another one, which shows it below a path, as jupyter-server-proxy does."""

from __future__ import annotations

import contextlib
import socket
import threading
from types import TracebackType

LONGEST = 1 << 16
HEADERS_END = b"\r\n\r\n"


class PathProxy:
    """Passes what is asked below ``prefix`` on to a local port without it; all else is not found.

    One request a connection; a WebSocket keeps its own. Headers come through as they are, ``Host`` too.
    """

    def __init__(self, prefix: str, port: int) -> None:
        self.prefix, self._to = prefix, port
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._door.getsockname()[1])
        self.asked: list[str] = []  # paths, as they came
        self._open: list[socket.socket] = []

    @property
    def url(self) -> str:
        """Address of what it shows."""
        return f"http://127.0.0.1:{self.port}{self.prefix}/"

    def __enter__(self) -> PathProxy:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for end in (self._door, *self._open):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near = self._door.accept()[0]
                self._open.append(near)
                threading.Thread(target=self._serve, args=(near,), daemon=True).start()

    def _serve(self, near: socket.socket) -> None:
        with contextlib.suppress(OSError), near:
            head = b""
            while HEADERS_END not in head and len(head) < LONGEST:
                data = near.recv(LONGEST)
                if not data:
                    return
                head += data
            line, _, rest = head.partition(b"\r\n")
            method, path, version = line.decode("latin-1").split(" ")
            self.asked.append(path)
            if not path.startswith(self.prefix + "/"):
                near.sendall(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
                return
            upgrade = b"\r\nupgrade:" in (b"\r\n" + rest).lower()
            if not upgrade:
                rest = b"Connection: close\r\n" + rest.replace(b"\r\nConnection: keep-alive", b"")
            with socket.create_connection(("127.0.0.1", self._to)) as far:
                self._open.append(far)
                inner = path.removeprefix(self.prefix)
                far.sendall(f"{method} {inner} {version}\r\n".encode("latin-1") + rest)
                threading.Thread(target=self._pipe, args=(near, far), daemon=True).start()
                self._pipe(far, near)

    def _pipe(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(LONGEST):
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
