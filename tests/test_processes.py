"""Errors and results travel between processes, and workers start the way that the documentation says."""

from __future__ import annotations

import importlib
import os
import pickle
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch

import torchrender as tr
from torchrender.errors import (
    ForkError,
    ImageFileError,
    MissingExtraError,
    PointFileError,
    SceneFileError,
    TorchRenderError,
)
from torchrender_service.errors import ServiceError

ROOT = Path(__file__).resolve().parent.parent


def every_error() -> list[type[TorchRenderError]]:
    for package in ("torchrender.wire", "torchrender.client", "torchrender"):
        for module in pkgutil.iter_modules(importlib.import_module(package).__path__, package + "."):
            if module.name.rpartition(".")[2] in ("errors", "session"):
                importlib.import_module(module.name)
    found, waiting = [], [TorchRenderError]
    while waiting:
        kind = waiting.pop()
        found.append(kind)
        waiting += kind.__subclasses__()
    return [k for k in found if k.__module__.startswith("torchrender.")]


MADE: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
    "SceneFileError": (("a/b.glb", "damaged"), {"key": "meshes[0]"}),
    "ImageFileError": (("a.png", "cut off"), {}),
    "PointFileError": (("a.trp", "cut off"), {}),
    "MissingExtraError": (("client", "streams", ["websockets"]), {}),
}


@pytest.mark.parametrize("kind", every_error(), ids=lambda k: k.__name__)
def test_every_error_comes_back_as_it_was(kind: type[TorchRenderError]) -> None:
    arguments, more = MADE.get(kind.__name__, (("what happened",), {}))
    try:
        before = kind(*arguments, **more)
    except TypeError:  # kinds with other arguments
        before = kind("first", "second")
    after = pickle.loads(pickle.dumps(before))
    assert type(after) is kind and str(after) == str(before)
    for name, value in vars(before).items():
        assert getattr(after, name) == value, name


def test_names_of_files_and_keys_come_back() -> None:
    for kind in (SceneFileError, ImageFileError, PointFileError):
        after = pickle.loads(pickle.dumps(kind("a/b.glb", "damaged", key="nodes[3]")))
        assert (after.path, after.key, after.reason) == (Path("a/b.glb"), "nodes[3]", "damaged")
    assert pickle.loads(pickle.dumps(MissingExtraError("client", "streams", ["x"]))).missing == ("x",)


def results() -> dict[str, Any]:
    scene = tr.load("cornell_box", size=100)
    camera = scene.camera(width=16, height=12)
    picture = tr.render(scene, camera)
    grid = tr.make_grid(scene.bounds[None], 8)
    return {
        "scene": scene,
        "image": picture,
        "plan": picture.plan,
        "cameras": camera,
        "caster": tr.RayCaster(scene.geometry),
        "depth": tr.sample_depth_images(scene, camera),
        "grid": grid,
        "voxels": tr.voxelize_scene(scene, grid),
        "points": tr.load_points("cornell_box", samples=100),
        "report": scene.report,
    }


def same(first: Any, second: Any) -> bool:
    """The same values, tensor by tensor."""
    if isinstance(first, torch.Tensor):
        return torch.equal(torch.nan_to_num(first), torch.nan_to_num(second))
    if isinstance(first, dict):
        return set(first) == set(second) and all(same(first[k], second[k]) for k in first)
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(same(a, b) for a, b in zip(first, second, strict=True))
    if hasattr(first, "__dataclass_fields__"):
        return all(same(getattr(first, n), getattr(second, n)) for n in first.__dataclass_fields__)
    return True


def test_results_come_back_as_they_were() -> None:
    for name, before in results().items():
        after = pickle.loads(pickle.dumps(before))
        assert type(after) is type(before) and same(before, after), name


def test_a_ray_caster_that_came_back_casts_the_same() -> None:
    caster = tr.RayCaster(tr.load("cornell_box", size=100).geometry)
    origins = torch.tensor([[0.1, 0.2, 0.3], [0.0, 1.0, 2.0]]) * caster.geometry.bounds.norm().float()
    directions = torch.tensor([[1.0, 0.1, -2.0], [0.0, -1.0, 0.2]])
    first, second = (c.first_hit(origins, directions) for c in (caster, pickle.loads(pickle.dumps(caster))))
    assert torch.equal(first.t, second.t) and torch.equal(first.triangle, second.triangle)


FORK = """
import multiprocessing, torchrender as tr
from torchrender.errors import ForkError

def work(answers):
    try:
        scene = tr.load("cornell_box")
        tr.render(scene, scene.camera(width=16, height=16))
        answers.put("rendered")
    except ForkError as error:
        answers.put(f"ForkError {error}")

scene = tr.load("cornell_box")
tr.render(scene, scene.camera(width=16, height=16))
context = multiprocessing.get_context("fork")
answers = context.Queue()
worker = context.Process(target=work, args=(answers,))
worker.start()
print(answers.get(timeout=100))
worker.join(10)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system knows no fork")
def test_a_fork_after_a_picture_is_refused_in_words() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORK], cwd=ROOT, capture_output=True, text=True, timeout=200
    )
    assert re.search("ForkError.*by spawn.*DataLoader", done.stdout), done.stdout + done.stderr
    assert issubclass(ForkError, RuntimeError)


def test_an_error_of_the_service_comes_back() -> None:
    before = ServiceError(429, "busy", "too many", retry_after_s=5.0)
    after = pickle.loads(pickle.dumps(before))
    assert vars(after) == vars(before) and str(after) == "too many"


def test_the_documented_data_loader_works(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "workers.md").read_text(), re.DOTALL)
    (tmp_path / "turntable.py").write_text(blocks[0])
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(tmp_path / "turntable.py")],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=250,
    )  # fmt: skip
    assert done.stdout.split("\n")[:2] == ["(2, 64, 64, 3)"] * 2, done.stderr
