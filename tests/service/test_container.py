"""The container: what its recipe copies is there, its health check follows the port, its memory has a limit."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from service_little import little_server

ROOT = Path(__file__).resolve().parents[2]
RECIPE = (ROOT / "docker" / "Dockerfile").read_text()
INSTRUCTIONS = {
    *("FROM", "RUN", "WORKDIR", "COPY", "ENV", "ARG", "USER"),
    *("VOLUME", "EXPOSE", "STOPSIGNAL", "HEALTHCHECK", "CMD"),
}


def steps() -> list[tuple[str, str]]:
    """Instructions of the recipe with what they say, continued lines put together."""
    text = re.sub(r"^\s*#.*\n", "", RECIPE, flags=re.MULTILINE).replace("\\\n", " ")
    return [(line.split(None, 1)[0], line.split(None, 1)[1]) for line in text.splitlines() if line.strip()]


def test_every_step_is_an_instruction_and_what_is_copied_is_there() -> None:
    assert {name for name, _ in steps()} <= INSTRUCTIONS
    assert steps()[0][0] == "FROM"
    for name, said in steps():
        if name == "COPY":
            *sources, _ = said.split()
            assert all((ROOT / source).exists() for source in sources), said
    names = [name for name, _ in steps()]
    assert names.index("USER") < names.index("CMD"), "the service does not run as root"


def test_the_health_check_follows_the_port(tmp_path: Path) -> None:
    check = next(said for name, said in steps() if name == "HEALTHCHECK")
    program, *rest = json.loads(check[check.index("CMD") + 3 :])
    assert program == "python"
    with little_server(tmp_path) as server:
        port = server.address.rpartition(":")[2]
        for given, good in ((port, True), ("1", False)):
            environment = {**os.environ, "TORCHRENDER_PORT": given}
            done = subprocess.run([sys.executable, *rest], env=environment, capture_output=True, timeout=60)
            assert (done.returncode == 0) is good


def test_the_memory_of_the_container_is_limited_from_outside() -> None:
    yaml = pytest.importorskip("yaml")
    service = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())["services"]["torchrender"]
    assert service["mem_limit"] == "${TORCHRENDER_MEMORY:-0}"
    port = service["environment"]["TORCHRENDER_PORT"]
    assert service["ports"] == [f"127.0.0.1:{port}:{port}"]
    assert service["read_only"] and service["cap_drop"] == ["ALL"]


@pytest.mark.skipif(shutil.which("hadolint") is None, reason="needs hadolint")
def test_the_recipe_has_no_faults() -> None:
    done = subprocess.run(["hadolint", "--ignore", "DL3008", str(ROOT / "docker" / "Dockerfile")], capture_output=True)
    assert done.returncode == 0, done.stdout
