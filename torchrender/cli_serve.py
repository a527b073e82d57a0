"""The command ``torchrender serve``: the service on this machine."""

from __future__ import annotations

import argparse
import importlib.util
from typing import Any

from torchrender.errors import InputError

_NEEDED = ("fastapi", "uvicorn", "websockets", "msgspec", "zstandard", "simplejpeg")


def add_serve(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("serve", help="serve scenes, pictures and streams of depth images over HTTP")
    parser.add_argument("--host", help="address to listen on (default 127.0.0.1); others need TORCHRENDER_API_KEY")
    parser.add_argument("--port", type=int, help="port (default 8000; 0: any that is free)")
    parser.add_argument("--data", metavar="FOLDER", help="where uploaded scenes are kept (default torchrender-data)")
    parser.add_argument("--config", metavar="FILE", help="TOML file of settings")


def serve_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    check_service_installed()
    from service.server import serve
    from service.settings import read_settings

    given = {"host": arguments.host, "port": arguments.port, "data_dir": arguments.data, "threads": arguments.threads}
    serve(read_settings(arguments.config, **given))


def check_service_installed() -> None:
    """Say what to install where the extra is missing.

    Raises:
        InputError: names the missing packages.
    """
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(f"the service needs {', '.join(missing)}: pip install 'torchrender[service]'")
