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
    parser.add_argument("scenes", nargs="*", metavar="FILE", help="walkthroughs (.trw) to serve besides")
    parser.add_argument("--host", help="address to listen on (default 127.0.0.1); others need TORCHRENDER_API_KEY")
    parser.add_argument("--port", type=int, help="port (default 8000; 0: any that is free)")
    parser.add_argument("--data", metavar="FOLDER", help="where uploaded scenes are kept (default torchrender-data)")
    parser.add_argument("--config", metavar="FILE", help="TOML file of settings")


def serve_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from torchrender_service.settings import read_settings
    from torchrender_service.web.server import serve

    given = {"host": arguments.host, "port": arguments.port, "data_dir": arguments.data, "threads": arguments.threads}
    settings = read_settings(arguments.config, **given)
    for name in arguments.scenes:
        sys.stderr.write(f"{name} is scene {_keep_walkthrough(name, Path(settings.data_dir))}\n")
    serve(settings)


def _keep_walkthrough(name: str, data: Path) -> str:
    """Put a walkthrough into the store as a scene of triangles; returns its id."""
    import hashlib
    import json
    import shutil
    import tempfile

    from torchrender.scene.load import load
    from torchrender.walkthrough.export import write_scene
    from torchrender.walkthrough.file import read_walkthrough
    from torchrender_service.renderers.scene_cache import describe

    path = Path(name)
    if path.suffix.lower() != ".trw":
        raise OptionError(f"serve takes walkthroughs (.trw), got {name}; other scenes are uploaded")
    made = read_walkthrough(path)
    scene = hashlib.sha256(b"trw" + path.read_bytes()).hexdigest()
    home = data / "scenes" / scene
    if not home.is_dir():
        make_folder(home.parent)
        with tempfile.TemporaryDirectory(dir=home.parent, prefix=".unfinished-") as folder:
            file = write_scene(folder, made)
            facts = describe(load(file))
            facts.pop("orthographic")
            facts |= {"id": scene, "built_in": False, "kind": "toml", "bytes": file.stat().st_size, "name": path.stem}
            (Path(folder) / "facts.json").write_text(json.dumps(facts))
            shutil.copytree(folder, home)
    return scene


def add_load_test(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("load-test", help="measure the service under load and faults, and write a page")
    parser.add_argument("-o", "--output", default="docs/results", metavar="FOLDER", help="default docs/results")
    parser.add_argument("--quick", action="store_true", help="five minutes with small pictures instead of half an hour")
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
