"""The study of many processes: its rows and pages from records, and with Ray the smallest real one."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from torchrender.errors import OptionError, TorchRenderError

pytest.importorskip("simpy")

from torchrender.report.distributed import cluster, study, watching
from torchrender.report.distributed.batches import Clock, killed_rows, local_rows, ray_rows
from torchrender.report.distributed.cluster import HAPROXY, HAPROXY_FILE, cpu_s, proxied
from torchrender.report.distributed.reckoning import Costs, check_rows, costs_of, predicted, prices
from torchrender.report.distributed.stream_rows import lost_rows, stream_rows
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of
from torchrender.wire.messages import Pose, decode
from torchrender_service.load_test.driver import LoadClient
from torchrender_service.renderers.keyframes import Stamp, first_message

LEISURE = {
    "sessions": 1,
    "period_s": 0.25,
    "keyframes_per_s": 4.0,
    "latency_ms": [60.0, 80.0],
    "render_ms": [50.0, 5.0],
    "keyframe_bytes": 8000.0,
    "renderer_cpu_s": 0.2,
    "other_cpu_s": 0.04,
}
BUSY = {**LEISURE, "sessions": 8, "period_s": 0.02, "keyframes_per_s": 2 / 0.06, "latency_ms": [240.0, 260.0]}
HALF = {**LEISURE, "sessions": 8, "period_s": 1.0, "keyframes_per_s": 8.0}
STANDING = {**LEISURE, "sessions": 2, "period_s": 1 / 30, "other_cpu_s": 0.0}
SIDE = {
    "idle_cpu_s": 0.0,
    "health_ms": [1.0, 2.0],
    "memory_mb": 900.0,
    "standing": STANDING,
    "leisure": LEISURE,
    "alone": LEISURE,
    "busy": BUSY,
    "half": HALF,
}
STREAMS = {
    "server": SIDE,
    "replicas": {
        **SIDE,
        "opened": {"asked": 100, "refused": 0, "why": [], "s": 9.0},
        "compressed": {"deflate": True},
        "upload_s": 0.2,
    },
    "lost": {
        "killed": {"clients": 4, "lost": 2, "back_s": [0.5, 0.9], "p95_ms": [60.0, 70.0]},
        "scaled": {"clients": 8, "told": [["the server is stopping", 1012, 0.4]] * 3},
    },
}


def marks(rows: list) -> list[bool | None]:
    return [row.met for row in rows]


def test_rows_say_what_was_met() -> None:
    assert all(met is not False for met in marks([*stream_rows(STREAMS), *lost_rows(STREAMS)]))
    worse = json.loads(json.dumps(STREAMS))
    worse["haproxy"] = json.loads(json.dumps(worse["replicas"])) | {"health_ms": [3.0, 4.0]}
    assert [row.what for row in stream_rows(worse, "haproxy") if row.met is False] == [
        "/health, nothing else to do, p50 (p99)"
    ]
    worse["replicas"]["opened"] |= {"refused": 5, "why": ["InvalidStatus"]}
    worse["lost"]["killed"]["back_s"] = [0.5]
    worse["lost"]["scaled"]["told"][0][1] = None
    worse["replicas"]["busy"]["keyframes_per_s"] = 10.0
    rows = [*stream_rows(worse), *lost_rows(worse)]
    missed = [row.what for row in rows if row.met is False]
    assert len(missed) == 4 and "5 refused (InvalidStatus)" in " ".join(row.measured for row in rows)
    workers = {"1": {"rate": 1.5, "cores": 1.6}, "2": {"rate": 2.6, "cores": 2.0}}
    rows = local_rows({"batch": {"workers": workers, "same": True}})
    assert marks(rows) == [True, True] and "1.60 and 2.00 cores busy" in rows[0].measured
    slower = {**workers, "2": {"rate": 2.0, "cores": 2.0}}
    assert marks(local_rows({"batch": {"workers": slower, "same": False}})) == [False, False]
    pool, late = {"rate": 2.0, "first_s": 3.0, "start_s": 1.0}, {"rate": 1.7, "first_s": 25.0, "start_s": 21.0}
    assert marks(ray_rows({"ray-batch": {"pool": pool, "ray": late, "same": True}})) == [False, False, True]
    killed = {"worker": {"before": 3, "chunks": 12, "twice": 0, "same": True},
              "driver": {"before": 3, "chunks": 12, "twice": 1, "same": True}}  # fmt: skip
    lost = killed_rows({"killed": {"chunks": 12, "killed": killed}})
    assert marks(lost) == [True, False] and "1 lost, 1 doubled" in lost[1].measured


def test_the_simulation_is_checked_against_what_was_measured() -> None:
    costs = costs_of(SIDE)
    assert costs == Costs(render_s=0.05, spread=0.1, carry_s=0.01)
    told = {**SIDE, "idle_cpu_s": 0.012, "standing": {**STANDING, "other_cpu_s": 0.072}}
    assert costs_of(told) == Costs(
        render_s=0.05, spread=0.1, carry_s=pytest.approx(0.006), tell_s=pytest.approx(0.001), always_s=0.012
    )
    assert predicted(costs, BUSY, 20.0).keyframes_per_s == pytest.approx(2 / 0.06, rel=0.05)
    assert marks(check_rows(STREAMS)) == [True, True]
    off = json.loads(json.dumps(STREAMS))
    off["replicas"]["busy"]["keyframes_per_s"] = 50.0
    assert marks(check_rows(off)) == [False, True]


def test_prices_follow_from_cores_and_bytes() -> None:
    found = prices(Costs(render_s=0.09, spread=0.0, carry_s=0.01), keyframes_per_s=1.0, keyframe_bytes=1e5,
                   pictures_per_core_s=1.0)  # fmt: skip
    assert found["cores"] == pytest.approx(0.1)
    assert found["session_hour"] == pytest.approx(0.1 * 0.04 + 0.36 * 0.05)
    assert found["pictures_1000"] == pytest.approx(1000 / 3600 * 0.04)


def test_parts_are_kept_until_they_are_measured_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OptionError, match="part must be one of batch"):
        study.run(tmp_path, True, ["nothing"])
    for name in ("server", "replicas"):
        monkeypatch.setitem(study.PARTS, name, lambda *_, name=name: STREAMS[name])
    study.run(tmp_path, True, ["server", "replicas"])
    monkeypatch.setitem(study.PARTS, "server", lambda *_: pytest.fail())
    workers = {"1": {"rate": 1.0, "cores": 1.5}, "2": {"rate": 1.9, "cores": 2.0}}
    monkeypatch.setitem(study.PARTS, "batch", lambda *_: {"workers": workers, "same": True})
    _, page = study.run(tmp_path, True, ["batch"])
    text = page.read_text()
    assert "## Streams over two replicas" in text and "1.90×" in text and "## Batches by Ray Data" not in text
    study.run(tmp_path, True, ["many"])
    text = page.read_text()
    assert "1,000 sessions" in text and "first full: " in text and "on a ring by their scene" in text
    assert "1,000 pictures of the batch above |  | 0.0117 $" in text
    (tmp_path / "distributed.json").unlink()
    with pytest.raises(OptionError, match="replicas must be measured first"):
        study.run(tmp_path, True, ["many"])


def test_keyframes_are_counted_and_not_the_poses_that_they_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A client that sends more poses than it gets keyframes: others are overtaken."""

    class Socket:
        def __init__(self) -> None:
            self.newest: asyncio.Queue[int] = asyncio.Queue()

        async def send(self, data: bytes) -> None:
            if isinstance(message := decode(data).message, Pose):
                self.newest.put_nowait(message.seq)

        async def recv(self) -> bytes:
            await asyncio.sleep(0.2)  # as long as a keyframe takes
            number = await self.newest.get()
            while not self.newest.empty():
                number = self.newest.get_nowait()
            stamp = Stamp(id=number, pose=number, layers=1)
            return first_message(stamp, camera, depth, radiance, render_ms=40.0, plan=None)

    @asynccontextmanager
    async def fake(*_: object, **__: object) -> AsyncIterator[LoadClient]:
        welcome: Any = SimpleNamespace(camera=header_of(camera), scene={"diagonal": 1.0})
        yield LoadClient(Socket(), welcome, 0.0)  # type: ignore[arg-type]

    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=64, height=48, fov_deg=50.0)
    depth, radiance = torch.full((48, 64), 3.0), torch.full((48, 64, 3), 0.5)
    monkeypatch.setattr(watching, "client", fake)
    server: Any = SimpleNamespace(pid=os.getpid())
    found = asyncio.run(watching.looking(server, 2, 1.0, period_s=0.02))
    assert 6.0 <= found["keyframes_per_s"] <= 11.0, "two clients, a keyframe each .2 s, and 50 poses a second each"
    assert found["render_ms"] == [40.0, 0.0]


