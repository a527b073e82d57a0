"""Renders in a thread of this process, where the program's own scenes are: no copy of them is made."""

from __future__ import annotations

import asyncio
import contextlib
import heapq
import itertools
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

from torchrender.clock import interruptible
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.asked import Asked, Rank, rank_of
from torchrender_service.renderers.contract import RendererHandle, RendererPool
from torchrender_service.renderers.job_runner import JobRunner
from torchrender_service.renderers.jobs import Forget, Job
from torchrender_service.renderers.processes.desk import Cancelled
from torchrender_service.renderers.processes.messages import (
    JOB_DECODER,
    JOB_ENCODER,
    REPLY_DECODER,
    REPLY_ENCODER,
    Reply,
)
from torchrender_service.renderers.worker import failure_of
from torchrender_service.scheduling import give_way
from torchrender_service.viewer.live_scenes import LiveScenes

NICENESS = 5
"""The thread, and those that its kernels start, give way to the program, and to browsers that draw on this machine."""


class Waiting(NamedTuple):
    """A job and who waits for it: the most urgent first, then the oldest."""

    rank: Rank
    number: int
    job: Job
    left: threading.Event  # nobody waits any more
    result: Future[dict[str, Any]]


class ThreadPool(RendererPool):
    """One renderer, one job at a time; more urgent ones come between two passes of what is being made."""

    ready, progress = True, ""

    def __init__(self, scenes: LiveScenes) -> None:
        self._runner = JobRunner(scenes=scenes)
        self._thread = ThreadPoolExecutor(
            1, thread_name_prefix="torchrender-viewer", initializer=give_way, initargs=(NICENESS,)
        )
        self._waiting: list[Waiting] = []  # a heap
        self._numbers = itertools.count()
        self._lock = threading.Lock()
        self._load = 0
        self._closed = False

    def start(self) -> None:
        """Nothing to do: the thread starts with its first job."""

    async def warm_up(self) -> None:
        """The first picture is wanted at once: nothing goes before it."""

    async def drain(self, seconds: float) -> None:
        """Take no more jobs; a job that runs has so long to end."""
        self._closed = True
        end = asyncio.get_running_loop().time() + seconds
        while self._load and asyncio.get_running_loop().time() < end:
            await asyncio.sleep(0.02)

    async def stop(self) -> None:
        """End the thread after the job that runs."""
        self._closed = True
        self._thread.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            for one in self._waiting:
                one.result.cancel()
            self._waiting.clear()

    def assign(self, *, background: bool = False) -> RendererHandle:
        """The only one."""
        del background
        return RendererHandle()

    def release(self, renderer: RendererHandle) -> None:
        """Others go on with it."""

    def idle(self, renderer: RendererHandle) -> bool:
        """Whether it has nothing to do."""
        del renderer
        return self._load == 0

    def alone(self, renderer: RendererHandle) -> bool:
        """The same: views of one program are few."""
        return self.idle(renderer)

    def load(self, renderer: RendererHandle) -> int:
        """Jobs that wait or run."""
        del renderer
        return self._load

    @property
    def waiting(self) -> int:
        """Jobs that wait or run."""
        return self._load

    async def run(
        self, job: Job, *, renderer: RendererHandle | None = None, asked: Asked | None = None
    ) -> dict[str, Any]:
        """The result of a job.

        Raises:
            ServiceError: what the renderer says about it, 503 while stopping.
        """
        del renderer, asked
        if self._closed:
            raise ServiceError(503, "stopping", "the viewer is closed", retry_after_s=5.0)
        self._load += 1
        left = threading.Event()
        try:
            return await asyncio.wrap_future(self._put(job, left))
        except asyncio.CancelledError:
            left.set()
            raise
        finally:
            self._load -= 1

    async def inspect(self, job: Job, asked: Asked | None = None) -> dict[str, Any]:
        """The result of a job: the program trusts whoever reaches its viewer."""
        return await self.run(job, asked=asked)

    def forget(self, job: Forget) -> None:
        """Without waiting."""
        if not self._closed:
            with contextlib.suppress(RuntimeError):  # the program ends: its threads take no more work
                self._put(job, threading.Event())

    def _put(self, job: Job, left: threading.Event) -> Future[dict[str, Any]]:
        """Have a job done in its turn."""
        result: Future[dict[str, Any]] = Future()
        with self._lock:
            heapq.heappush(self._waiting, Waiting(rank_of(job), next(self._numbers), job, left, result))
            self._thread.submit(self._next)
        return result

    def _next(self, than: Rank | None = None) -> bool:
        """Do the job whose turn it is, in the thread; False: there is none, or none more urgent ``than`` this."""
        with self._lock:
            if not self._waiting or (than is not None and self._waiting[0].rank >= than):
                return False
            one = heapq.heappop(self._waiting)
        if one.result.set_running_or_notify_cancel():
            try:
                one.result.set_result(self._run(one.job, one.left, one.rank))
            except ServiceError as error:
                one.result.set_exception(error)
        return True

    def _run(self, job: Job, left: threading.Event, rank: Rank) -> dict[str, Any]:
        """A job, in the thread; it ends between two passes of a picture once nobody waits for it.

        Job and result go through their messages, so that both are what they are between two processes.
        """

        def check() -> None:
            if left.is_set():
                raise Cancelled
            while self._next(rank):
                pass

        try:
            with interruptible(check):
                reply = Reply(result=self._runner.run(JOB_DECODER.decode(JOB_ENCODER.encode(job))))
            return REPLY_DECODER.decode(REPLY_ENCODER.encode(reply)).result or {}
        except Cancelled:
            raise ServiceError(499, "cancelled", "nobody waits for it") from None
        except Exception as error:
            failure = failure_of(error)
            raise ServiceError(failure.status, failure.kind, failure.detail) from error
