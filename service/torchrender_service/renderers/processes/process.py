"""One renderer process, as the server sees it: its jobs, its deadline, and its next life when it dies.

It does one job at a time. While that is no keyframe of a stream, one of these may be done between two of its passes:
the express lane. A job whose client has gone is taken out of the queue, or stopped at its next pass.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import time
from dataclasses import dataclass
from typing import Any

from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.asked import Asked, Rank, is_moving, rank_of
from torchrender_service.renderers.jobs import Forget, Job, SceneSource
from torchrender_service.renderers.processes.messages import REPLY_DECODER, Cancel, Reply, Task
from torchrender_service.renderers.processes.pauses import Pauses
from torchrender_service.renderers.processes.schedule import RETRY_S, FairQueue, Waiting, fail, more_urgent
from torchrender_service.renderers.processes.start import (
    NO_JOB,
    Kind,
    Process,
    Spare,
    end_process,
    greeted,
    kill_process,
    read_message,
    start_process,
    write_message,
)

LOG = logging.getLogger("torchrender_service.renderers.processes.process")
STOP_S = 3.0
"""A job that takes too long is asked to stop; after this time its process is killed."""
BACK_OFF_S = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Before a renderer is started again that did not live long."""
LONG_LIFE_S = 20.0


@dataclass(eq=False)
class Running:
    """A job that the process has."""

    waiting: Waiting
    express: bool
    begin: float
    timer: asyncio.TimerHandle | None = None
    late: bool = False


