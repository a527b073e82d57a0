"""Settings, negotiation, metrics, logs and kept containers."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import subprocess
import sys

import pytest

from torchrender.errors import OptionError
from torchrender_service.errors import ServiceError
from torchrender_service.imports import lasting_imports
from torchrender_service.logs import JsonLines
from torchrender_service.metrics import Metrics
from torchrender_service.settings import read_settings
from torchrender_service.web.kept import KeptContainers
from torchrender_service.web.negotiation import negotiate

OFFERED = ["image/png", "image/x-exr", "application/x-npz"]


def test_settings_come_from_file_then_environment_then_arguments(tmp_path):
    file = tmp_path / "service.toml"
    file.write_text('port = 1111\nmax_views = 3\nbuilt_in = ["city"]\nstall_s = 4\n')
    environment = {"TORCHRENDER_PORT": "2222", "TORCHRENDER_ALLOWED_ORIGINS": "http://a, http://b"}
    settings = read_settings(file, environment, max_views=5)
    assert (settings.port, settings.max_views, settings.stall_s) == (2222, 5, 4.0)
    assert settings.built_in == ("city",)
    assert settings.allowed_origins == ("http://a", "http://b")
    assert read_settings(None, {"TORCHRENDER_CONFIG": str(file)}).port == 1111


@pytest.mark.parametrize(
    ("text", "environment", "reason"),
    [
        ("prot = 1", {}, "unknown field"),
        ("port = 70000", {}, "port"),
        ('port = "x"', {}, "port"),
        ("port = ", {}, "cannot be read"),
        ("", {"TORCHRENDER_MAX_VIEWS": "many"}, "max_views"),
        ("", {"TORCHRENDER_STALL_S": "nan"}, "stall_s"),
        ('built_in = ["castle"]', {}, "castle"),
        ('api_key = "short"', {}, "api_key"),
    ],
)
def test_settings_that_mean_nothing_are_refused(tmp_path, text, environment, reason):
    file = tmp_path / "service.toml"
    file.write_text(text)
    with pytest.raises(OptionError, match=reason):
        read_settings(file, environment)


def test_other_addresses_than_loopback_need_a_key():
    for host in ("0.0.0.0", "::", "192.168.1.4", "example.org"):
        with pytest.raises(OptionError, match="TORCHRENDER_API_KEY"):
            read_settings(None, {}, host=host)
        assert not read_settings(None, {"TORCHRENDER_API_KEY": "k" * 16}, host=host).loopback
    for host in ("127.0.0.1", "127.8.8.8", "::1", "localhost"):
        assert read_settings(None, {}, host=host).loopback


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, "image/png"),
        ("", "image/png"),
        ("*/*", "image/png"),
        ("image/x-exr", "image/x-exr"),
        ("application/*", "application/x-npz"),
        ("image/png;q=0.5, image/x-exr", "image/x-exr"),
        ("image/*;q=0.2, application/x-npz;q=0.9", "application/x-npz"),
        ("*/*, image/png;q=0", "image/x-exr"),
        ("text/html, image/x-exr; Q=1", "image/x-exr"),
    ],
)
def test_negotiation(accept, chosen):
    assert negotiate(accept, OFFERED) == chosen


@pytest.mark.parametrize("accept", ["text/html", "image/png;q=0", ";;,,", "image/png;q=nan", "image/png;q=x"])
def test_nothing_acceptable(accept):
    with pytest.raises(ServiceError) as caught:
        negotiate(accept, OFFERED)
    assert caught.value.status == 406


def test_metrics_are_in_the_format_of_prometheus():
    metrics = Metrics()
    metrics.count("keyframes", kind="still")
    metrics.count("keyframes", 2, kind='a"b\\')
    metrics.observe("job_seconds", 0.03, kind="Render")
    metrics.observe("job_seconds", 99.0, kind="Render")
    lines = metrics.text({"streams": 3}).splitlines()
    assert "torchrender_streams 3" in lines
    assert 'torchrender_keyframes_total{kind="still"} 1' in lines
    assert 'torchrender_keyframes_total{kind="a\\"b\\\\"} 2' in lines
    assert 'torchrender_job_seconds_bucket{kind="Render",le="0.05"} 1' in lines
    assert 'torchrender_job_seconds_bucket{kind="Render",le="+Inf"} 2' in lines
    assert 'torchrender_job_seconds_count{kind="Render"} 2' in lines


def test_logs_are_json_without_secrets():
    record = logging.LogRecord("service", logging.INFO, "f", 1, "Authorization: Bearer %s", ("s3cr3t-key",), None)
    record.session = "bearer.abcDEF_123-x"
    line = JsonLines().format(record)
    values = json.loads(line)
    assert values["message"] == "Authorization: Bearer ***"
    assert "s3cr3t" not in line and "abcDEF" not in line


WARNS = """
import logging, threading, warnings
from torchrender.errors import ViewWarning
from torchrender_service.logs import heard, hearing, set_up_logs
set_up_logs("warning")
assert heard() == []
for scene in ("room", "room", "box"):
    with hearing(scene):
        for _ in range(2):
            warnings.warn("camera 0 sees 100 % of nothing", ViewWarning)
        with hearing("other"):
            warnings.warn("of another job", ViewWarning)
        aside = threading.Thread(target=warnings.warn, args=("of another thread", ViewWarning))
        aside.start(); aside.join()
        warnings.warn("not ours", DeprecationWarning)
        assert heard() == ["camera 0 sees 100 % of nothing"] and heard(ViewWarning) == [], heard()
