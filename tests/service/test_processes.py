"""Which job comes next, what becomes of those whose client left, and a renderer's next life."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import msgspec
import pytest
import torch

from service_parts import CAMERA
from torchrender.clock import StepClock, interruptible
from torchrender.kernels.compile import thread_count
from torchrender.kernels.threads import most_threads
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers import worker
from torchrender_service.renderers.asked import Asked, Rank, is_moving, rank_of
from torchrender_service.renderers.jobs import (
    Bounds,
    Describe,
    FindPixel,
    FogInPhoto,
    Forget,
    Job,
    MakeLayers,
    Render,
    SceneSource,
    Tradeoff,
    View,
    WarmUp,
)
from torchrender_service.renderers.processes import pauses as pauses_module
from torchrender_service.renderers.processes import process as process_module
from torchrender_service.renderers.processes import start as processes
from torchrender_service.renderers.processes.desk import Cancelled, Desk
from torchrender_service.renderers.processes.messages import JOB_ENCODER, Cancel, Reply, SentTask, Task
from torchrender_service.renderers.processes.pauses import Pauses
from torchrender_service.renderers.processes.process import RendererProcess
from torchrender_service.renderers.processes.schedule import PATIENCE_S, FairQueue, Waiting
from torchrender_service.renderers.processes.start import Kind, Spare
from torchrender_service.renderers.streaming.ahead import first_keyframe
from torchrender_service.renderers.worker import Needs, needs_of

WORKER = """
import os, struct, sys, threading, time
import msgspec
from torchrender_service.renderers.processes.messages import TASK_DECODER, Cancel, Failure, Reply
out, encode, head = os.fdopen(1, 'wb', buffering=0), msgspec.msgpack.Encoder().encode, struct.Struct('<Q')
def send(reply):
    data = encode(reply); out.write(head.pack(len(data)) + data)
send(Reply(result={'begun': True}))
send(Reply(result={'ready': True}))
lock, held, names = threading.Lock(), {}, []
def read():
    (size,) = head.unpack(sys.stdin.buffer.read(8)); return TASK_DECODER.decode(sys.stdin.buffer.read(size))
while True:
    task = read()
    if isinstance(task, Cancel):
        failure = Failure(status=499, kind='cancelled', detail='left')
        if held.pop(task.serial, None): send(Reply(serial=task.serial, failure=failure))
        continue
    job = msgspec.msgpack.decode(task.job); name = job.get('name', job['type'])
    if name == 'hold': held[task.serial] = task
    else:
        result = {'did': name, 'express': task.express, 'after': list(names), 'holds': len(held)}
        send(Reply(serial=task.serial, memory_mb=5.0, evictions=2, result=result))
        names.append(name)
