"""The server process: uvicorn with what streams need, and a shutdown that says goodbye first."""

from __future__ import annotations

import socket
import sys
from typing import Any

import uvicorn
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from torchrender_service.logs import set_up_logs
from torchrender_service.settings import Settings
from torchrender_service.streams.greeting import MAX_MESSAGE_BYTES
from torchrender_service.web.app import make_app

LINGER_S = 5.0
"""After a close the peer may take this long to read what was sent before."""


class StreamProtocol(WebSocketsSansIOProtocol):
    """Lets the application cut off a peer that does not read; closing would wait for it."""

    def handle_connect(self, event: Request) -> None:
        """Tell the application how."""
        super().handle_connect(event)
        scope: Any = getattr(self, "scope", None)
        if scope is not None:
            scope["extensions"]["torchrender.abort"] = self.transport.abort

    async def send(self, message: Any) -> None:
        """Also end connections that were refused or closed, whatever the peer does."""
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True  # the refusal was the whole handshake
        if message["type"] == "websocket.close":
            self.loop.call_later(LINGER_S, self.transport.abort)


class Server(uvicorn.Server):
    """Says goodbye to streams before connections are closed."""

    def __init__(self, config: uvicorn.Config, settings: Settings) -> None:
        super().__init__(config)
        self._settings = settings

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Also print where the service is."""
        await super().startup(sockets)
        if self.started:
            host, port = self.servers[0].sockets[0].getsockname()[:2]
            shown = f"[{host}]" if ":" in host else host
            sys.stdout.write(f"torchrender serves on http://{shown}:{port}/\n")
            sys.stdout.flush()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """BYE and close 1012 to every stream, then whatever else is open."""
        await self.config.loaded_app.state.service.stop_streams()
        await super().shutdown(sockets)


def socket_settings() -> dict[str, Any]:
    """How uvicorn handles WebSockets: depth and colour are compressed already."""
    return {"ws": StreamProtocol, "ws_per_message_deflate": False, "ws_max_size": MAX_MESSAGE_BYTES}


def make_server(settings: Settings) -> Server:
    """A server for these settings, not yet running."""
    config = uvicorn.Config(
        make_app(settings),
        host=settings.host.strip("[]"),
        port=settings.port,
        **socket_settings(),
        timeout_graceful_shutdown=max(1, int(settings.shutdown_s) - 3),
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
    )
    return Server(config, settings)


def serve(settings: Settings) -> None:
    """Run until a signal stops it."""
    set_up_logs(settings.log_level)
    make_server(settings).run()