class RendererProcess:
    """One renderer and the jobs that wait for it.

    Args:
        room: jobs that may wait.
        spare: what stands ready for its next life.
        first: of its first life, begun already.
        pauses: told when keyframes are made, and when there is work that gives way to them.
    """

    def __init__(
        self,
        kind: Kind,
        room: int,
        metrics: Metrics,
        *,
        spare: Spare | None = None,
        first: Process | None = None,
        pauses: Pauses | None = None,
    ) -> None:
        self.kind = kind
        self._spare = spare
        self._first = first
        self._pauses = pauses or Pauses()
        self._metrics = metrics
        self.queue = FairQueue(room)
        self._running: dict[int, Running] = {}
        self._serials = itertools.count(NO_JOB + 1)
        self._process: asyncio.subprocess.Process | None = None
        self._handshake = False
        self._stopped = False
        self._draining = False
        self._wanted = asyncio.Event()
        self._evicted = 0
        self._scenes: set[str] = set()  # that this life of the process has done jobs for
        self._task: asyncio.Task[None] | None = None

    @property
    def name(self) -> str:
        """For logs."""
        return self.kind.name

    @property
    def load(self) -> int:
        """Jobs waiting or running."""
        return len(self.queue) + len(self._running)

    def has(self, rank: Rank) -> bool:
        """Whether a job of a class waits or runs."""
        return self.queue.has(rank) or any(running.waiting.rank is rank for running in self._running.values())

    def has_scene(self, job: Job) -> bool:
        """Whether the process need not load anything for a job first."""
        source = getattr(job, "scene", None)
        return not isinstance(source, SceneSource) or source.id in self._scenes

    @property
    def ready(self) -> bool:
        """The process runs and has said so."""
        return self._handshake and self._process is not None and self._process.returncode is None

    @property
    def pid(self) -> int | None:
        """Of the process, if there is one."""
        return None if self._process is None else self._process.pid

    # ------------------------------------------------------------------ jobs

    async def submit(self, job: Job, asked: Asked | None = None) -> dict[str, Any]:
        """Wait for a job's turn and result. Whoever stops waiting takes the job back.

        Raises:
            ServiceError: what the renderer says, 429 no more jobs may wait, 503 it stops or has died.
        """
        asked = asked or Asked()
        rank = rank_of(job) if asked.rank is None else asked.rank
        if self._stopped or self._draining:
            raise ServiceError(503, "stopping", "the server is stopping", retry_after_s=RETRY_S)
        self.queue.check_room(asked.client, rank, len(self._running))
        waiting = self._put(job, asked, rank)
        try:
            return await waiting.result
        except asyncio.CancelledError:
            self._leave(waiting)
            raise

    def post(self, job: Forget) -> None:
        """Do a job whose outcome nobody asks for."""
        self._scenes.discard(job.scene or "")
        waiting = self._put(job, Asked(), Rank.STREAM)
        waiting.result.add_done_callback(lambda done: done.cancelled() or done.exception())

    def _put(self, job: Job, asked: Asked, rank: Rank) -> Waiting:
        waiting = Waiting(job, asyncio.get_running_loop().create_future(), asked, rank)
        self.queue.put(waiting)
        self._wanted.set()
        self._pump()
        return waiting

    def _leave(self, waiting: Waiting) -> None:
        self.queue.leave(waiting)
        for serial, running in self._running.items():
            if running.waiting is waiting:
                self._metrics.count("jobs_cancelled")
                self._write(Cancel(serial=serial))

    def _pump(self) -> None:
        """Give the process what it may do now."""
        while self.ready:
            ranks = [running.waiting.rank for running in self._running.values()]
            if not ranks:
                waiting, express = self.queue.take(), False
            elif self.kind.express and len(ranks) == 1 and (most := more_urgent(ranks[0])) is not None:
                waiting, express = self.queue.take(most), True
            else:
                return
            if waiting is None:
                return
            self._give(waiting, express)

    def _give(self, waiting: Waiting, express: bool) -> None:
        serial, now = next(self._serials), time.monotonic()
        waiting.asked.waited_s = now - waiting.since
        self._metrics.observe("queue_wait_seconds", waiting.asked.waited_s, rank=waiting.rank.name.lower())
        running = self._running[serial] = Running(waiting, express, now)
        running.timer = asyncio.get_running_loop().call_later(self.kind.job_s, self._too_slow, serial)
        self._write(Task(serial=serial, job=waiting.job, express=express, threads=waiting.asked.threads))
        self._tell_pauses()

    def _tell_pauses(self) -> None:
        if self.kind.gives_way:
            (self._pauses.join if self._running else self._pauses.leave)(self._process)
        else:
            self._pauses.note(self.name, any(is_moving(one.waiting.job) for one in self._running.values()))

    def _write(self, message: Task | Cancel) -> None:
        if self._process is not None:
            write_message(self._process, message)

    def _too_slow(self, serial: int) -> None:
        """Ask the job to stop; where that does not help, end the process."""
        running = self._running.get(serial)
        if running is None:
            return
        if running.late:
            kill_process(self._process)
            return
        running.late = True
        detail = f"took longer than {self.kind.job_s:g} s: ask for a smaller picture"
        fail(running.waiting, ServiceError(422, "too-slow", detail))
        self._write(Cancel(serial=serial))
        running.timer = asyncio.get_running_loop().call_later(STOP_S, self._too_slow, serial)

    def _finish(self, reply: Reply) -> None:
        running = self._running.pop(reply.serial, None)
        if running is None:
            return
        if running.timer is not None:
            running.timer.cancel()
        self._tell_pauses()
        waiting = running.waiting
        self._metrics.observe("job_seconds", time.monotonic() - running.begin, kind=type(waiting.job).__name__)
        self._metrics.set("renderer_memory_bytes", reply.memory_mb * 2**20, renderer=self.name)
        self._metrics.set("renderer_kept_bytes", reply.kept_mb * 2**20, renderer=self.name)
        if reply.evictions > self._evicted:
            self._metrics.count("renderer_evictions", reply.evictions - self._evicted, renderer=self.name)
        self._evicted = reply.evictions
        if reply.failure is not None:
            fail(waiting, ServiceError(reply.failure.status, reply.failure.kind, reply.failure.detail))
            return
        if isinstance(source := getattr(waiting.job, "scene", None), SceneSource):
            self._scenes.add(source.id)
        if not waiting.result.done():
            waiting.result.set_result(reply.result or {})

    # ------------------------------------------------------------------ life

    def start(self) -> None:
        """Begin to work."""
        if self.kind.eager:
            self._wanted.set()
        self._task = asyncio.create_task(self._live(), name=f"renderer {self.name}")

    def prepare(self) -> None:
        """Run from now on, also before the first job."""
        self._wanted.set()

    async def drain(self) -> None:
        """Take no more jobs, and give back those that have not begun."""
        self._draining = True
        for waiting in self.queue.drain():
            fail(waiting, ServiceError(503, "stopping", "the server is stopping", retry_after_s=RETRY_S))
        while self._running and not self._stopped:
            await asyncio.sleep(0.02)

    async def stop(self) -> None:
        """End the process; jobs that wait fail."""
        self._stopped = True
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        self._fail_all(ServiceError(503, "stopping", "the server is stopping", retry_after_s=RETRY_S), queued=True)
        await self._end()

    async def _live(self) -> None:
        """One life after the other."""
        failures = 0
        while not self._stopped:
            await self._wanted.wait()
            begin = time.monotonic()
            try:
                await self._begin()
                await self._serve()
            except ServiceError as error:
                LOG.error("renderer %s: %s", self.name, error.detail)
                self._fail_all(error, queued=True)
            except Exception:
                LOG.exception("renderer %s", self.name)
                self._fail_all(ServiceError(500, "internal", "the renderer cannot be reached"), queued=False)
            await self._end()
            self._handshake, self._evicted = False, 0
            self._scenes.clear()
            if not self.kind.eager and not len(self.queue):
                self._wanted.clear()
            failures = 0 if time.monotonic() - begin > LONG_LIFE_S else failures + 1
            await asyncio.sleep(BACK_OFF_S[min(max(0, failures - 1), len(BACK_OFF_S) - 1)])

    async def _serve(self) -> None:
        """Until the process ends."""
        process = self._process
        assert process is not None and process.stdout is not None
        self._handshake = True
        self._pump()
        try:
            while True:
                self._finish(REPLY_DECODER.decode(await read_message(process.stdout)))
                self._pump()
        except (asyncio.IncompleteReadError, ConnectionError):
            doing = [type(running.waiting.job).__name__ for running in self._running.values()]
            late = any(running.late for running in self._running.values())
            self._metrics.count("renderers_restarted")
            if not late:
                self._metrics.count("renderer_deaths", renderer=self.name)
            facts = {"renderer": self.name, "pid": process.pid, "during": doing, "too_slow": late}
            LOG.error("a renderer ended; the next one starts", extra=facts)
            error = ServiceError(503, "renderer-stopped", "the renderer stopped; try again", retry_after_s=RETRY_S)
            self._fail_all(error, queued=False)

    def _fail_all(self, error: ServiceError, *, queued: bool) -> None:
        running, self._running = self._running, {}
        self._tell_pauses()
        for one in running.values():
            if one.timer is not None:
                one.timer.cancel()
            fail(one.waiting, error)
        for waiting in self.queue.drain() if queued else []:
            fail(waiting, error)

    async def _begin(self) -> None:
        """Start the process and wait until it says that it is there; or take the one that stands ready."""
        first, self._first = self._first, None
        self._process = None if self._spare is None else self._spare.take()
        if first is not None:
            self._process = await greeted(first)
        elif self._process is None:
            self._process = await start_process(self.kind)
        LOG.info("renderer started", extra={"renderer": self.name, "pid": self._process.pid})

    async def _end(self) -> None:
        process, self._process = self._process, None
        await end_process(process)