"""
"""Answers at once, but keeps a job called "hold" until it is cancelled."""
HOLD, QUICK, URGENT = Tradeoff(name="hold"), Tradeoff(name="quick"), MakeLayers(session="one", id=1)


def waiting(client: str, rank: Rank, since: float = 0.0) -> Waiting:
    made = Waiting(QUICK, asyncio.get_running_loop().create_future(), Asked(client=client), rank)
    made.since += since
    return made


def test_streams_come_first_clients_in_turn_and_nobody_last_for_ever() -> None:
    async def order() -> list[str]:
        queue = FairQueue(64)
        for client, rank in (("a", Rank.BATCH), ("b", Rank.INTERACTIVE), ("b", Rank.INTERACTIVE)):
            queue.put(waiting(client, rank))
        for client in ("d", "d", "c"):
            queue.put(waiting(client, Rank.INTERACTIVE))
        queue.put(waiting("e", Rank.STREAM))
        left = waiting("f", Rank.STREAM)
        queue.put(left)
        left.result.cancel()
        found = []
        while (one := queue.take()) is not None:
            found.append(one.asked.client)
        queue.put(waiting("late", Rank.BATCH, since=-PATIENCE_S[Rank.BATCH] - 1.0))
        queue.put(waiting("new", Rank.STREAM))
        return [*found, *(one.asked.client for one in (queue.take(), queue.take()) if one is not None)]

    assert asyncio.run(order()) == ["e", "b", "d", "c", "b", "d", "a", "late", "new"]


def test_one_client_cannot_take_all_places() -> None:
    async def fill() -> int:
        queue, count = FairQueue(8), 0
        with pytest.raises(ServiceError, match="of this address") as caught:
            while True:
                queue.check_room("a", Rank.INTERACTIVE)
                queue.put(waiting("a", Rank.INTERACTIVE))
                count += 1
        assert caught.value.status == 429
        queue.check_room("b", Rank.INTERACTIVE)
        queue.check_room("a", Rank.STREAM)
        return count

    assert asyncio.run(fill()) == 6


def test_the_class_of_a_job_is_its_size() -> None:
    def render(width: int, height: int, **rest: Any) -> Render:
        view, scene = View(width=width, height=height), SceneSource(id="a")
        return Render(view=view, scene=scene, format="png", **{"bounds": Bounds(), "options": {}, **rest})

    assert rank_of(render(640, 360)) is Rank.INTERACTIVE
    assert rank_of(render(2560, 1440)) is rank_of(render(640, 360, options={"supersample": 2.0})) is Rank.BATCH
    assert rank_of(render(2560, 1440, bounds=Bounds(budget_ms=500.0))) is Rank.INTERACTIVE
    assert rank_of(URGENT) is Rank.STREAM
    assert rank_of(FindPixel(scene=SceneSource(id="x"), camera=CAMERA, x=0.5, y=0.5)) is Rank.GLANCE
    assert rank_of(FogInPhoto(photo=b"", marks=b"", format="png", max_pixels=1)) is Rank.BATCH
    keyframes = [first_keyframe("one", SceneSource(id="x"), CAMERA, still=still) for still in (False, True)]
    assert [is_moving(job) for job in (*keyframes, URGENT, QUICK)] == [True, False, False, False]
    assert CAMERA.width == 64


def sent(serial: int, job: Job, *, express: bool = False) -> SentTask:
    return SentTask(serial=serial, job=msgspec.Raw(JOB_ENCODER.encode(job)), express=express)


class Stage:
    """A renderer whose process is a small program."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, pauses: Pauses | None = None, **kind: Any) -> None:
        begin = asyncio.create_subprocess_exec

        async def instead(*_: str, **rest: Any) -> asyncio.subprocess.Process:
            path = os.pathsep.join(p for p in sys.path if p)
            environment = {**rest.pop("env"), "PYTHONPATH": path}
            return await begin(sys.executable, "-c", WORKER, env=environment, **rest)

        monkeypatch.setattr(processes.asyncio, "create_subprocess_exec", instead)
        self.metrics = Metrics()
        given = {"name": "0", "memory_mb": 512, "job_s": 60.0, **kind}
        self.spare = Spare(Kind(**given))
        self.renderer = RendererProcess(Kind(**given), 64, self.metrics, spare=self.spare, pauses=pauses)

    def run(self, play: Coroutine[Any, Any, None]) -> None:
        async def whole() -> None:
            self.renderer.start()
            try:
                await asyncio.wait_for(play, 60.0)
            finally:
                await self.renderer.stop()
                await self.spare.stop()

        asyncio.run(whole())

    async def ready(self) -> int:
        while not self.renderer.ready:
            await asyncio.sleep(0.01)
        assert self.renderer.pid is not None
        return self.renderer.pid

    def count(self, name: str, **labels: str) -> float:
        return self.metrics._counters[name, tuple(sorted(labels.items()))]

    async def begun(self, job: Job) -> asyncio.Task[dict[str, Any]]:
        """A job that the process has."""
        task = asyncio.create_task(self.renderer.submit(job))
        while not any(one.waiting.job is job for one in self.renderer._running.values()):
            await asyncio.sleep(0.01)
        return task


def test_a_renderer_that_is_killed_while_idle_lives_again_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)

    async def play() -> None:
        first = await stage.ready()
        os.kill(first, signal.SIGKILL)
        while stage.renderer.pid in (None, first):
            await asyncio.sleep(0.01)
        await stage.ready()
        assert stage.count("renderer_deaths", renderer="0") == 1
        assert (await stage.renderer.submit(QUICK))["did"] == "quick"
        assert stage.count("renderer_evictions", renderer="0") == 2

    stage.run(play())


