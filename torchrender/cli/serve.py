"""The commands ``torchrender serve`` and ``torchrender load-test``: the service, and how it holds up."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from torchrender.cli.output import make_folder
from torchrender.errors import OptionError


def add_serve(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("serve", help="serve scenes, pictures and streams of depth images over HTTP")
    parser.add_argument("--host", help="address to listen on (default 127.0.0.1); others need TORCHRENDER_API_KEY")
    parser.add_argument("--port", type=int, help="port (default 8000; 0: any that is free)")
    parser.add_argument("--data", metavar="FOLDER", help="where uploaded scenes are kept (default torchrender-data)")
    parser.add_argument("--config", metavar="FILE", help="TOML file of settings")


def serve_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from torchrender_service.settings import read_settings
    from torchrender_service.web.server import serve

    given = {"host": arguments.host, "port": arguments.port, "data_dir": arguments.data, "threads": arguments.threads}
    serve(read_settings(arguments.config, **given))


def add_load_test(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("load-test", help="measure the service under load and faults, and write a page")
    parser.add_argument("-o", "--output", default="docs/results", metavar="FOLDER", help="default docs/results")
    parser.add_argument("--quick", action="store_true", help="two minutes with small pictures instead of half an hour")
    parser.add_argument("--soak", type=float, default=600.0, metavar="SECONDS", help="of the soak (default 600)")


def load_test_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    if not 10.0 <= arguments.soak <= 86400.0:
        raise OptionError(f"--soak must be in [10, 86400], got {arguments.soak}")
    from torchrender_service.load_test.rows import Effort
    from torchrender_service.load_test.run import run_load_test

    folder = Path(arguments.output)
    make_folder(folder)
    met = run_load_test(folder, Effort(quick=arguments.quick, soak_s=arguments.soak))
    sys.stdout.write(f"{folder / 'service.md'}{'' if met else ': some goals were missed'}\n")
