"""The pool of processes, without letting any of them render: who gets which renderer, and what they get to know."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from dataclasses import replace as replace_in
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from service_parts import Actor
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers import pool as pool_module
from torchrender_service.renderers.asked import Asked
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import (
    Bounds,
    DescribePhoto,
    FogInPhoto,
    Forget,
    Job,
    Render,
    SceneSource,
    View,
    WarmUp,
)
from torchrender_service.renderers.places import PLACES, Standing, place_of
from torchrender_service.renderers.pool import Pool
from torchrender_service.renderers.processes import process as process_module
from torchrender_service.renderers.processes.process import RendererProcess
from torchrender_service.settings import read_settings

KEY = "a-key-of-enough-letters"


def picture(side: int) -> Job:
    view, scene = View(width=side, height=side), SceneSource(id="cornell_box")
    return Render(scene=scene, view=view, bounds=Bounds(), options={}, format="png")


def make_pool(**settings: Any) -> Pool:
    return Pool(read_settings(None, {}, **settings), Metrics())


def test_sessions_are_spread_and_give_their_renderer_back() -> None:
    pool: RendererPool = make_pool(renderers=2)

    async def busy(*handles: Any) -> list[bool]:
        """Which of these renderers a job of the first one keeps busy; nobody works on it."""
        task = asyncio.create_task(pool.run(Forget(), renderer=handles[0]))
        await asyncio.sleep(0)
        found = [not pool.idle(handle) for handle in handles]
        task.cancel()
        return found

    first, second, third, fourth = (pool.assign() for _ in range(4))
    assert asyncio.run(busy(first, second, third, fourth)) == [True, False, True, False]
    pool = make_pool(renderers=2)
    first, second = pool.assign(), pool.assign()
    pool.release(second)
    pool.release(second)  # a second time does not count
    third, fourth = pool.assign(), pool.assign()
    assert asyncio.run(busy(second, first, third, fourth)) == [True, False, True, False]


def test_who_has_the_fewest_sessions_gets_the_next_one_however_busy_it_is() -> None:
    """Sessions last, what there is to do just now does not; among equals that decides."""
    pool = make_pool(renderers=2)

    async def next_ones() -> list[bool]:
        first, second = pool.assign(), pool.assign()
        task = asyncio.create_task(pool.run(Forget(), renderer=second))
        await asyncio.sleep(0)
        pool.release(second)
        third = pool.assign()
        pool.release(third)
        pool.release(first)
        fourth = pool.assign()
        found = [pool.load(handle) == 1 for handle in (first, third, fourth)]
        task.cancel()
        return found

    assert asyncio.run(next_ones()) == [False, True, False]


def test_all_that_run_are_told_what_to_forget_until_the_pool_closes(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[str, Job]] = []
    monkeypatch.setattr(RendererProcess, "ready", property(lambda renderer: renderer.name != "1"))
    monkeypatch.setattr(RendererProcess, "post", lambda renderer, job: told.append((renderer.name, job)))
    pool, job = make_pool(renderers=2), Forget()
    pool.forget(job)
    assert told == [("0", job), ("batch", job)]
    asyncio.run(pool.stop())
    pool.forget(job)
    assert len(told) == 2


def test_large_pictures_wait_apart_and_the_first_renderer_is_kept_for_streams() -> None:
    def chosen(pool: Pool, job: Job) -> str:
        async def put() -> str:
            task = asyncio.create_task(pool.run(job))
            await asyncio.sleep(0)
            name = next(renderer.name for renderer in pool._working if renderer.load)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            return name

        return asyncio.run(put())

    pool, small = make_pool(renderers=2), make_pool(renderers=1, batch_renderer=False)
    assert [chosen(pool, picture(side)) for side in (64, 2048)] == ["1", "batch"]
    assert [chosen(small, picture(side)) for side in (64, 2048)] == ["0", "0"]
    assert pool.idle(pool.assign(background=True)) and small.idle(small.assign(background=True))


def test_small_pictures_of_several_clients_take_two_processes_and_a_thread_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The process of large pictures helps out, while it has none; what it does not get done comes back."""
    monkeypatch.setattr(RendererProcess, "ready", True)  # jobs go to processes that are not there, and stay
    monkeypatch.setattr(Pool, "_aside_ready", True)

    async def chosen(pool: Pool, *jobs: Job) -> list[tuple[str, int]]:
        """Where each job runs or waits, while those before do, and how many threads it may take."""
        tasks, found = [], []
        for job in jobs:
            asked, before = Asked(), {r.name: r.load for r in pool._working}
            tasks.append(asyncio.create_task(pool.run(job, asked=asked)))
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            found.append((next(r.name for r in pool._working if r.load > before[r.name]), asked.threads))
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return found

    small, large, bounded = picture(64), picture(2048), replace(picture(64), bounds=Bounds(budget_ms=50.0))
    pool = make_pool(renderers=1)
    assert asyncio.run(chosen(pool, small, small, small)) == [("0", 0), ("batch", 1), ("0", 1)]
    pool = make_pool(renderers=1)
    assert asyncio.run(chosen(pool, small, bounded, picture(512))) == [("0", 0)] * 3
    pool = make_pool(renderers=1)
    assert asyncio.run(chosen(pool, large, small, small)) == [("batch", 0), ("0", 1), ("0", 1)]
    pool = make_pool(renderers=1)
    pool.assign()  # a stream: pictures of all sizes leave it alone
    assert asyncio.run(chosen(pool, picture(512), bounded)) == [("batch", 0), ("0", 0)]


