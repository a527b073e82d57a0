"""Starting a renderer's process, and one more that stands ready to take the place of one that dies."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sys
from dataclasses import dataclass, replace
from typing import Any

from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import WarmUp
from torchrender_service.renderers.processes.messages import JOB_ENCODER, REPLY_DECODER, Cancel, Task
from torchrender_service.renderers.processes.pauses import Pauses
from torchrender_service.renderers.processes.schedule import RETRY_S
from torchrender_service.renderers.worker import BEGUN, LENGTH, READY
from torchrender_service.settings import Settings

LOG = logging.getLogger("torchrender_service.renderers.processes.start")
START_S = 300.0
"""On a machine that has much else to do; ending it sooner would only begin the same again."""
NEXT_SPARE_S = 3.0
"""After one was taken: whoever took it has more to do now than the next spare one."""
FIRST_PICTURE_S = 4.0
"""So long it gives way to keyframes once it has started: its first picture takes about as long where it does."""
MAX_REPLY_BYTES = 2**32
NO_JOB = 0
"""Jobs are numbered from the next one on."""
Process = asyncio.subprocess.Process


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What a renderer is for."""

    name: str
    memory_mb: int
    job_s: float
    threads: int = 1
    textures_mb: int = 0  # of a scene; 0: all
    niceness: int = 2
    eager: bool = True  # runs from the start, not from its first job
    express: bool = True  # keyframes need not wait for the job that runs
    gives_way: bool = False  # stands still while keyframes are made elsewhere


def kind_of(settings: Settings, name: str, **changes: Any) -> Kind:
    """A renderer as streams have it, or one that differs in some way."""
    kind = Kind(
        name=name,
        memory_mb=settings.memory_mb,
        job_s=settings.job_s,
        threads=settings.renderer_threads,
        textures_mb=settings.max_texture_mb,
    )
    return replace(kind, **changes)


async def read_message(stream: asyncio.StreamReader) -> bytes:
    """One message of a renderer.

    Raises:
        IncompleteReadError, ConnectionError: it has ended.
    """
    (size,) = LENGTH.unpack(await stream.readexactly(LENGTH.size))
    if size > MAX_REPLY_BYTES:
        raise ConnectionError(f"reply of {size} bytes")
    return await stream.readexactly(size)


def write_message(process: Process, message: Task | Cancel) -> None:
    """One message to a renderer; one that has ended gets none: whoever reads notices."""
    if process.stdin is not None and not process.stdin.is_closing():
        data = JOB_ENCODER.encode(message)
        process.stdin.write(LENGTH.pack(len(data)) + data)


async def start_process(kind: Kind) -> Process:
    """A process that has said that it is there. Errors as :func:`greeted`."""
    return await greeted(await begin_process(kind))


async def begin_process(kind: Kind) -> Process:
    """A process that begins to start."""
    threads = str(kind.threads)
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    environment = {k: v for k, v in os.environ.items() if k != "TORCHRENDER_API_KEY"}
    environment |= dict.fromkeys(names, threads)
    environment |= {
        "OMP_WAIT_POLICY": "PASSIVE",
        "TORCHRENDER_RENDERER_LIMIT_MB": str(kind.memory_mb),
        "TORCHRENDER_RENDERER_TEXTURES_MB": str(kind.textures_mb),
        "TORCHRENDER_RENDERER_NICENESS": str(kind.niceness),
    }
    pipe = asyncio.subprocess.PIPE
    command = (sys.executable, "-m", "torchrender_service.renderers.worker")
    return await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, env=environment, limit=2**22)


async def greeted(process: Process, what: str = READY) -> Process:
    """The same process, once it has said that it is there.

    Args:
        what: BEGUN: that it outlives nobody, whatever becomes of it; so only from then on may it be stopped.

    Raises:
        ServiceError: 503, it does not start.
    """
    assert process.stdout is not None
    try:
        await asyncio.wait_for(_told(process.stdout, what), START_S)
    except (asyncio.TimeoutError, asyncio.IncompleteReadError) as error:
        await end_process(process)
        raise ServiceError(503, "renderer-stopped", "the renderer does not start", retry_after_s=RETRY_S) from error
    except BaseException:
        await end_process(process)
        raise
    return process


async def _told(stream: asyncio.StreamReader, what: str) -> None:
    while what not in (REPLY_DECODER.decode(await read_message(stream)).result or {}):
        pass


def kill_process(process: Process | None) -> None:
    """End it now; whoever started it waits for its end."""
    if process is not None and process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            process.kill()


async def end_process(process: Process | None) -> None:
    """End it and wait."""
    kill_process(process)
    if process is not None:
        await process.wait()


class Spare:
    """A process of the kind that streams have, already started, its first picture made or on the way: what a new one
    needs most of its time for is done."""

    def __init__(self, kind: Kind, pauses: Pauses | None = None) -> None:
        self._kind = kind
        self._pauses = pauses or Pauses()
        self._process: Process | None = None
        self._task: asyncio.Task[None] | None = None

    def prepare(self, wait_s: float = 0.0) -> None:
        """Start one in the background."""
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._start(wait_s))

    def take(self) -> Process | None:
        """The process, if it runs; the next one starts in a while."""
        process, self._process = self._process, None
        if process is None or process.returncode is not None:
            return None
        self._pauses.leave(process)
        if self._task is not None:
            self._task.cancel()
        write_message(process, Cancel(serial=NO_JOB))  # a first picture that is on its way: a wanted one needs as much
        self._task = asyncio.create_task(self._start(NEXT_SPARE_S))
        return process

    @property
    def pid(self) -> int | None:
        """Of the process that stands ready."""
        return None if self._process is None else self._process.pid

    async def stop(self) -> None:
        """End it."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        process, self._process = self._process, None
        await end_process(process)

    async def _start(self, wait_s: float) -> None:
        await asyncio.sleep(wait_s)
        process = await greeted(await begin_process(self._kind), BEGUN)
        self._pauses.join(process)
        try:
            self._process = await greeted(process)
            # Whoever takes it passes over this answer, which has the number of no job of theirs.
            write_message(self._process, Task(serial=NO_JOB, job=WarmUp(), threads=1))
            await asyncio.sleep(FIRST_PICTURE_S)
        except ServiceError as error:
            LOG.warning("no renderer stands ready: %s", error.detail)
        finally:
            self._pauses.leave(process)