def test_one_proxy_or_the_other(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(HAPROXY, "1")
    monkeypatch.setenv(HAPROXY_FILE, "/there/haproxy")
    assert {HAPROXY, HAPROXY_FILE}.isdisjoint(proxied(False))
    assert proxied(True)[HAPROXY] == "1" and proxied(True)[HAPROXY_FILE] == "/there/haproxy"
    monkeypatch.delenv(HAPROXY_FILE)
    monkeypatch.setattr(cluster, "FOLDERS", ())
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(TorchRenderError, match="HAProxy is not installed"):
        proxied(True)
    measured: list[str] = []
    for name in study.PARTS:
        monkeypatch.setitem(study.PARTS, name, lambda *_, name=name: measured.append(name) or {})
    monkeypatch.setattr(study, "page", lambda _: "")
    study.run(tmp_path, True)
    assert measured == [name for name in study.PARTS if name != "haproxy"]
    (tmp_path / "haproxy").write_text("#!/bin/sh\n")
    (tmp_path / "haproxy").chmod(0o755)
    assert proxied(True)[HAPROXY_FILE] == str(tmp_path / "haproxy")
    study.run(tmp_path, True)
    assert measured[-len(study.PARTS) :] == list(study.PARTS)


@pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed")
@pytest.mark.skipif(not Path("/proc").exists(), reason="looks for processes as Linux shows them")
def test_two_replicas_are_one_service(tmp_path: Path) -> None:
    data, _ = study.run(tmp_path, True, ["replicas", "lost"])
    parts = json.loads(data.read_text())["parts"]
    opened, lost = parts["replicas"]["found"]["opened"], parts["lost"]["found"]
    assert opened["refused"] == 0, opened
    killed, told = lost["killed"], lost["scaled"]["told"]
    assert 0 < killed["lost"] < killed["clients"] and len(killed["back_s"]) >= killed["lost"]
    assert told and all(reason and code == 1012 for reason, code, _ in told)


def test_cores_that_are_busy_are_those_of_all_processes() -> None:
    """Also of those that have ended meanwhile."""
    clock, work = (
        Clock(),
        "end = __import__('time').process_time() + 0.4\nwhile __import__('time').process_time() < end: pass",
    )
    clock(1, 3)
    before = cpu_s(os.getpid())
    running = [subprocess.Popen([sys.executable, "-c", work]) for _ in range(2)]
    for process in running:
        assert process.wait(60) == 0
    used = cpu_s(os.getpid()) - before
    clock(3, 3)
    assert 0.75 < used < 4.0
    first, last = clock.told
    assert (
        clock.cores == pytest.approx((last.cpu_s - first.cpu_s) / (last.at - first.at))
        and last.cpu_s >= first.cpu_s + 0.75
    )
    assert clock.rate == pytest.approx(2 / (last.at - first.at))