def test_a_spare_process_is_stopped_only_when_it_would_go_on_without_its_parent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stopped before that it would stand for ever where the server is killed."""

    class Begun:
        def __init__(self) -> None:
            self.stdout, self.returncode, self.pid = asyncio.StreamReader(), 0, 1
            self.stdin = None

        async def wait(self) -> int:
            return 0

        def say(self, what: str) -> None:
            data = msgspec.msgpack.encode(Reply(result={what: True}))
            self.stdout.feed_data(worker.LENGTH.pack(len(data)) + data)

    joined: list[object] = []

    async def play() -> None:
        process = Begun()

        async def begin(kind: Kind) -> Any:
            del kind
            return process

        monkeypatch.setattr(processes, "begin_process", begin)
        pauses = Pauses()
        monkeypatch.setattr(pauses, "join", joined.append)
        spare = Spare(Kind(name="spare", memory_mb=512, job_s=60.0), pauses)
        spare.prepare()
        for _ in range(5):
            await asyncio.sleep(0)
        assert joined == []
        process.say(worker.BEGUN)
        while not joined:
            await asyncio.sleep(0)
        assert joined == [process] and spare.pid is None
        process.say(worker.READY)
        while spare.pid is None:
            await asyncio.sleep(0)
        await spare.stop()

    asyncio.run(asyncio.wait_for(play(), 30.0))


def test_a_renderer_has_the_scenes_that_it_has_done_jobs_for(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)
    box, nest = (Describe(scene=SceneSource(id=name)) for name in ("box", "nest"))
    renderer = stage.renderer

    async def play() -> None:
        first = await stage.ready()
        assert renderer.has_scene(QUICK) and not renderer.has_scene(box)
        await renderer.submit(box)
        assert renderer.has_scene(box) and not renderer.has_scene(nest)
        await renderer.submit(nest)
        renderer.post(Forget(scene="box"))
        assert renderer.has_scene(nest) and not renderer.has_scene(box)
        os.kill(first, signal.SIGKILL)
        while renderer.pid in (None, first):
            await asyncio.sleep(0.01)
        assert not renderer.has_scene(nest), "the next life has loaded nothing"

    stage.run(play())


def test_a_process_that_is_prepared_runs_before_its_first_job(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, eager=False)

    async def play() -> None:
        await asyncio.sleep(0.2)
        assert stage.renderer.pid is None
        stage.renderer.prepare()
        await stage.ready()
        assert (await stage.renderer.submit(QUICK))["did"] == "quick"

    stage.run(play())


def test_the_process_that_stands_ready_takes_the_place_of_one_that_died(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)

    async def play() -> None:
        first = await stage.ready()
        stage.spare.prepare()
        while (ready := stage.spare.pid) is None:
            await asyncio.sleep(0.01)
        os.kill(first, signal.SIGKILL)
        while stage.renderer.pid in (None, first):
            await asyncio.sleep(0.01)
        assert stage.renderer.pid == ready and stage.spare.pid is None
        answer = await stage.renderer.submit(QUICK)
        assert answer["did"] == "quick" and answer["after"] == ["WarmUp"], "its first picture was made before"

    stage.run(play())


def test_a_first_picture_that_is_on_its_way_keeps_nobody_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that takes the place of one that died has better things to do."""
    monkeypatch.setattr(processes, "WarmUp", lambda: HOLD)
    stage = Stage(monkeypatch)

    async def play() -> None:
        first = await stage.ready()
        stage.spare.prepare()
        while stage.spare.pid is None:
            await asyncio.sleep(0.01)
        os.kill(first, signal.SIGKILL)
        while stage.renderer.pid in (None, first):
            await asyncio.sleep(0.01)
        answer = await stage.renderer.submit(QUICK)
        assert answer["did"] == "quick" and answer["holds"] == 0

    stage.run(play())


