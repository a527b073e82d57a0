"""The service on Ray Serve, as far as no cluster is needed; streams over replicas: tests/report/distributed."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from torchrender.errors import OptionError

ROOT = Path(__file__).resolve().parents[2]


def test_nothing_but_its_own_modules_imports_ray() -> None:
    found = set()
    for path in [*(ROOT / "torchrender").rglob("*.py"), *(ROOT / "service").rglob("*.py")]:
        for node in ast.parse(path.read_text()).body:  # imports within functions happen when they are called
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.split(".")[0] in ("ray", "simpy", "fsspec") for name in names):
                found.add(path.name)
    assert found == {"ray_app.py", "ray_directory.py", "ray_local.py", "simulation.py"}


@pytest.fixture
def ray_app() -> Any:
    pytest.importorskip("ray.serve")
    from torchrender_service import ray_app

    return ray_app


def test_replicas_share_a_machine(ray_app: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(ray_app.os, "cpu_count", lambda: 8)
    monkeypatch.setattr(ray_app, "memory_of_host_mb", lambda: 32_000)
    options = ray_app.options_of({"num_replicas": "2", "data_dir": "x"})
    assert options.cpus == 4.0
    settings = ray_app.settings_of({"data_dir": str(tmp_path), "built_in": "city,nest"}, options)
    assert (settings.threads, settings.renderers, settings.built_in) == (4, 1, ("city", "nest"))
    assert settings.renderer_memory_mb == 4_000, "of three quarters its half, among three processes"
    assert settings.shared_storage == str(tmp_path / "shared") and settings.data_dir == str(tmp_path / "replicas")
    small = ray_app.settings_of({"shared_storage": "s3://b/p"}, ray_app.options_of({"num_cpus": 0.5}))
    assert (small.threads, small.renderers, small.shared_storage) == (1, 1, "s3://b/p")
    names = ray_app.thread_variables(3)
    assert names["OMP_NUM_THREADS"] == names["NUMBA_NUM_THREADS"] == "3" and len(names) == 7


def test_wrong_arguments_are_named(ray_app: Any) -> None:
    for given, message in (
        ({"num_replicas": 0}, "at least one replica"),
        ({"num_replicas": 3, "max_replicas": 2}, "num_replicas 3"),
        ({"num_cpus": "many"}, "num_cpus"),
        ({"queue_wait_s": 0.0}, "queue_wait_s"),
        ({"num_replica": 2}, "num_replica"),
        ({"max_sessions": 0}, "max_sessions"),
    ):
        with pytest.raises(OptionError, match=message):
            ray_app.application(given)


def test_replicas_follow_the_wait_for_a_renderer(ray_app: Any) -> None:
    wanted = ray_app.wanted_replicas
    assert [wanted(4, wait, 0.2) for wait in (0.25, 0.3, 9.0, 0.1, 0.01)] == [5, 6, 8, 4, 3]
    assert wanted(1, 0.0, 0.2) == 1
    policy = ray_app.QueueWaitPolicy(queue_wait_s=0.2)
    for waits, count in (({"a": 0.5, "b": 0.1}, 3), ({}, 2), (None, 2)):
        metrics = None if waits is None else {ray_app.QUEUE_WAIT: waits}
        assert policy(SimpleNamespace(current_num_replicas=2, aggregated_metrics=metrics))[0] == count


def test_waits_are_those_since_the_last_look_without_large_pictures(ray_app: Any) -> None:
    from torchrender_service.metrics import Metrics

    metrics = Metrics({"replica": "a"})
    waits = ray_app.Waits(metrics)
    metrics.observe("queue_wait_seconds", 0.5, rank="stream")
    metrics.observe("queue_wait_seconds", 0.1, rank="interactive")
    metrics.observe("queue_wait_seconds", 60.0, rank="batch")
    assert waits.mean_s() == pytest.approx(0.3)
    assert waits.mean_s() == 0.0
    metrics.observe("queue_wait_seconds", 0.2, rank="stream")
    assert waits.mean_s() == pytest.approx(0.2)
    assert 'torchrender_queue_wait_seconds_count{rank="batch",replica="a"} 1' in metrics.text({})
    assert 'torchrender_jobs{replica="a"} 3' in metrics.text({"jobs": 3})


def test_a_replica_has_a_folder_alone_and_removes_what_killed_ones_left(ray_app: Any, tmp_path: Path) -> None:
    left = tmp_path / "killed"
    left.mkdir()
    (left / "scene").write_text("")
    first = ray_app.OwnHome(tmp_path, "first")
    second = ray_app.OwnHome(tmp_path, "second")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["first", "second"]
    first.give_up()
    assert not first.folder.exists() and second.folder.exists()
    second.give_up()


def test_the_file_for_serve_has_arguments_that_exist(ray_app: Any) -> None:
    text = (ROOT / "docker" / "ray-serve.yaml").read_text()
    yaml = pytest.importorskip("yaml")
    (app,) = yaml.safe_load(text)["applications"]
    module, _, name = app["import_path"].partition(":")
    assert (module, getattr(ray_app, name)) == (ray_app.__name__, ray_app.application)
    assert json.dumps(app["args"]) and ray_app.application(app["args"]) is not None
