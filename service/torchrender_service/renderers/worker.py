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
import traceback
from typing import BinaryIO

import msgspec

from torchrender.errors import SceneFileError, TorchRenderError
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import JOB_DECODER, Failure, Reply

LENGTH = struct.Struct("<Q")
_ENCODER = msgspec.msgpack.Encoder()
_TEXT = 500
NICENESS = 2
"""Renderers give way to the server, which has little to do but must do it at once."""


def main() -> int:
    """Serve until standard input ends."""
    # Replies own the pipe; whatever else prints goes to the log.
    out = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    # Interrupts from a terminal reach the whole group; the server ends its renderers itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from torchrender_service.renderers.job_runner import JobRunner

    runner = JobRunner()
    _limit_memory(int(os.environ.get("TORCHRENDER_RENDERER_LIMIT_MB", "0")))
    _send(out, _ENCODER.encode(Reply(result={"ready": True})))
    while True:
        data = _receive(sys.stdin.buffer)
        if data is None:
            return 0
        try:
            reply = Reply(result=runner.run(JOB_DECODER.decode(data)))
        except Exception as error:
            reply = Reply(failure=failure_of(error))
        _send(out, _ENCODER.encode(reply))


def failure_of(error: Exception) -> Failure:
    """What clients are told about an error; paths of this machine stay here."""
    if isinstance(error, ServiceError):
        return Failure(status=error.status, kind=error.kind, detail=_plain(error.detail))
    if isinstance(error, SceneFileError):
        where = f"{error.key}: " if error.key else ""
        return Failure(status=422, kind="scene-file", detail=_plain(where + error.reason))
    if isinstance(error, TorchRenderError):
        return Failure(status=422, kind="invalid-value", detail=_plain(str(error)))
    if isinstance(error, MemoryError) or "allocate memory" in str(error):
        return Failure(status=422, kind="too-large", detail="needs more memory than a renderer may take")
    logging.getLogger("torchrender_service.renderers.worker").error("job failed\n%s", traceback.format_exc())
    return Failure(status=500, kind="internal", detail="the renderer met an error of its own; it is in the log")


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
    while view:
        view = view[out.write(view) :]


def _receive(source: BinaryIO) -> bytes | None:
    head = source.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (size,) = LENGTH.unpack(head)
    data = source.read(size)
    return data if len(data) == size else None


if __name__ == "__main__":
    sys.exit(main())