"""


def test_warnings_are_lines_of_the_log_and_told_to_whoever_asked() -> None:
    done = subprocess.run([sys.executable, "-c", WARNS], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    assert all(line["logger"] == "torchrender_service.logs" and line["level"] == "warning" for line in lines)
    found = [(line["message"], line.get("scene"), line["kind"]) for line in lines if line["kind"] == "ViewWarning"]
    assert sorted(found, key=str) == sorted([
        ("camera 0 sees 100 % of nothing", "room", "ViewWarning"),
        ("camera 0 sees 100 % of nothing", "box", "ViewWarning"),
        ("of another job", "other", "ViewWarning"),
        ("of another thread", None, "ViewWarning"),
    ], key=str)  # fmt: skip


AHEAD = """
import threading, warnings
from types import SimpleNamespace
from torchrender.errors import NotUsedWarning
from torchrender_service.logs import collecting, heard, hearing, set_up_logs
from torchrender_service.renderers import scene_cache
from torchrender_service.renderers.jobs import SceneSource
set_up_logs("warning")
def load(name):
    warnings.warn(f"{name} holds more", NotUsedWarning)
    return SimpleNamespace(name=name, materials=(), geometry=SimpleNamespace(triangle_count=1))
scene_cache.load = load
cache = scene_cache.SceneCache()
for name in ("room", "box"):
    ahead = threading.Thread(target=cache.ahead(SceneSource(id=name)))
    ahead.start(); ahead.join()
for name in ("box", "room", "new"):
    for told in ([f"{name} holds more"], []):
        with hearing(name):
            cache.get(SceneSource(id=name))
            assert heard() == told, (name, heard())
with hearing("photo"):
    with collecting() as said:
        for _ in range(2):
            warnings.warn("marks overlap", NotUsedWarning)
        warnings.warn("plain", UserWarning)
    assert said == ["marks overlap", "plain"], said
"""


def test_what_is_loaded_ahead_or_collected_is_told_and_logged() -> None:
    """Warnings of a scene reach the first job about it, whoever loaded it, and the log names that scene."""
    done = subprocess.run([sys.executable, "-c", AHEAD], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    found = [(line["message"], line.get("scene")) for line in map(json.loads, done.stderr.splitlines())]
    scenes = [(f"{name} holds more", name) for name in ("room", "box", "new")]
    assert found == [*scenes, ("marks overlap", "photo"), ("plain", "photo")]


async def put_and_get() -> None:
    kept = KeptContainers(10)
    first, second = await kept.put(b"123456"), await kept.put(b"abc")
    assert await kept.put(b"123456") == first
    assert await kept.get(second) == b"abc"
    third = await kept.put(b"ABCDE")
    assert await kept.get(third) == b"ABCDE" and await kept.get(second) == b"abc"
    with pytest.raises(ServiceError, match="dropped"):
        await kept.get(first)
    assert await kept.put(b"x" * 11) and len(kept._kept) == 0


def test_kept_containers_make_room_for_newer_ones():
    asyncio.run(put_and_get())


def test_the_collector_leaves_imports_alone():
    gc.unfreeze()
    try:
        with lasting_imports():
            assert not gc.isenabled()
            made = [[] for _ in range(1000)]
        assert gc.isenabled() and gc.get_freeze_count() >= len(made)
        with pytest.raises(ImportError), lasting_imports():
            raise ImportError
        assert gc.isenabled()
    finally:
        gc.unfreeze()
