"""Whose job comes next: the most urgent class first, its clients in turn, and nobody for ever last."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import Any

from torchrender_service.errors import ServiceError
from torchrender_service.renderers.asked import Asked, Rank
from torchrender_service.renderers.jobs import Job

PATIENCE_S = {Rank.INTERACTIVE: 2.0, Rank.BATCH: 10.0}
"""After this time a job comes before those of more urgent classes, one at a time."""
RETRY_S = 2.0
SHARE = 4
"""One in so many of the places to wait is kept for others, whoever has the rest."""


@dataclass(eq=False)
class Waiting:
    """A job and who waits for it."""

    job: Job
    result: asyncio.Future[dict[str, Any]]
    asked: Asked = field(default_factory=Asked)
    rank: Rank = Rank.INTERACTIVE
    since: float = field(default_factory=time.monotonic)


class FairQueue:
    """Jobs that wait for one renderer.

    Args:
        room: how many may wait.
    """

    def __init__(self, room: int) -> None:
        self._room = room
        self._classes: dict[Rank, OrderedDict[str, deque[Waiting]]] = {rank: OrderedDict() for rank in Rank}
        self._favour: float = 0.0  # when a job of a less urgent class was last let through

    def __len__(self) -> int:
        return sum(len(jobs) for clients in self._classes.values() for jobs in clients.values())

    def has(self, rank: Rank) -> bool:
        """Whether a job of a class waits."""
        return bool(self._classes[rank])

    def check_room(self, client: str, rank: Rank, running: int = 0) -> None:
        """Whether one more may wait. Streams ask for one keyframe at a time, and are as many as there may be sessions.

        Raises:
            ServiceError: 429, this client or all together have too many.
        """
        if rank <= Rank.STREAM:
            return
        if len(self) + running >= self._room:
            raise ServiceError(429, "busy", "too many requests wait for a renderer", retry_after_s=RETRY_S)
        own = sum(len(clients.get(client, ())) for clients in self._classes.values())
        if own >= self._room - self._room // SHARE:
            detail = "too many requests of this address wait for a renderer"
            raise ServiceError(429, "busy", detail, retry_after_s=RETRY_S)

    def put(self, waiting: Waiting) -> None:
        """Wait."""
        self._classes[waiting.rank].setdefault(waiting.asked.client, deque()).append(waiting)

    def take(self, most: Rank = Rank.BATCH) -> Waiting | None:
        """The next job of a class that is as urgent as ``most`` or more; jobs that nobody waits for are left out."""
        while True:
            rank = self._next_class(most)
            if rank is None:
                return None
            clients = self._classes[rank]
            client, jobs = next(iter(clients.items()))
            waiting = jobs.popleft()
            if jobs:
                clients.move_to_end(client)
            else:
                del clients[client]
            if not waiting.result.done():
                return waiting

    def leave(self, waiting: Waiting) -> None:
        """Wait no longer; does nothing for a job that was taken."""
        clients = self._classes[waiting.rank]
        jobs = clients.get(waiting.asked.client)
        if jobs is not None and waiting in jobs:
            jobs.remove(waiting)
            if not jobs:
                del clients[waiting.asked.client]

    def drain(self) -> list[Waiting]:
        """Everything that waits, taken out."""
        found = [one for clients in self._classes.values() for jobs in clients.values() for one in jobs]
        for clients in self._classes.values():
            clients.clear()
        return found

    def _next_class(self, most: Rank) -> Rank | None:
        there = [rank for rank in Rank if rank <= most and self._classes[rank]]
        if not there:
            return None
        now = time.monotonic()
        for rank in reversed(there[1:]):
            patience = PATIENCE_S[rank]
            if now - self._oldest(rank) > patience and now - self._favour > patience:
                self._favour = now
                return rank
        return there[0]

    def _oldest(self, rank: Rank) -> float:
        return min(jobs[0].since for jobs in self._classes[rank].values())


def fail(waiting: Waiting, error: ServiceError) -> None:
    """Tell whoever waits for a job that it has failed."""
    if not waiting.result.done():
        copied = ServiceError(error.status, error.kind, error.detail, retry_after_s=error.retry_after_s)
        waiting.result.set_exception(copied)


def more_urgent(rank: Rank) -> Rank | None:
    """The least urgent class whose jobs need not wait for one of this class that runs; None: all wait."""
    return Rank.STREAM if rank > Rank.STREAM else Rank.GLANCE if rank is Rank.STREAM else None
