"""What goes between the server and the process of a renderer: jobs with their numbers, and answers."""

from __future__ import annotations

from typing import Any

import msgspec

from torchrender_service.renderers.jobs import Job


class Task(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A job on its way to a renderer."""

    serial: int
    job: Job
    express: bool = False  # done between two passes of whatever is being done
    threads: int = 0  # at most; 0: all that the renderer has


class SentTask(msgspec.Struct, frozen=True, kw_only=True, tag="Task"):
    """A task as it arrives: a job that cannot be read is its own failure, not the renderer's."""

    serial: int
    job: msgspec.Raw
    express: bool = False
    threads: int = 0


class Cancel(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Nobody waits for a task any more."""

    serial: int


class Failure(msgspec.Struct, frozen=True, kw_only=True):
    """Why a job was not done."""

    status: int
    kind: str
    detail: str


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """What a renderer answers."""

    serial: int = 0  # of the task; 0: the renderer has started
    memory_mb: float = 0.0  # resident
    kept_mb: float = 0.0  # of scenes and histories
    evictions: int = 0  # since it started
    result: dict[str, Any] | None = None
    failure: Failure | None = None


JOB_ENCODER = msgspec.msgpack.Encoder()
JOB_DECODER = msgspec.msgpack.Decoder(Job)
TASK_DECODER = msgspec.msgpack.Decoder(SentTask | Cancel)
REPLY_ENCODER = msgspec.msgpack.Encoder()
REPLY_DECODER = msgspec.msgpack.Decoder(Reply)
