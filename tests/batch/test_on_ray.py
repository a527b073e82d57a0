"""The same batch on a Ray cluster of this machine: nothing is lost or doubled when an actor or the driver is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from torchrender.batch import Job, SceneSource
from torchrender.batch.folder import LOCK
from torchrender.batch.job import MANIFEST
from torchrender.batch.work import ChunkMaker
from torchrender.errors import MissingExtraError
from torchrender.scene.cameras.path import built_in_path

SOURCE = SceneSource("city", {"size": 2000})
ROOT = Path(__file__).resolve().parents[2]
CODE = """
import sys
sys.path.insert(0, {folder!r})
from test_on_ray import job
from torchrender.batch.on_ray import run_on_ray
print(run_on_ray(job(), sys.argv[1], workers=2))
"""


def job() -> Job:
    scene = SOURCE.load()
    cameras = built_in_path(scene, "orbit").cameras(24, width=160, height=120, near=0.1)
    return Job(SOURCE, cameras, chunk=2, wishes={"supersample": 2})


def start(out: Path) -> subprocess.Popen[str]:
    code = CODE.format(folder=str(Path(__file__).parent))
    return subprocess.Popen([sys.executable, "-c", code, str(out)], cwd=ROOT, stdout=subprocess.PIPE, text=True)


def noted(out: Path) -> list[int]:
    try:
        return [json.loads(line)["chunk"] for line in (out / MANIFEST).read_text().splitlines()]
    except FileNotFoundError:
        return []


def wait_for(what, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.05)


def actors() -> list[int]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if (folder / "cmdline").read_bytes().startswith(b"ray::MapWorker"):
                found.append(int(folder.name))
        except OSError:
            continue
    return found


def test_without_ray_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from torchrender import extras
    from torchrender.batch.on_ray import run_on_ray

    monkeypatch.setattr(extras, "_there", lambda name: name != "ray")
    with pytest.raises(MissingExtraError, match=r"torchrender\[ray\]"):
        run_on_ray(job(), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed")
@pytest.mark.skipif(not Path("/proc").exists(), reason="looks for processes as Linux shows them")
def test_killed_actors_and_a_killed_driver_lose_and_double_nothing(tmp_path: Path) -> None:
    out = tmp_path / "out"
    driver = start(out)
    wait_for(lambda: len(noted(out)) >= 2)
    os.kill(actors()[0], signal.SIGKILL)
    wait_for(lambda: len(noted(out)) >= 5)
    driver.kill()
    driver.communicate()
    before = noted(out)
    again = start(out)
    said = again.communicate(timeout=200)[0]
    assert f"cameras=24, made={24 - 2 * len(before)}, failed={{}}" in said
    assert sorted(noted(out)) == list(range(12))
    scene = SOURCE.load()
    for name, data in ChunkMaker(scene, job(), out).contents(7):
        assert (out / name).read_bytes() == data
    assert len(list(out.glob("*.png"))) == 24 and {one.name for one in out.glob(".*")} <= {LOCK}
