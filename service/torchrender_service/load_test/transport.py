"""Sends the same message again and again, with the WebSocket settings of the service; prints its port."""

from __future__ import annotations

import socket
import sys

import uvicorn
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from torchrender_service.web.server import socket_settings


def main() -> None:
    """Serve until stopped; the only argument is the size of the message."""
    message = bytes(range(256)) * (int(sys.argv[1]) // 256 + 1)

    async def send(ws: WebSocket) -> None:
        await ws.accept()
        try:
            while True:
                await ws.send_bytes(message)
        except WebSocketDisconnect:
            return

    listener = socket.socket()
    listener.bind(("127.0.0.1", 0))
    listener.listen()  # before anybody is told the port
    sys.stdout.write(f"{listener.getsockname()[1]}\n")
    sys.stdout.flush()
    app = Starlette(routes=[WebSocketRoute("/", send)])
    config = uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=1, **socket_settings())
    uvicorn.Server(config).run([listener])


if __name__ == "__main__":
    main()
