"""What is installed: two packages and no other name, with all their files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
HOMES = {"torchrender": ROOT / "torchrender", "torchrender_service": ROOT / "service" / "torchrender_service"}
OLDEST_SETUPTOOLS = 77
BUILD = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"


def _junk(folder: str, names: list[str]) -> list[str]:
    del folder
    return [name for name in names if name == "__pycache__" or name.startswith(".") or name.endswith(".egg-info")]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that no earlier build's files get into it and none are left behind."""
    try:
        found = version("setuptools")
    except PackageNotFoundError:
        found = "0"
    if int(found.partition(".")[0]) < OLDEST_SETUPTOOLS:
        pytest.skip(f"setuptools {found} is older than {OLDEST_SETUPTOOLS}, which pyproject.toml asks for")
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("built")
    for name in ("torchrender", "service"):
        shutil.copytree(ROOT / name, source / name, ignore=_junk)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    command = [sys.executable, "-c", BUILD, str(built)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    (path,) = built.glob("*.whl")
    return path


def test_a_wheel_holds_both_packages_whole_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        inside = {name for name in archive.namelist() if ".dist-info/" not in name}
        (entry,) = (name for name in archive.namelist() if name.endswith("dist-info/entry_points.txt"))
        assert b"torchrender = torchrender.cli.__main__:run" in archive.read(entry)
    assert {name.partition("/")[0] for name in inside} == set(HOMES)
    expected = {
        f"{name}/{path.relative_to(home).as_posix()}"
        for name, home in HOMES.items()
        for path in home.rglob("*")
        if path.is_file() and not any(part == "__pycache__" or part[0] == "." for part in path.relative_to(home).parts)
    }
    assert inside == expected
    needed = ("torchrender/py.typed", "torchrender/data/curves.json", "torchrender/wire/messages.py")
    served = ("PROTOCOL.md", "static/index.html", "static/js/warp.js", "static/vendor/three/three.module.min.js")
    assert {*needed, *(f"torchrender_service/{name}" for name in served)} <= inside


def test_what_is_installed_finds_its_files(wheel: Path, tmp_path: Path) -> None:
    """Without the source tree: the page, the curves, and the command line."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    code = """
import sys
from importlib.metadata import version
import torchrender, torchrender_service
from torchrender.cli.main import main
from torchrender.planning.curves import load_curves
from torchrender_service.settings import read_settings
from torchrender_service.web.app import STATIC, make_app
assert all(module.__file__.startswith(sys.argv[1]) for module in (torchrender, torchrender_service))
assert version("torchrender") == torchrender.__version__
assert load_curves().scenes
assert (STATIC / "index.html").is_file()
assert any(getattr(route, "name", "") == "client" for route in make_app(read_settings()).routes)
main(["scenes"])
"""
    site = str(tmp_path / "site")
    environment = {k: v for k, v in os.environ.items() if not k.startswith("TORCHRENDER_")} | {"PYTHONPATH": site}
    command = [sys.executable, "-c", code, site]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "cornell_box" in done.stdout, done.stderr
