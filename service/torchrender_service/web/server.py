"""The server process: uvicorn with what streams need, and a shutdown that says goodbye first."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import sys
import time
from typing import Any

import uvicorn

from torchrender.errors import OptionError
from torchrender_service.door.accepting import listening
from torchrender_service.door.protocol import StreamProtocol, http_protocol
from torchrender_service.logs import set_up_logs
from torchrender_service.renderers.pool import Pool
from torchrender_service.settings import Settings, misspelt
from torchrender_service.streams.greeting import MAX_MESSAGE_BYTES
from torchrender_service.web.app import make_app
from torchrender_service.web.state import MakePool

LOG = logging.getLogger("torchrender_service.web.server")
UNTIL_CANCELLED_S = 3.0
"""Of the time for a shutdown: what is left for requests that were cut short to be told so."""


class Server(uvicorn.Server):
    """Says goodbye to streams before connections are closed."""

    def __init__(self, config: uvicorn.Config, settings: Settings) -> None:
        super().__init__(config)
        self._settings = settings
        self._told: dict[str, float] = {}

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Also print where the service is."""
        asyncio.get_running_loop().set_exception_handler(self._loop_error)
        await super().startup(self.listen() if sockets is None else sockets)
        if self.started:
            host, port = self.servers[0].sockets[0].getsockname()[:2]
            shown = f"[{host}]" if ":" in host else host
            sys.stdout.write(f"torchrender serves on http://{shown}:{port}{self._settings.root_path}/\n")
            sys.stdout.flush()

    def listen(self) -> list[socket.socket]:
        """Sockets that look at who comes.

        Raises:
            OptionError: host and port cannot be used.
        """
        host, port = self.config.host, self.config.port
        app: Any = self.config.app
        try:
            return listening(host, port, app.state.service.connections.arrivals)
        except OSError as error:
            raise OptionError(f"cannot listen on {host}, port {port}: {error.strerror or error}") from error

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """BYE and close 1012 to every stream; requests get their answers, or are told to come again."""
        await self.config.loaded_app.state.service.say_goodbye(self._settings.shutdown_s - UNTIL_CANCELLED_S)
        await super().shutdown(sockets)

    def _loop_error(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """As asyncio does, but the same thing at most once a second: where no file is left, accepting fails all the
        time."""
        del loop
        message = str(context.get("message"))
        now = time.monotonic()
        if now - self._told.get(message, -1.0) < 1.0:
            return
        self._told = {**{m: t for m, t in self._told.items() if now - t < 60.0}, message: now}
        LOG.error("%s", message, exc_info=context.get("exception"))


def socket_settings() -> dict[str, Any]:
    """How uvicorn handles WebSockets: depth and colour are compressed already."""
    return {"ws": StreamProtocol, "ws_per_message_deflate": False, "ws_max_size": MAX_MESSAGE_BYTES}


def make_server(settings: Settings, make_pool: MakePool = Pool, *, start: str = "") -> Server:
    """A server for these settings, not yet running."""
    app = make_app(settings, make_pool, start=start)
    config = uvicorn.Config(
        app,
        host=settings.host.strip("[]"),
        port=settings.port,
        loop="asyncio",  # others accept connections on their own
        http=http_protocol(app.state.service.connections, settings),
        **socket_settings(),
        timeout_graceful_shutdown=max(1, int(UNTIL_CANCELLED_S)),
        timeout_keep_alive=max(1, int(settings.idle_s)),
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
    )
    return Server(config, settings)


async def serve(settings: Settings, make_pool: MakePool, *, start: str = "") -> None:
    """Run until a signal stops it; the page begins with the scene ``start``.

    Raises:
        OptionError: the data folder, or host and port, cannot be used.
    """
    set_up_logs(settings.log_level)
    for said in misspelt(os.environ):
        LOG.warning(said)
    server = make_server(settings, make_pool, start=start)
    app: Any = server.config.app
    with app.state.service.scenes.own_folder():
        await server.serve(sockets=server.listen())