@pytest.mark.skipif(sys.platform != "linux", reason="states of processes are told by /proc")
def test_work_that_gives_way_stands_still_while_a_keyframe_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    moving = Tradeoff(name="hold")
    monkeypatch.setattr(pauses_module, "LONGEST_S", 60.0)
    monkeypatch.setattr(process_module, "is_moving", lambda job: job is moving)
    pauses = Pauses()
    streams, aside = Stage(monkeypatch, pauses), Stage(monkeypatch, pauses, name="aside", gives_way=True)

    async def state(wanted: bool) -> None:
        """Wait until it stands still, or runs or waits."""
        while (Path(f"/proc/{aside.renderer.pid}/stat").read_text().rpartition(")")[2].split()[0] == "T") != wanted:
            await asyncio.sleep(0.01)

    async def play() -> None:
        await aside.ready()
        keyframe = await streams.begun(moving)
        await state(False)
        work = await aside.begun(HOLD)
        await state(True)
        keyframe.cancel()
        await state(False)
        picture = await streams.begun(HOLD)
        await state(False)
        for task in (work, picture):
            task.cancel()
        await asyncio.gather(keyframe, work, picture, return_exceptions=True)

    async def both() -> None:
        aside.renderer.start()
        try:
            await play()
        finally:
            await aside.renderer.stop()

    streams.run(both())


def test_a_job_whose_client_left_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)

    async def play() -> None:
        running = await stage.begun(HOLD)
        queued = [asyncio.create_task(stage.renderer.submit(QUICK)) for _ in range(20)]
        await asyncio.sleep(0.05)
        assert stage.renderer.load == 21
        for task in (*queued, running):
            task.cancel()
        await asyncio.gather(*queued, running, return_exceptions=True)
        assert (await stage.renderer.submit(QUICK))["did"] == "quick", "the renderer is free for others"
        assert stage.count("jobs_cancelled") == 1 and stage.renderer.load == 0

    stage.run(play())


def test_keyframes_do_not_wait_for_a_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)

    async def play() -> None:
        running = await stage.begun(HOLD)
        assert (await stage.renderer.submit(URGENT)).items() >= {"did": "MakeLayers", "express": True}.items()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        while stage.renderer.load:
            await asyncio.sleep(0.01)
        assert (await stage.renderer.submit(URGENT)).items() >= {"did": "MakeLayers", "express": False}.items()

    stage.run(play())


def test_a_job_that_takes_too_long_is_stopped_without_the_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, job_s=0.3)

    async def play() -> None:
        first = await stage.ready()
        with pytest.raises(ServiceError, match="took longer") as caught:
            await stage.renderer.submit(HOLD)
        assert caught.value.status == 422
        assert (await stage.renderer.submit(QUICK))["did"] == "quick"
        assert stage.renderer.pid == first

    stage.run(play())


def test_a_server_that_stops_gives_jobs_back(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)

    async def play() -> None:
        running = await stage.begun(HOLD)
        queued = asyncio.create_task(stage.renderer.submit(QUICK))
        await asyncio.sleep(0.05)
        drained = asyncio.create_task(stage.renderer.drain())
        with pytest.raises(ServiceError) as caught:
            await queued
        assert caught.value.status == 503 and not drained.done()
        await stage.renderer.stop()
        with pytest.raises(ServiceError):
            await running
        await drained

    stage.run(play())


def test_between_two_passes_a_desk_does_what_is_urgent_and_stops_what_nobody_wants() -> None:
    done: list[str] = []
    clock = StepClock()

    def work(task: SentTask) -> None:
        if task.express:
            done.append("keyframe")
            time.sleep(0.05)
            return
        try:
            with clock.measure("picture"):
                for name in ("first", "second", "third"):
                    with clock.measure(name):
                        done.append(name)
                    desk.put(sent(2, URGENT, express=True) if name == "first" else Cancel(serial=1))
        except Cancelled:
            done.append("stopped")
        desk.close()

    desk = Desk(work)
    desk.put(sent(1, QUICK))
    desk.run()
    assert done == ["first", "keyframe", "second", "stopped"]
    assert "picture" not in clock.elapsed_ms and "third" not in clock.elapsed_ms


