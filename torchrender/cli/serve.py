"""The commands ``torchrender serve`` and ``torchrender load-test``: the service, and how it holds up."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.output import make_folder
from torchrender.errors import OptionError, SceneFileError

if TYPE_CHECKING:
    from torchrender.scene.model import Scene


def add_serve(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("serve", help="serve scenes, pictures and streams of depth images over HTTP")
    parser.add_argument("scenes", nargs="*", metavar="FILE", help="scenes to serve besides; the first is shown first")
    parser.add_argument("--host", help="address to listen on (default 127.0.0.1); others need TORCHRENDER_API_KEY")
    parser.add_argument("--port", type=int, help="port (default 8000; 0: any that is free)")
    parser.add_argument("--data", metavar="FOLDER", help="where uploaded scenes are kept (default torchrender-data)")
    parser.add_argument("--config", metavar="FILE", help="TOML file of settings")


def serve_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from torchrender_service.serving import run
    from torchrender_service.settings import read_settings

    given = {"host": arguments.host, "port": arguments.port, "data_dir": arguments.data, "threads": arguments.threads}
    settings = read_settings(arguments.config, **given)
    start = ""
    for name in arguments.scenes:
        if name in settings.built_in:
            start = start or name
            continue
        scene, flat = _keep(Path(name), Path(settings.data_dir))
        start = start or ("" if flat else scene)
        told = ": its first camera is orthographic, so there are pictures of it, but no streams" if flat else ""
        sys.stderr.write(f"{name} is scene {scene}{told}\n")
    run(settings, start=start)


def _keep(path: Path, data: Path) -> tuple[str, bool]:
    """Put a file among the scenes of the service; returns its id, and whether its first camera is orthographic.

    A walkthrough becomes a scene of triangles. Other files stay where they are, with their textures: what is kept is a
    link to their folder, and what the service tells of them.

    Raises:
        SceneFileError: it cannot be read.
    """
    import hashlib
    import tempfile

    from torchrender.walkthrough.export import write_scene
    from torchrender.walkthrough.file import read_walkthrough
    from torchrender_service.renderers.uploads.any_scene import load_any
    from torchrender_service.scenes.folder import LINK

    if path.suffix.lower() == ".trw":
        made, flat = read_walkthrough(path), False
        scene = hashlib.sha256(b"trw" + path.read_bytes()).hexdigest()
    else:
        if not path.is_file():
            raise SceneFileError(path, "no such file")
        shown = load_any(path)
        flat = shown.camera(width=64, height=36).orthographic
        where = path.resolve()
        told = f"{where}\0{where.stat().st_mtime_ns}\0{where.stat().st_size}"
        scene = hashlib.sha256(told.encode(errors="surrogateescape")).hexdigest()
    home = data / "scenes" / scene
    if home.is_dir():
        return scene, flat
    make_folder(home.parent)
    with tempfile.TemporaryDirectory(dir=home.parent, prefix=".unfinished-") as folder:
        if path.suffix.lower() == ".trw":
            file = write_scene(folder, made)
            more: dict[str, Any] = {"kind": "toml", "bytes": file.stat().st_size}
            shown = load_any(file)
        else:
            kind = path.suffix.lower()[1:]
            more = {"kind": kind if kind in ("glb", "toml") else "zip", "bytes": where.stat().st_size}
            more["main"] = f"{LINK}/{where.name}"
            (Path(folder) / LINK).symlink_to(where.parent, target_is_directory=True)
        _finish(Path(folder), home, shown, {"id": scene, "built_in": False, "name": path.stem} | more)
    return scene, flat


def _finish(folder: Path, home: Path, scene: Scene, more: dict[str, Any]) -> None:
    """Write down what the service tells of a scene, and put its folder in place."""
    import json
    import shutil

    from torchrender_service.renderers.scene_cache import describe

    facts = describe(scene)
    facts.pop("orthographic")
    (folder / "facts.json").write_text(json.dumps(facts | more))
    shutil.copytree(folder, home, symlinks=True)


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