FREE = Standing(free=True, small=False, streams=False, ahead=1, other=True, ready=True)
WHERE = [  # standing, made in the renderer of large pictures, why
    (FREE, False, "it is in nobody's way there"),
    (replace_in(FREE, small=True), True, "less waits there"),
    (replace_in(FREE, small=True, ahead=0), False, "it is in nobody's way there"),
    (replace_in(FREE, small=True, ahead_there=1), False, "as much waits there"),
    (replace_in(FREE, streams=True, ahead_there=5), True, "streams have the renderer"),
    (replace_in(FREE, streams=True, loaded_there=False), True, "streams have it, and the scene is loaded"),
    (replace_in(FREE, streams=True, free=False), False, "its pace is known there"),
    (replace_in(FREE, streams=True, slow=True), False, "the renderer of large pictures was too slow"),
    (replace_in(FREE, streams=True, large=True), False, "the renderer of large pictures has one"),
    (replace_in(FREE, streams=True, ready=False), False, "the renderer of large pictures starts"),
    (replace_in(FREE, streams=True, other=False), False, "there is no other renderer"),
]


@pytest.mark.parametrize(("standing", "aside", "why"), WHERE, ids=[str(k) for k in range(len(WHERE))])
def test_where_a_picture_is_made_and_why(standing: Standing, aside: bool, why: str) -> None:
    place = place_of(standing)
    assert (place.aside, place.why) == (aside, why)
    assert place.wanted is (why == "the renderer of large pictures starts")
    assert bool(place.patience_s) is aside


def test_every_reason_decides_somewhere() -> None:
    assert {place_of(standing).why for standing, _, _ in WHERE} == {place.why for place in PLACES}


def test_views_at_rest_are_warmed_up_behind_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RendererProcess, "ready", True)
    pool, done = make_pool(renderers=1), []
    pool._kernels.first.set()

    async def submit(_: RendererProcess, job: WarmUp) -> dict[str, Any]:
        done.append((job.views, pool.ready))
        return {}

    monkeypatch.setattr(RendererProcess, "submit", submit)
    asyncio.run(pool._warm_renderer(pool._renderers[0]))
    assert done == [(("moving",), False), (("still", "carried"), True)]


def test_who_looks_at_uploads_starts_when_no_picture_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool_module, "INSPECTOR_S", 0.01)
    monkeypatch.setattr(pool_module, "AGAIN_S", 0.01)

    async def play() -> list[bool]:
        pool, found = make_pool(renderers=1), []
        task = asyncio.create_task(pool.run(picture(64)))
        await asyncio.sleep(0)
        pool._prepare_inspector()
        await asyncio.sleep(0.1)
        found.append(pool._inspector._wanted.is_set())
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        while not pool._inspector._wanted.is_set():
            await asyncio.sleep(0.01)
        return [*found, pool._inspector._wanted.is_set()]

    assert asyncio.run(asyncio.wait_for(play(), 20.0)) == [False, True]