def test_what_is_urgent_does_not_wait_for_what_goes_ahead_of_a_task() -> None:
    done: list[str] = []
    loading, loaded = threading.Event(), threading.Event()

    def work(task: SentTask) -> None:
        done.append("keyframe" if task.express else "picture")
        if task.express:
            loaded.set()
        else:
            desk.close()

    def load() -> None:
        loading.set()
        assert loaded.wait(10.0)
        done.append("loaded")

    desk = Desk(work, lambda task: None if task.express else load)
    desk.put(sent(1, QUICK))
    worker_thread = threading.Thread(target=desk.run)
    worker_thread.start()
    assert loading.wait(10.0)
    desk.put(sent(2, URGENT, express=True))
    worker_thread.join(10.0)
    assert done == ["keyframe", "loaded", "picture"]


def test_a_task_that_nobody_wants_waits_for_nothing_ahead_of_it() -> None:
    done, never = [], threading.Event()

    def work(task: SentTask) -> None:
        done.append((task.serial, desk.cancelled(task)))
        desk.close()

    desk = Desk(work, lambda _: never.wait)
    desk.put(sent(1, QUICK))
    worker_thread = threading.Thread(target=desk.run)
    worker_thread.start()
    time.sleep(0.05)
    assert not done
    desk.put(Cancel(serial=1))
    worker_thread.join(10.0)
    never.set()
    assert done == [(1, True)]


def test_a_renderer_whose_server_is_gone_ends_with_one_line() -> None:
    command = [sys.executable, "-m", "torchrender_service.renderers.worker"]
    environment = os.environ | {"PYTHONWARNINGS": "ignore"}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, env=environment) as renderer:
        assert renderer.stdin is not None and renderer.stdout is not None and renderer.stderr is not None
        size = struct.unpack("<Q", renderer.stdout.read(8))[0]
        assert msgspec.msgpack.decode(renderer.stdout.read(size))["result"] == {"begun": True}
        size = struct.unpack("<Q", renderer.stdout.read(8))[0]
        assert msgspec.msgpack.decode(renderer.stdout.read(size))["result"] == {"ready": True}
        renderer.stdout.close()
        data = JOB_ENCODER.encode(Task(serial=1, job=Tradeoff(name="soft_shadow")))
        renderer.stdin.write(struct.pack("<Q", len(data)) + data)
        renderer.stdin.flush()
        assert renderer.wait(60) == 1
        (line,) = renderer.stderr.read().splitlines()
    assert json.loads(line)["message"] == "the server is gone: its renderer ends"


def test_the_scene_of_a_task_is_known_without_reading_all_of_it() -> None:
    scene = SceneSource(id="box", path="/somewhere")
    assert needs_of(sent(1, Describe(scene=scene))) == Needs("Describe", scene)
    assert needs_of(sent(2, Forget(scene="box"))) == Needs(), "a name is no scene"
    assert needs_of(sent(3, WarmUp())) == Needs("WarmUp")
    assert needs_of(SentTask(serial=4, job=msgspec.Raw(b"\xc1"))) == Needs()


def test_what_came_between_two_passes_is_not_counted_as_theirs() -> None:
    clock, calls = StepClock(), []

    def slow() -> None:
        calls.append(1)
        time.sleep(0.05)

    with interruptible(slow), clock.measure("picture"):
        for _ in range(4):
            with clock.measure("pass"):
                pass
    assert len(calls) == 5 and clock.elapsed_ms["picture"] < 50.0 and clock.elapsed_ms["pass"] < 50.0


def test_a_job_takes_the_threads_that_it_may_and_one_between_its_passes_all() -> None:
    def now() -> tuple[int, int]:
        return thread_count(), torch.get_num_threads()

    before = now()
    with worker.threads(1):
        assert now() == (1, 1)
        with worker.threads(0):
            assert now() == (most_threads(), most_threads())
        assert now() == (1, 1)
    assert now() == before
    with worker.threads(1000):
        assert now()[0] == most_threads()
