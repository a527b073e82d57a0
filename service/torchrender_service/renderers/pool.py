"""The bounded pool of renderer processes, as the server sees it.

Each renderer does one job at a time, first come first served, with a fixed number of threads; so all renderers together
use the cores and no more. Jobs of one session always go to the same renderer, which keeps what its pictures share.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import JOB_ENCODER, REPLY_DECODER, Forget, Job
from torchrender_service.renderers.kernels import KernelPreparation
from torchrender_service.renderers.worker import LENGTH
from torchrender_service.settings import Settings

LOG = logging.getLogger("torchrender_service.renderers.pool")
START_S = 120.0
RETRY_S = 2.0
MAX_REPLY_BYTES = 2**32


@dataclass(eq=False)
class Waiting:
    """A job and who waits for it."""

    job: Job
    result: asyncio.Future[dict[str, Any]]
    since: float = field(default_factory=time.monotonic)


class RendererProcess:
    """One renderer and the jobs that wait for it."""

    def __init__(self, settings: Settings, metrics: Metrics, name: str, memory_mb: int) -> None:
        self._settings = settings
        self._metrics = metrics
        self._memory_mb = memory_mb
        self.name = name
        self.queue: asyncio.Queue[Waiting] = asyncio.Queue()
        self.busy = False
        self._stopped = False  # ``wait_for`` may lose a cancellation that comes together with a reply
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def load(self) -> int:
        """Jobs waiting or running."""
        return self.queue.qsize() + self.busy

    @property
    def ready(self) -> bool:
        """The process runs."""
        return self._process is not None and self._process.returncode is None

    @property
    def pid(self) -> int | None:
        """Of the process, if there is one."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Begin to work; the process starts with the first job or :meth:`warm_up`."""
        self._task = asyncio.create_task(self._work(), name=f"renderer {self.name}")

    async def stop(self) -> None:
        """End the process; jobs that wait fail."""
        self._stopped = True
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        while not self.queue.empty():
            _fail(
                self.queue.get_nowait(), ServiceError(503, "stopping", "the server is stopping", retry_after_s=RETRY_S)
            )
        await self._end()

    async def _work(self) -> None:
        while not self._stopped:
            waiting = await self.queue.get()
            if waiting.result.done():  # nobody waits any more
                continue
            self.busy = True
            try:
                result = await self._do(waiting.job)
                if not waiting.result.done():
                    waiting.result.set_result(result)
            except asyncio.CancelledError:
                _fail(waiting, ServiceError(503, "stopping", "the server is stopping", retry_after_s=RETRY_S))
                raise
            except ServiceError as error:
                _fail(waiting, error)
            except Exception:
                LOG.exception("renderer %s", self.name)
                await self._end()
                _fail(waiting, ServiceError(500, "internal", "the renderer cannot be reached"))
            finally:
                self.busy = False

    async def _do(self, job: Job) -> dict[str, Any]:
        kind = type(job).__name__
        if not self.ready:
            await self._begin()
        begin = time.monotonic()
        try:
            reply = await asyncio.wait_for(self._exchange(JOB_ENCODER.encode(job)), self._settings.job_s)
        except asyncio.TimeoutError:
            await self._end()
            self._metrics.count("renderers_restarted")
            detail = f"took longer than {self._settings.job_s:g} s: ask for a smaller picture"
            raise ServiceError(422, "too-slow", detail) from None
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            await self._end()
            self._metrics.count("renderers_restarted")
            LOG.error("renderer %s died during %s", self.name, kind)
            raise ServiceError(
                503, "renderer-stopped", "the renderer stopped; try again", retry_after_s=RETRY_S
            ) from error
        self._metrics.observe("job_seconds", time.monotonic() - begin, kind=kind)
        message = REPLY_DECODER.decode(reply)
        if message.failure is not None:
            failure = message.failure
            raise ServiceError(failure.status, failure.kind, failure.detail)
        return message.result or {}

    async def warm_up(self) -> None:
        """Start the process if it does not run."""
        await self.submit(Forget())

    async def submit(self, job: Job) -> dict[str, Any]:
        """Wait for a job's turn and result."""
        waiting = Waiting(job, asyncio.get_running_loop().create_future())
        self.queue.put_nowait(waiting)
        return await waiting.result

    async def _exchange(self, data: bytes) -> bytes:
        process = self._process
        assert process is not None and process.stdin is not None and process.stdout is not None
        process.stdin.write(LENGTH.pack(len(data)))
        process.stdin.write(data)
        await process.stdin.drain()
        return await self._read(process.stdout)

    async def _read(self, stream: asyncio.StreamReader) -> bytes:
        (size,) = LENGTH.unpack(await stream.readexactly(LENGTH.size))
        if size > MAX_REPLY_BYTES:
            raise ConnectionError(f"reply of {size} bytes")
        return await stream.readexactly(size)

    async def _begin(self) -> None:
        threads = str(self._settings.renderer_threads)
        names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
        environment = {k: v for k, v in os.environ.items() if k != "TORCHRENDER_API_KEY"}
        environment |= dict.fromkeys(names, threads)
        environment |= {"OMP_WAIT_POLICY": "PASSIVE", "TORCHRENDER_RENDERER_LIMIT_MB": str(self._memory_mb)}
        pipe = asyncio.subprocess.PIPE
        command = (sys.executable, "-m", "torchrender_service.renderers.worker")
        self._process = await asyncio.create_subprocess_exec(
            *command, stdin=pipe, stdout=pipe, env=environment, limit=2**22
        )
        assert self._process.stdout is not None
        try:
            await asyncio.wait_for(self._read(self._process.stdout), START_S)
        except (asyncio.TimeoutError, asyncio.IncompleteReadError) as error:
            await self._end()
            raise ServiceError(503, "renderer-stopped", "the renderer does not start", retry_after_s=RETRY_S) from error
        LOG.info("renderer started", extra={"renderer": self.name, "pid": self._process.pid, "threads": threads})

    async def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()


