"""Kernels are compiled before the service is ready, and it says how far it is."""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import pytest

from torchrender_service.metrics import Metrics
from torchrender_service.renderers import kernels
from torchrender_service.renderers import pool as pools
from torchrender_service.renderers.kernels import KernelPreparation
from torchrender_service.renderers.pool import Pool
from torchrender_service.settings import read_settings
from torchrender_service.web import routes_status

SLOW = (
    "import json, sys, time\n"
    "for part, total in (('serve.first', 2), ('serve', 3)):\n"
    "    for k in range(total + 1):\n"
    "        print(json.dumps({'part': part, 'done': k, 'total': total}), flush=True); time.sleep(0.2)"
)


def instead(monkeypatch: pytest.MonkeyPatch, code: str) -> list[dict[str, Any]]:
    """Another program than the one that compiles; notes with what it is started."""
    begin, noted = asyncio.create_subprocess_exec, []

    async def start(*command: str, **rest: Any) -> asyncio.subprocess.Process:
        noted.append({"command": command, **rest})
        return await begin(sys.executable, "-c", code, **rest)

    monkeypatch.setattr(kernels.asyncio, "create_subprocess_exec", start)
    return noted


def test_progress_is_told_and_the_key_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORCHRENDER_API_KEY", "a-key-of-enough-letters")
    noted = instead(monkeypatch, SLOW)
    seen = []

    async def watch() -> KernelPreparation:
        preparation = KernelPreparation()
        task = asyncio.create_task(preparation.run())
        while not task.done():
            seen.append((preparation.finished, preparation.text))
            await asyncio.sleep(0.02)
        return preparation

    preparation = asyncio.run(watch())
    assert preparation.finished and preparation.text == ""
    assert (False, "compiling kernels, once: 1 of 2") in seen and seen[0] == (False, "looking for kernels")
    further = (True, "compiling kernels for further settings, once: 1 of 3")
    assert further in seen and seen.index(further) > seen.index((False, "compiling kernels, once: 1 of 2"))
    assert seen[-1][0] and (True, "compiling kernels, once: 2 of 2") not in seen
    assert noted[0]["command"][1:] == ("-m", "torchrender.kernels.warm_up", "serve.first", "serve")
    assert "TORCHRENDER_API_KEY" not in noted[0]["env"]


@pytest.mark.parametrize("code", ["import sys; sys.exit(1)", "print('no progress')"])
def test_a_failure_is_no_reason_not_to_serve(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    instead(monkeypatch, code)
    preparation = KernelPreparation()
    asyncio.run(preparation.run())
    assert preparation.finished


def test_a_kernel_that_failed_is_a_record_of_the_log(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    told = {"part": "serve.first", "failed": "shadows.look_up: TypingError: no such field"}
    instead(monkeypatch, f"import json; print(json.dumps({told!r}))\n{SLOW}")
    preparation = KernelPreparation()
    asyncio.run(preparation.run())
    assert preparation.finished
    (record,) = [one for one in caplog.records if one.levelname == "WARNING"]
    assert (record.part, record.failed) == tuple(told.values())  # type: ignore[attr-defined]


def test_a_server_that_stops_ends_the_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    instead(monkeypatch, "import time; time.sleep(60)")

    async def stop() -> None:
        task = asyncio.create_task(KernelPreparation().run())
        await asyncio.sleep(0.3)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(asyncio.wait_for(stop(), 10.0))


def test_a_pool_is_not_ready_before_its_kernels_are(monkeypatch: pytest.MonkeyPatch) -> None:
    pool = Pool(read_settings(None, {}, renderers=1), Metrics())
    assert not pool.ready and pool.progress == "looking for kernels"
    pool._kernels.first.set()
    assert not pool.ready and pool.progress == "starting renderers"
    monkeypatch.setattr(pools.RendererProcess, "ready", True)
    assert not pool.ready and pool.progress == "making a first picture"
    pool._warm.add("0")
    pool._kernels.done, pool._kernels.total = 1, 4
    assert pool.ready and pool.progress == "compiling kernels for further settings, once: 1 of 4"
    pool._kernels.done = 4
    assert pool.ready and pool.progress == ""


@pytest.mark.parametrize("progress", ["", "compiling kernels for further settings, once: 1 of 4"])
def test_a_server_that_is_ready_tells_what_goes_on_behind_that(progress: str) -> None:
    class State:
        stopping = False

        class pool:
            ready = True

    State.pool.progress = progress
    request = type("Request", (), {"app": type("App", (), {"state": type("S", (), {"service": State})})})
    answer = asyncio.run(routes_status.ready(request))
    assert answer == ({"status": "ready", "progress": progress} if progress else {"status": "ready"})
