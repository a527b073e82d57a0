"""Without the packages of an extra: one error that says which one to install, and the rest goes on working."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from torchrender.extras import CLIENT, EXTRAS

ROOT = Path(__file__).resolve().parent.parent
HIDE = """
import sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {hidden!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Hidden())
"""


def run_without(hidden: tuple[str, ...], code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own to which some packages are not there."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "service")])}
    command = [sys.executable, "-c", HIDE.format(hidden=hidden) + code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)


def error_of(hidden: tuple[str, ...], statement: str) -> str:
    """What the only error that a statement may raise says."""
    code = f"""
from torchrender.errors import MissingExtraError, TorchRenderError
try:
    {statement}
except MissingExtraError as error:
    assert isinstance(error, (TorchRenderError, ImportError)) and error.__context__ is None
    print(error)
"""
    done = run_without(hidden, code)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    "module",
    ["torchrender.client", "torchrender.client.drawing", "torchrender.wire.codec", "torchrender.wire.messages"],
)
def test_the_client_names_its_extra(module: str) -> None:
    said = error_of(CLIENT, f"import {module}")
    assert said.endswith('needs msgspec, simplejpeg, websockets, zstandard: pip install "torchrender[client]"')


@pytest.mark.parametrize("package", CLIENT)
def test_every_package_that_is_missing_alone_is_named(package: str) -> None:
    assert f'needs {package}: pip install "torchrender[client]"' in error_of((package,), "import torchrender.client")


def test_the_client_works_without_the_server() -> None:
    server = tuple(name for name in EXTRAS["service"] if name not in CLIENT)
    done = run_without(
        (*server, "starlette", "pydantic"), "import torchrender.client; print(torchrender.client.StreamClient)"
    )
    assert "StreamClient" in done.stdout, done.stderr


@pytest.mark.parametrize("command", [["serve"], ["load-test"]])
def test_commands_of_the_service_say_it_in_one_line(command: list[str]) -> None:
    code = f"from torchrender.cli.main import main; sys.exit(main({command!r}))"
    done = run_without(("fastapi", "uvicorn"), code)
    assert done.returncode == 2
    expected = 'torchrender: error: the service needs fastapi, uvicorn: pip install "torchrender[service]"\n'
    assert done.stderr == expected and not done.stdout


def test_the_rest_needs_no_extra() -> None:
    code = (
        "from torchrender.cli.main import main; main(['scenes']); import torchrender.renderer, torchrender.scene.load"
    )
    done = run_without(EXTRAS["service"], code)
    assert done.returncode == 0 and "cornell_box" in done.stdout, done.stderr


def test_the_extras_are_those_of_the_project_file() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    for extra, packages in EXTRAS.items():
        block = re.search(rf"^{extra} = \[(.*?)^\]", text, re.DOTALL | re.MULTILINE)
        assert block is not None
        named = set(re.findall(r'"([a-z]+)(?:\[[a-z,]+\])?>=', block[1]))
        if '"torchrender[client]"' in block[1]:
            named |= set(CLIENT)
        assert named == set(packages)
