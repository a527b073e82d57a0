"""Renders in a thread of this process, where the program's own scenes are: no copy of them is made."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from torchrender.clock import interruptible
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.asked import Asked
from torchrender_service.renderers.contract import RendererHandle, RendererPool
from torchrender_service.renderers.job_runner import JobRunner
from torchrender_service.renderers.jobs import (
    JOB_DECODER,
    JOB_ENCODER,
    REPLY_DECODER,
    REPLY_ENCODER,
    Forget,
    Job,
    Reply,
)
from torchrender_service.renderers.processes.desk import Cancelled
from torchrender_service.renderers.worker import failure_of
from torchrender_service.viewer.live_scenes import LiveScenes


class ThreadPool(RendererPool):
    """One renderer, one job at a time."""

    ready, progress = True, ""

    def __init__(self, scenes: LiveScenes) -> None:
        self._runner = JobRunner(scenes=scenes)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="torchrender-viewer")
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
            return await asyncio.get_running_loop().run_in_executor(self._thread, self._run, job, left)
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
                self._thread.submit(self._run, job, threading.Event())

    def _run(self, job: Job, left: threading.Event) -> dict[str, Any]:
        """A job, in the thread; it ends between two passes of a picture once nobody waits for it.

        Job and result go through their messages, so that both are what they are between two processes.
        """

        def check() -> None:
            if left.is_set():
                raise Cancelled

        try:
            with interruptible(check):
                reply = Reply(result=self._runner.run(JOB_DECODER.decode(JOB_ENCODER.encode(job))))
            return REPLY_DECODER.decode(REPLY_ENCODER.encode(reply)).result or {}
        except Cancelled:
            raise ServiceError(499, "cancelled", "nobody waits for it") from None
        except Exception as error:
            failure = failure_of(error)
            raise ServiceError(failure.status, failure.kind, failure.detail) from error
