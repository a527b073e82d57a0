"""What the README shows of the service works as printed: with another address, and small pictures of a small scene."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from service_server import RunningServer
from torchrender_service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
HEADING = "## Service\n"
ADDRESS = "http://127.0.0.1:8000"


def section() -> str:
    return (ROOT / "README.md").read_text().split(HEADING)[1].split("\n## ")[0]


def adapted(text: str, server: RunningServer) -> str:
    sizes = {"640": "64", "360": "36", "320": "64", "180": "36"}
    text = re.sub(r"\b(640|360|320|180)\b", lambda found: sizes[found[1]], text)
    return text.replace(ADDRESS, server.url).replace("living_room", "cornell_box")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", section(), re.DOTALL)


@pytest.mark.skipif(shutil.which("curl") is None or shutil.which("bash") is None, reason="needs curl and bash")
def test_the_commands_work_in_turn(server: RunningServer, tmp_path: Path) -> None:
    script = "\n".join(blocks("bash"))
    assert script.count("curl ") >= 6
    script = "set -e\n" + adapted(script, server).replace("curl -s", "curl --fail-with-body -sS")
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("room.png", "moved.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "room.trdi").read_bytes().startswith(b"TRDI")


def test_the_python_example_runs(server: RunningServer) -> None:
    (example,) = blocks("python")
    names: dict[str, object] = {}
    exec(compile(adapted(example, server), "README.md", "exec"), names)
    assert names["depth"].shape[0] == 3  # type: ignore[attr-defined]
    assert names["picture"].shape == (1, 36, 64, 3)  # type: ignore[attr-defined]


def test_the_script_of_the_documentation_runs(server: RunningServer, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["stream.py", server.url, "36"])
    runpy.run_path(str(ROOT / "docs" / "examples" / "stream.py"), run_name="__main__")
    told = capsys.readouterr().out.splitlines()
    known = [float(line.split(", ")[1].split("%")[0]) for line in told]
    assert len(known) == 3 and min(known) > 80


def test_every_setting_that_is_named_exists() -> None:
    named = re.findall(r"`TORCHRENDER_([A-Z_]+)`", section())
    assert named and {name.lower() for name in named} <= set(Settings.__struct_fields__)
