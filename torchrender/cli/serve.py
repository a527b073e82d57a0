"""The commands ``torchrender serve`` and ``torchrender load-test``: the service, and how it holds up."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.output import make_folder
from torchrender.errors import OptionError, SceneFileError, TorchRenderError

if TYPE_CHECKING:
    from torchrender.scene.model import Scene
    from torchrender.walkthrough.model import Walkthrough


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
        SceneFileError: it cannot be read, or not be kept.
    """
    import hashlib

    from torchrender.walkthrough.file import read_walkthrough
    from torchrender_service.renderers.uploads.any_scene import load_any
    from torchrender_service.scenes.folder import read_facts

    if path.suffix.lower() == ".trw":
        shown: Scene | Walkthrough = read_walkthrough(path)
        flat, key = False, b"trw" + path.read_bytes()
    else:
        if not path.is_file():
            raise SceneFileError(path, "no such file")
        shown = load_any(path)
        flat = shown.camera(width=64, height=36).orthographic
        where = path.resolve()
        key = f"{where}\0{where.stat().st_mtime_ns}\0{where.stat().st_size}".encode(errors="surrogateescape")
    home = data / "scenes" / hashlib.sha256(key).hexdigest()
    if read_facts(home) is None:  # not there, or left by a disk that was full
        make_folder(home.parent)
        try:
            _make(home, path, shown)
        except (OSError, TorchRenderError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise SceneFileError(path, f"cannot be kept in {home.parent} ({reason or error})") from error
    return home.name, flat


def _make(home: Path, path: Path, shown: Scene | Walkthrough) -> None:
    """Make the folder of a scene under another name, and put it in place when it is whole."""
    import shutil
    import tempfile

    from torchrender.scene.model import Scene
    from torchrender.walkthrough.export import write_scene
    from torchrender_service.renderers.scene_cache import describe
    from torchrender_service.renderers.uploads.any_scene import load_any
    from torchrender_service.scenes.folder import LINK, UNFINISHED, finish

    with tempfile.TemporaryDirectory(dir=home.parent, prefix=UNFINISHED, ignore_cleanup_errors=True) as name:
        folder = Path(name)
        if isinstance(shown, Scene):
            kind = path.suffix.lower()[1:]
            more = {"kind": kind if kind in ("glb", "toml") else "zip", "bytes": path.stat().st_size}
            more["main"] = f"{LINK}/{path.resolve().name}"
            (folder / LINK).symlink_to(path.resolve().parent, target_is_directory=True)
        else:
            file = write_scene(folder, shown)
            more = {"kind": "toml", "bytes": file.stat().st_size}
            shown = load_any(file)
        facts = describe(shown)
        facts.pop("orthographic")
        if home.exists():
            shutil.rmtree(home)
        finish(folder, facts | {"id": home.name, "built_in": False, "name": path.stem} | more, home)


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