def test_a_renderer_is_alone_while_its_other_sessions_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    pool: RendererPool = make_pool(renderers=2)
    first, other, second = (pool.assign() for _ in range(3))  # the first and the third share one

    async def ask(handle: Any) -> None:
        task = asyncio.create_task(pool.run(Forget(), renderer=handle))
        await asyncio.sleep(0)
        assert not pool.alone(handle), "it has something to do"
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(ask(second))
    assert not pool.alone(first) and pool.alone(other)
    monkeypatch.setattr(pool_module, "AT_REST_S", 0.0)
    assert pool.alone(first) and pool.alone(second)


def test_the_renderer_of_large_pictures_starts_some_time_after_the_first_stream(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pool_module, "ASIDE_S", 0.05)
    prepared: list[int] = []
    monkeypatch.setattr(Pool, "_prepare_aside", lambda _: prepared.append(1))

    async def play(**settings: Any) -> list[int]:
        prepared.clear()
        pool, found = make_pool(renderers=1, **settings), []
        handle = pool.assign()
        tasks = [asyncio.create_task(pool.run(Forget(), renderer=handle)) for _ in range(3)]
        for wait_s in (0.0, 0.2):
            await asyncio.sleep(wait_s)
            found.append(len(prepared))
        await pool.stop()
        await asyncio.gather(*tasks, return_exceptions=True)
        return found

    assert asyncio.run(play()) == [0, 1]
    assert asyncio.run(play(batch_renderer=False)) == [0, 0], "there is none"


def test_a_session_at_rest_keeps_no_renderer_from_small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be one whose client has gone, and may come back."""
    monkeypatch.setattr(RendererProcess, "ready", True)
    monkeypatch.setattr(Pool, "_aside_ready", True)

    async def first_goes_to(rest_s: float) -> str:
        pool = make_pool(renderers=1)
        handle = pool.assign()
        stream = asyncio.create_task(pool.run(Forget(), renderer=handle))
        await asyncio.sleep(0)
        monkeypatch.setattr(pool_module, "AT_REST_S", rest_s)
        await asyncio.sleep(0.01)
        picture_task = asyncio.create_task(pool.run(picture(512)))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        names = [renderer.name for renderer in pool._working if renderer.load > (renderer.name == "0")]
        for task in (stream, picture_task):
            task.cancel()
        await asyncio.gather(stream, picture_task, return_exceptions=True)
        return names[0]

    assert asyncio.run(first_goes_to(60.0)) == "batch"
    assert asyncio.run(first_goes_to(0.001)) == "0"


def test_who_helps_out_makes_a_first_picture_of_its_own_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RendererProcess, "ready", True)

    async def two() -> tuple[list[int], list[type]]:
        pool = make_pool(renderers=1)
        tasks = [asyncio.create_task(pool.run(picture(64))) for _ in range(3)]
        await asyncio.sleep(0.02)
        loads = [renderer.load for renderer in pool._working]
        jobs = [type(running.waiting.job) for running in pool._batch._running.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await pool.stop()
        return loads, jobs

    assert asyncio.run(two()) == ([3, 1], [WarmUp])


def test_a_picture_that_the_system_leaves_waiting_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RendererProcess, "ready", True)
    monkeypatch.setattr(Pool, "_aside_ready", True)
    monkeypatch.setattr(pool_module, "place_of", lambda standing: place_of(standing)._replace(patience_s=0.05))

    async def two() -> list[int]:
        pool = make_pool(renderers=1)
        tasks = [asyncio.create_task(pool.run(picture(64))) for _ in range(2)]
        await asyncio.sleep(0.2)
        loads = [renderer.load for renderer in pool._working]
        tasks.append(asyncio.create_task(pool.run(picture(64))))
        await asyncio.sleep(0)
        loads += [renderer.load for renderer in pool._working]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return loads

    # The one that nobody began is still there to be told that nobody waits for it.
    assert asyncio.run(two()) == [2, 1, 3, 1]


def test_a_handle_of_another_pool_is_refused() -> None:
    pool = make_pool(renderers=1)
    for handle in (Actor("far away"), make_pool(renderers=1).assign()):
        with pytest.raises(TypeError, match="handle of this pool"):
            asyncio.run(pool.run(Forget(), renderer=handle))
        with pytest.raises(TypeError, match="handle of this pool"):
            pool.idle(handle)


@pytest.mark.parametrize("inspected", [False, True])
def test_as_many_jobs_as_may_wait_and_not_one_more(inspected: bool) -> None:
    pool = make_pool(renderers=1, waiting=3)

    async def fill() -> list[BaseException | dict[str, Any]]:
        put = pool.inspect if inspected else pool.run
        tasks = [asyncio.create_task(put(Forget())) for _ in range(4)]
        await asyncio.sleep(0)
        assert [task.done() for task in tasks] == [False, False, False, True]
        assert pool.waiting == (0 if inspected else 3)
        await pool.stop()
        with pytest.raises(ServiceError, match="stopping"):
            await put(Forget())
        return await asyncio.gather(*tasks, return_exceptions=True)

    errors = asyncio.run(fill())
    assert [error.status for error in errors if isinstance(error, ServiceError)] == [503, 503, 503, 429]
    assert isinstance(errors[-1], ServiceError) and errors[-1].retry_after_s is not None


def test_renderers_never_learn_the_api_key(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A scene that takes a renderer over must not find it there."""
    noted = tmp_path / "environment.json"
    monkeypatch.setattr(process_module, "BACK_OFF_S", (60.0,) * 6)  # none tries again beside the one that is looked at
    note = (
        f"import json, os; own = {str(noted)!r} + str(os.getpid()); "
        f"open(own, 'w').write(json.dumps(dict(os.environ))); os.replace(own, {str(noted)!r})"
    )
    begin = asyncio.create_subprocess_exec

    async def instead(*command: str, **rest: Any) -> asyncio.subprocess.Process:
        assert not any(KEY in word for word in command)
        return await begin(sys.executable, "-c", note, **rest)

    monkeypatch.setattr(asyncio, "create_subprocess_exec", instead)
    monkeypatch.setenv("TORCHRENDER_API_KEY", KEY)
    settings = read_settings(None, os.environ, renderers=1, threads=3)
    assert settings.api_key == KEY
    pool = Pool(settings, Metrics())

    async def ask() -> None:
        pool.start()
        try:
            for put, threads in ((pool.run, "3"), (pool.inspect, "1")):
                with pytest.raises(ServiceError, match="does not start"):
                    await put(Forget())
                environment = json.loads(noted.read_text())
                assert environment["NUMBA_NUM_THREADS"] == threads
                assert not any(KEY in value for value in environment.values())
                noted.unlink()
        finally:
            await pool.stop()

    asyncio.run(ask())


