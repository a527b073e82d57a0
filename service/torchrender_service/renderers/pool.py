"""The bounded pool of renderer processes, as the server sees it.

Each renderer does one job at a time with a fixed number of threads, keyframes of streams first; so all renderers
together use the cores and no more. Jobs of one session always go to the same renderer, which keeps what its pictures
share. Batch work, such as very large pictures, has a renderer of its own, to which the system gives what the others
leave over: a keyframe never waits for it.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.asked import Asked, Rank, is_free, is_small, rank_of
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import Forget, Job, PhotoJob, WarmUp
from torchrender_service.renderers.kernels import KernelPreparation
from torchrender_service.renderers.places import Standing, place_of
from torchrender_service.renderers.processes.pauses import Pauses
from torchrender_service.renderers.processes.process import RendererProcess
from torchrender_service.renderers.processes.schedule import RETRY_S
from torchrender_service.renderers.processes.start import Process, Spare, kind_of
from torchrender_service.settings import Settings

INSPECTOR_NICENESS = 15
"""Whoever uploads waits for no picture; a file that takes long to look at must not take from others."""
INSPECTOR_S = 15.0
"""After the first pictures of the renderers it starts, if nobody has uploaded by then, and no picture is made."""
ASIDE_S = 5.0
"""After the first job of a stream the renderer of large pictures starts."""
AGAIN_S = 1.0
"""Between two looks whether a picture is made."""
AVOIDED_S = 1.0
"""So long no picture goes to the renderer of large ones any more after one waited there in vain."""
PHOTO_PATIENCE_S = 8.0
"""So long a photo that somebody waits for at a screen waits for the renderer of large pictures, which has only what
others leave over: where other programs leave nothing, or it makes a large picture, another one takes the photo."""
PHOTOS_AVOID_S = 60.0
"""And so long photos go there at once then."""
AT_REST_S = 5.0
"""A session that has asked for nothing for so long, connected or not, keeps no renderer for itself: what it asks for
next comes before pictures all the same."""


@dataclass(eq=False)
class AssignedProcess(RendererHandle):
    """A renderer of this pool; every session has a handle of its own."""

    process: RendererProcess
    asked: float = field(default_factory=time.monotonic)  # when its session asked for something last


class Pool:
    """All renderers, and one apart that looks at uploads before they are kept: a ``RendererPool`` of processes.

    Args:
        first: process of the first renderer, begun already.
    """

    def __init__(self, settings: Settings, metrics: Metrics, first: Process | None = None) -> None:
        room, aside = settings.waiting, {"eager": False, "express": False, "gives_way": True}
        pauses = Pauses(settings.renderer_count)
        self._spare = Spare(kind_of(settings, "spare"), pauses) if settings.spare_renderer else None
        self._renderers = [
            RendererProcess(
                kind_of(settings, str(k)), room, metrics, spare=self._spare, first=None if k else first, pauses=pauses
            )
            for k in range(settings.renderer_count)
        ]
        self._batch = self._renderers[-1]
        if settings.batch_renderer:
            batch = kind_of(settings, "batch", job_s=settings.batch_s, niceness=settings.batch_niceness, **aside)
            self._batch = RendererProcess(batch, room, metrics, pauses=pauses)
        # A file that is built to exhaust memory or time only stops this one. The other cores are for those that
        # somebody looks at.
        limits = {"memory_mb": settings.memory_mb // 2, "job_s": settings.inspect_s, "threads": 1}
        inspector = kind_of(settings, "inspector", niceness=INSPECTOR_NICENESS, **limits, **aside)
        self._inspector = RendererProcess(inspector, room, metrics, pauses=pauses)
        self._kernels = KernelPreparation()
        self._warm: set[str] = set()
        self._assigned: set[AssignedProcess] = set()
        self._warm_aside: int | None = 0  # process that has made a first picture
        self._preparing: asyncio.Task[None] | None = None
        self._aside_from = 0.0  # time from which on pictures go to the renderer of large ones
        self._photos_aside_from = 0.0  # the same of photos
        self._expecting = False
        self._closed = False

    @property
    def _all(self) -> list[RendererProcess]:
        return [*self._working, self._inspector]

    @property
    def _working(self) -> list[RendererProcess]:
        """Those that render."""
        return list(dict.fromkeys([*self._renderers, self._batch]))

    def start(self) -> None:
        """Begin to take jobs."""
        for renderer in self._all:
            renderer.start()

    async def warm_up(self) -> None:
        """Start all renderers, compile what they will need, and let each of them make a first picture."""
        warming = [asyncio.create_task(self._warm_renderer(renderer)) for renderer in self._renderers]
        try:
            await asyncio.gather(self._kernels.run(), *warming)
            # The first upload waits for no process; but the first pictures have the cores for themselves.
            self._prepare_inspector()
            if self._spare is not None:
                self._spare.prepare()
        finally:
            for task in warming:
                task.cancel()

    def _prepare_inspector(self, *, due: bool = False) -> None:
        """Start it some time from now on when nothing else is to be done."""
        if due and not self.waiting:
            self._inspector.prepare()
        elif not self._closed:
            wait_s = AGAIN_S if due else INSPECTOR_S
            asyncio.get_running_loop().call_later(wait_s, lambda: self._prepare_inspector(due=True))

    async def _warm_renderer(self, renderer: RendererProcess) -> None:
        await self._kernels.first.wait()
        try:
            await renderer.submit(WarmUp(views=("moving",)))
        finally:
            self._warm.add(renderer.name)  # one that cannot is no reason to keep the others from working
        await renderer.submit(WarmUp(views=("still", "carried")))  # what moves comes first with every client

    async def drain(self, seconds: float) -> None:
        """Take no more jobs: those that wait fail, those that run have so long to end."""
        self._closed = True
        waiting = [asyncio.create_task(renderer.drain()) for renderer in self._all]
        _, late = await asyncio.wait(waiting, timeout=max(0.0, seconds))
        for task in late:
            task.cancel()

    async def stop(self) -> None:
        """End all processes."""
        self._closed = True
        if self._preparing is not None:
            self._preparing.cancel()
            await asyncio.gather(self._preparing, return_exceptions=True)
        spare = [] if self._spare is None else [self._spare.stop()]
        await asyncio.gather(*spare, *(r.stop() for r in self._all))

    @property
    def ready(self) -> bool:
        """All renderers have said that they run, and have what first keyframes need."""
        warm = all(r.name in self._warm for r in self._renderers)
        return self._kernels.finished and warm and all(r.ready for r in self._renderers)

    @property
    def progress(self) -> str:
        """What is still going on before it is ready, or behind that."""
        if not self._kernels.finished or self.ready:
            return self._kernels.text
        return "starting renderers" if not all(r.ready for r in self._renderers) else "making a first picture"

    def assign(self, *, background: bool = False) -> RendererHandle:
        """The renderer that the fewest sessions have, among equals the one with the least to do."""
        if background:
            return AssignedProcess(self._batch)
        sessions = Counter(handle.process.name for handle in self._assigned)
        handle = AssignedProcess(min(self._renderers, key=lambda r: (sessions[r.name], r.load)))
        self._assigned.add(handle)
        return handle

    def release(self, renderer: RendererHandle) -> None:
        """The session is over; a second time does nothing."""
        self._assigned.discard(self._handle(renderer))

    def idle(self, renderer: RendererHandle) -> bool:
        """Whether a renderer has nothing to do."""
        return self._handle(renderer).process.load == 0

    def alone(self, renderer: RendererHandle) -> bool:
        """Whether a renderer has nothing to do, and all its other sessions rest."""
        own = self._handle(renderer)
        return own.process.load == 0 and not self._awake(own.process) - {own}

    def load(self, renderer: RendererHandle) -> int:
        """Jobs that wait or run in a renderer."""
        return self._handle(renderer).process.load

    @property
    def waiting(self) -> int:
        """Jobs waiting or running."""
        return sum(r.load for r in self._working)

    @property
    def pids(self) -> list[int]:
        """Of the processes that run."""
        spare = None if self._spare is None else self._spare.pid
        return [pid for pid in (*(r.pid for r in self._all), spare) if pid is not None]

    async def run(
        self, job: Job, *, renderer: RendererHandle | None = None, asked: Asked | None = None
    ) -> dict[str, Any]:
        """The result of a job. Whoever stops waiting for it takes it back.

        Args:
            renderer: of :meth:`assign`; None: the one with the least to do, of those that do work of its class.
            asked: for whom; how long the job waited is noted there.

        Raises:
            ServiceError: what the renderer says about the job, 429 where too many jobs wait, 503 while stopping.
        """
        if isinstance(job, PhotoJob):
            return await self._photo(job, asked)
        if renderer is not None:
            handle = self._handle(renderer)
            handle.asked = time.monotonic()
            self._expect_pictures()
            return await self._put(handle.process, job, asked)
        rank = asked.rank if asked is not None and asked.rank is not None else rank_of(job)
        if rank is Rank.BATCH:
            return await self._put(self._batch, job, asked)
        return await self._picture(job, asked or Asked())

    async def _photo(self, job: Job, asked: Asked | None) -> dict[str, Any]:
        """Work on a photo, which is nobody's stream: beside all else, unless that takes too long."""
        if rank_of(job) is Rank.BATCH or self._batch in self._renderers:
            return await self._put(self._batch, job, asked)
        if time.monotonic() >= self._photos_aside_from:
            with suppress(asyncio.TimeoutError):
                return await asyncio.wait_for(self._put(self._batch, job, asked), PHOTO_PATIENCE_S)
            self._photos_aside_from = time.monotonic() + PHOTOS_AVOID_S
        return await self._put(self._last_own, job, asked)

    @property
    def _last_own(self) -> RendererProcess:
        """Where there are several renderers, the first one is kept for streams."""
        return min(self._renderers[1:] or self._renderers, key=lambda r: r.load)

    async def _picture(self, job: Job, asked: Asked) -> dict[str, Any]:
        """A picture that somebody waits for."""
        own = self._last_own
        if is_small(job) and self.waiting:
            asked.threads = 1
        place = place_of(self._standing(job, own))
        asked.place = place.why
        if place.wanted:
            self._prepare_aside()
        if not place.aside:
            return await self._put(own, job, asked)
        try:
            return await asyncio.wait_for(self._put(self._batch, job, asked), place.patience_s)
        except asyncio.TimeoutError:  # the system gives it next to nothing
            self._aside_from = time.monotonic() + AVOIDED_S
            return await self._put(own, job, asked)

    def _standing(self, job: Job, own: RendererProcess) -> Standing:
        """What decides where a picture is made that could be in ``own``."""
        aside = self._batch
        return Standing(
            free=is_free(job),
            small=is_small(job),
            streams=bool(self._awake(own)),
            ahead=own.load,
            other=aside not in self._renderers,
            ready=self._aside_ready,
            large=aside.has(Rank.BATCH),
            slow=time.monotonic() < self._aside_from,
            ahead_there=aside.load,
            loaded_there=aside.has_scene(job),
        )

    @property
    def _aside_ready(self) -> bool:
        """The renderer of large pictures runs, and has what pictures need."""
        return self._batch.ready and self._batch.pid == self._warm_aside

    def _expect_pictures(self) -> None:
        """Beside streams pictures go to the renderer of large ones: it starts before there is one, though not at once,
        because the first keyframes need all cores."""
        if not self._expecting and self._batch not in self._renderers:
            self._expecting = True
            asyncio.get_running_loop().call_later(ASIDE_S, self._prepare_aside)

    def _prepare_aside(self) -> None:
        """Start it in the background, with a first picture: the kernels of which take longer than anybody waits."""
        if not (self._closed or self._aside_ready) and (self._preparing is None or self._preparing.done()):
            self._preparing = asyncio.create_task(self._warm_up_aside())

    async def _warm_up_aside(self) -> None:
        try:
            await self._batch.submit(WarmUp())
            self._warm_aside = self._batch.pid
        except ServiceError:
            await asyncio.sleep(AVOIDED_S)  # whoever asks next tries again

    async def inspect(self, job: Job, asked: Asked | None = None) -> dict[str, Any]:
        """The result of a job that may do harm, from the process apart."""
        return await self._put(self._inspector, job, asked)

    def forget(self, job: Forget) -> None:
        """Tell all renderers that run, without waiting."""
        for renderer in self._working:
            if renderer.ready and not self._closed:
                renderer.post(job)

    def _awake(self, process: RendererProcess) -> set[AssignedProcess]:
        """The sessions of a renderer that do not rest."""
        now = time.monotonic()
        return {one for one in self._assigned if one.process is process and now - one.asked < AT_REST_S}

    def _handle(self, renderer: RendererHandle) -> AssignedProcess:
        if not isinstance(renderer, AssignedProcess) or renderer.process not in self._working:
            raise TypeError(f"renderer must be a handle of this pool, got {renderer!r}")
        return renderer

    async def _put(self, renderer: RendererProcess, job: Job, asked: Asked | None) -> dict[str, Any]:
        if self._closed:
            raise ServiceError(503, "stopping", "the server is stopping", retry_after_s=RETRY_S)
        return await renderer.submit(job, asked)
