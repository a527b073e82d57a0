"""The renderer process: reads jobs from its standard input, answers on its standard output.

One message is eight bytes of length and msgpack. A process of its own keeps the server answering while all cores
render, survives what a scene may do to memory, and can be stopped.
"""

from __future__ import annotations

import logging
import os
import signal
import struct
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

import msgspec

from torchrender.errors import SceneFileError, TorchRenderError
from torchrender_service.errors import ServiceError, out_of_memory
from torchrender_service.imports import lasting_imports
from torchrender_service.logs import hearing, set_up_logs
from torchrender_service.renderers.jobs import Job, Locate, Render, SceneSource
from torchrender_service.renderers.processes.desk import Cancelled, Desk
from torchrender_service.renderers.processes.messages import (
    JOB_DECODER,
    REPLY_ENCODER,
    TASK_DECODER,
    Failure,
    Reply,
    SentTask,
)
from torchrender_service.scheduling import give_way, go_on_when_alone

if TYPE_CHECKING:
    from torchrender_service.renderers.job_runner import JobRunner

LOG = logging.getLogger("torchrender_service.renderers.worker")
LENGTH = struct.Struct("<Q")
BEGUN, READY = "begun", "ready"
"""What a process says before its first job: that it may be stopped, and that it takes jobs."""
_TEXT = 500
NICENESS = 2
"""Renderers give way to the server, which has little to do but must do it at once."""


class ServerGone(BaseException):
    """Nobody reads replies any more. No ``Exception``: a job in whose midst another one was answered is no failure."""


class Needs(msgspec.Struct):
    """What can be told of a job without reading all of it."""

    type: str = ""  # its class
    scene: SceneSource | None = None


_NEEDS = msgspec.msgpack.Decoder(Needs)


def needs_of(task: SentTask) -> Needs:
    """What a task needs; nothing where it cannot be read, which is said when it is done."""
    try:
        return _NEEDS.decode(task.job)
    except msgspec.DecodeError:
        return Needs()


def main() -> int:
    """Serve until standard input ends."""
    # Replies own the pipe; whatever else prints goes to the log.
    out = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    set_up_logs("warning")  # below that compilers write whole books
    go_on_when_alone()
    try:
        _serve(out)
    except ServerGone:
        LOG.warning("the server is gone: its renderer ends")
        os._exit(1)  # the thread that reads may still wait with standard input, which nobody could close in order
    return 0


def _serve(out: BinaryIO) -> None:
    _send(out, REPLY_ENCODER.encode(Reply(result={BEGUN: True})))
    niceness = int(os.environ.get("TORCHRENDER_RENDERER_NICENESS", str(NICENESS)))
    if niceness > NICENESS:
        give_way(niceness)
    # Interrupts from a terminal reach the whole group; the server ends its renderers itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with lasting_imports():
        from torchrender_service.renderers.job_runner import JobRunner

    limit_mb = int(os.environ.get("TORCHRENDER_RENDERER_LIMIT_MB", "0"))
    runner = JobRunner(limit_mb, textures_mb=int(os.environ.get("TORCHRENDER_RENDERER_TEXTURES_MB", "0")))
    if niceness <= NICENESS:  # not before: streams wait until it has started
        give_way(niceness)
    _limit_memory(limit_mb)

    def work(task: SentTask) -> None:
        job, reply = _reply(runner, desk, task)
        _send(out, REPLY_ENCODER.encode(reply))
        if job is not None:
            runner.tidy(job)

    def ahead(task: SentTask) -> Callable[[], None] | None:
        needs = needs_of(task)
        return runner.ahead(needs.scene, parts=needs.type in (Locate.__name__, Render.__name__))

    desk = Desk(work, ahead)
    _send(out, REPLY_ENCODER.encode(Reply(result={READY: True})))
    threading.Thread(target=_read_tasks, args=(sys.stdin.buffer, desk), daemon=True).start()
    desk.run()


def _read_tasks(source: BinaryIO, desk: Desk) -> None:
    """Everything that comes, until the server is gone."""
    try:
        while (data := _receive(source)) is not None:
            desk.put(TASK_DECODER.decode(data))
    finally:
        desk.close()


def _reply(runner: JobRunner, desk: Desk, task: SentTask) -> tuple[Job | None, Reply]:
    """The job, None where it was not begun, and what is answered."""
    job, result, failure = None, None, None
    try:
        if desk.cancelled(task):
            raise Cancelled
        job = JOB_DECODER.decode(task.job)
        scene = getattr(job, "scene", None)
        with threads(task.threads), hearing(scene.id if isinstance(scene, SceneSource) else ""):
            result = runner.run(job)
    except Cancelled:
        failure = Failure(status=499, kind="cancelled", detail="nobody waits for it")
    except Exception as error:
        failure = failure_of(error)
    kept = runner.kept_bytes / 2**20
    reply = Reply(serial=task.serial, memory_mb=_resident_mb(), kept_mb=kept, evictions=runner.evictions)
    return job, msgspec.structs.replace(reply, result=result, failure=failure)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """At most so many threads of this process for kernels and tensors; 0: all."""
    import torch

    from torchrender.kernels.threads import exact_threads, most_threads

    wanted, before = count or most_threads(), torch.get_num_threads()
    with exact_threads(wanted):
        if wanted != before:
            torch.set_num_threads(wanted)
        try:
            yield
        finally:
            if wanted != before:
                torch.set_num_threads(before)


def failure_of(error: Exception) -> Failure:
    """What clients are told about an error; paths of this machine stay here."""
    if isinstance(error, ServiceError):
        return Failure(status=error.status, kind=error.kind, detail=_plain(error.detail))
    if isinstance(error, SceneFileError):
        where = f"{error.key}: " if error.key else ""
        return Failure(status=422, kind="scene-file", detail=_plain(where + error.reason))
    if isinstance(error, msgspec.ValidationError):
        return Failure(status=422, kind="invalid-value", detail=_plain(f"the job cannot be read: {error}"))
    if isinstance(error, TorchRenderError):
        return Failure(status=422, kind="invalid-value", detail=_plain(str(error)))
    if out_of_memory(error):
        return Failure(status=422, kind="too-large", detail="needs more memory than a renderer may take")
    LOG.error("job failed\n%s", traceback.format_exc())
    return Failure(status=500, kind="internal", detail="the renderer met an error of its own; it is in the log")


def _resident_mb() -> float:
    """Memory of this process; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    except (OSError, ValueError, IndexError, AttributeError):
        return 0.0


def _plain(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode()[:_TEXT]


def _limit_memory(megabytes: int) -> None:
    """Let the process take this much more address space than it has now; without a limit where systems know none."""
    if megabytes <= 0 or sys.platform != "linux":
        return
    import resource

    with open("/proc/self/statm") as file:
        pages = int(file.read().split()[0])
    limit = pages * resource.getpagesize() + megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _send(out: BinaryIO, data: bytes) -> None:
    view = memoryview(LENGTH.pack(len(data)) + data)
    try:
        while view:
            view = view[out.write(view) :]
    except ConnectionError as error:
        raise ServerGone from error


def _receive(source: BinaryIO) -> bytes | None:
    head = source.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (size,) = LENGTH.unpack(head)
    data = source.read(size)
    return data if len(data) == size else None


if __name__ == "__main__":
    sys.exit(main())