def test_a_photo_waits_for_no_renderer_that_gets_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """That of large pictures has what others leave over: nothing, where other programs take all."""
    monkeypatch.setattr(RendererProcess, "ready", True)  # jobs go to processes that are not there, and stay
    monkeypatch.setattr(pool_module, "PHOTO_PATIENCE_S", 0.05)
    photo = DescribePhoto(photo=b"", max_pixels=1)
    full = FogInPhoto(photo=b"", marks=b"", format="png", max_pixels=1)

    async def loads(*pauses: float, **settings: Any) -> list[list[int]]:
        """Jobs of all renderers after each pause; a photo begins before each of them, one of full size last."""
        pool = make_pool(renderers=2, **settings)
        handle, tasks, found = pool.assign(background=True), [], []
        for pause in pauses:
            tasks.append(asyncio.create_task(pool.run(photo, renderer=handle)))
            await asyncio.sleep(pause)
            found.append([renderer.load for renderer in pool._working])
        tasks.append(asyncio.create_task(pool.run(full, renderer=handle)))
        await asyncio.sleep(0.1)
        found.append([renderer.load for renderer in pool._working])
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return found

    # The one that nobody began is still there to be told that nobody waits for it.
    assert asyncio.run(loads(0.01, 0.1, 0.01)) == [[0, 0, 1], [0, 2, 1], [0, 3, 1], [0, 3, 2]]
    monkeypatch.setattr(pool_module, "PHOTOS_AVOID_S", 0.0)
    assert asyncio.run(loads(0.1, 0.01)) == [[0, 1, 1], [0, 1, 2], [0, 2, 2]]
    assert asyncio.run(loads(0.1, batch_renderer=False)) == [[0, 1], [0, 2]], "there is none"