@dataclass(frozen=True, eq=False)
class AssignedProcess(RendererHandle):
    """A renderer of this pool; every session has a handle of its own."""

    process: RendererProcess


class Pool:
    """All renderers, and one apart that looks at uploads before they are kept: a ``RendererPool`` of processes."""

    def __init__(self, settings: Settings, metrics: Metrics) -> None:
        count, memory = settings.renderer_count, settings.renderer_memory_mb
        self._settings = settings
        self._renderers = [RendererProcess(settings, metrics, str(k), memory) for k in range(count)]
        # A file that is built to exhaust memory or time only stops this one.
        self._inspector = RendererProcess(settings, metrics, "inspector", memory // 2)
        self._kernels = KernelPreparation()
        self._assigned: set[RendererHandle] = set()
        self._closed = False

    def start(self) -> None:
        """Begin to take jobs."""
        for renderer in (*self._renderers, self._inspector):
            renderer.start()

    async def warm_up(self) -> None:
        """Start all renderers, and compile what they will need."""
        await asyncio.gather(self._kernels.run(), *(r.warm_up() for r in self._renderers))

    async def stop(self) -> None:
        """End all processes."""
        self._closed = True
        await asyncio.gather(*(r.stop() for r in (*self._renderers, self._inspector)))

    @property
    def ready(self) -> bool:
        """All renderers run, and the kernels of first keyframes are compiled."""
        return self._kernels.finished and all(r.ready for r in self._renderers)

    @property
    def progress(self) -> str:
        """What is still going on before it is ready, or behind that."""
        return "starting renderers" if self._kernels.finished and not self.ready else self._kernels.text

    def assign(self) -> RendererHandle:
        """The renderer that the fewest sessions have, among equals the one with the least to do."""
        sessions = Counter(self._process(handle).name for handle in self._assigned)
        handle = AssignedProcess(min(self._renderers, key=lambda r: (sessions[r.name], r.load)))
        self._assigned.add(handle)
        return handle

    def release(self, renderer: RendererHandle) -> None:
        """The session is over; a second time does nothing."""
        self._assigned.discard(renderer)

    def idle(self, renderer: RendererHandle) -> bool:
        """Whether a renderer has nothing to do."""
        return self._process(renderer).load == 0

    @property
    def waiting(self) -> int:
        """Jobs waiting or running."""
        return sum(r.load for r in self._renderers)

    @property
    def pids(self) -> list[int]:
        """Of the processes that run."""
        return [r.pid for r in (*self._renderers, self._inspector) if r.pid is not None]

    async def run(self, job: Job, *, renderer: RendererHandle | None = None) -> dict[str, Any]:
        """The result of a job.

        Args:
            renderer: of :meth:`assign`; None: the one with the least to do.

        Raises:
            ServiceError: what the renderer says about the job, 429 where too many jobs wait, 503 while stopping.
        """
        chosen = min(self._renderers, key=lambda r: r.load) if renderer is None else self._process(renderer)
        return await self._put(chosen, job)

    async def inspect(self, job: Job) -> dict[str, Any]:
        """The result of a job that may do harm, from the process apart."""
        return await self._put(self._inspector, job)

    def forget(self, job: Forget) -> None:
        """Tell all renderers that run, without waiting."""
        for renderer in self._renderers:
            if renderer.ready and not self._closed:
                future: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
                # Nobody asks for the outcome.
                future.add_done_callback(lambda done: done.cancelled() or done.exception())
                renderer.queue.put_nowait(Waiting(job, future))

    def _process(self, renderer: RendererHandle) -> RendererProcess:
        if not isinstance(renderer, AssignedProcess) or renderer.process not in self._renderers:
            raise TypeError(f"renderer must be a handle of this pool, got {renderer!r}")
        return renderer.process

    async def _put(self, renderer: RendererProcess, job: Job) -> dict[str, Any]:
        if self._closed:
            raise ServiceError(503, "stopping", "the server is stopping", retry_after_s=RETRY_S)
        if renderer.load >= self._settings.waiting:
            raise ServiceError(429, "busy", "too many requests wait for a renderer", retry_after_s=RETRY_S)
        return await renderer.submit(job)


def _fail(waiting: Waiting, error: ServiceError) -> None:
    if not waiting.result.done():
        waiting.result.set_exception(error)
