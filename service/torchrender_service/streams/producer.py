"""Makes the keyframes of one stream, when its placement says that one is due."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from torchrender.wire.messages import CameraHeader, Pose
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.asked import Asked
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import (
    LOSSLESS,
    QUALITY_MOVING,
    QUALITY_STILL,
    MakeKeyframe,
    MakeLayers,
    SmoothKeyframe,
)
from torchrender_service.streams.placement import Flight, Placement, Shown
from torchrender_service.streams.prediction import margin_of, overscanned
from torchrender_service.streams.sessions import Session

LOG = logging.getLogger("torchrender_service.streams.producer")
LOOK_S = 0.01  # between two looks whether a view at rest moves again
PREVIEW_SHARE = 0.25  # of the pixels of a view, in a preview
REACH_S = 0.5  # extra cameras stand where the client will be after this time


@dataclass(frozen=True, eq=False, kw_only=True)
class Producer:
    """Asks the session's renderer and hands its messages on, layer 0 before the others are begun."""

    session: Session
    placement: Placement
    pool: RendererPool
    metrics: Metrics
    max_pixels: int
    webp: bool  # the client reads it
    mirrors: bool = False  # the client shows mirrors as pictures of their own
    send: Callable[[bytes], Awaitable[None]]
    complain: Callable[[ServiceError], Awaitable[None]]

    async def make(self, kind: str) -> None:
        """One keyframe, or for "smooth" one of its pictures.

        Raises:
            ServiceError: there is none, the renderer says why.
        """
        if kind == "smooth":
            await self._smooth()
        else:
            await self._keyframe(kind)

    async def _keyframe(self, kind: str) -> None:
        placement, session, now = self.placement, self.session, time.monotonic()
        pose, still, preview = placement.pose, kind == "still", kind == "preview"
        assert pose is not None
        view = pose.camera if still else placement.view(pose, now)
        if preview:
            camera = overscanned(view, 1.0, min(self.max_pixels, int(PREVIEW_SHARE * view.width * view.height)))
        else:
            camera = overscanned(view, session.overscan, self.max_pixels)
        number, session.next_id = session.next_id, session.next_id + 1
        flight = placement.begin(number, now, timed=not (still or preview))
        job = msgspec.structs.replace(self._job(number, pose, camera, still), margin=margin_of(camera, view))
        if preview:
            job = msgspec.structs.replace(job, preview=True, extra_layers=0, mirrors=False)
        try:
            made = await (self._unless(self._moves, job) if still else self._run(job))
        except ServiceError:
            placement.failed(number)
            raise
        if made is None:
            placement.failed(number)
            return
        overscan = min(camera.width * view.fx / (camera.fx * view.width), session.overscan)
        if not placement.done(number, Shown(view, overscan, made["typical_depth"], still, preview=preview)):
            return  # a RESYNC came meanwhile
        await self._deliver(number, flight, made, "moving" if kind == "spare" else kind)

    async def _smooth(self) -> None:
        """One more picture of the view at rest, and the keyframe if it was the last."""
        placement, session = self.placement, self.session
        job = SmoothKeyframe(session=session.id, id=session.next_id)
        try:
            made = await self._unless(self._moves, job)
        except ServiceError as error:
            LOG.warning("a refinement stays as it is: %s", error.detail)
            placement.smoothed()
            return
        if made is None or made["left"] or placement.due(time.monotonic()) != "smooth":
            return
        placement.smoothed()
        if made["messages"]:
            session.next_id += 1
            flight = placement.begin(job.id, time.monotonic(), timed=False)
            await self._deliver(job.id, flight, made, "smooth")

    async def _deliver(self, number: int, flight: Flight, made: dict[str, Any], kind: str) -> None:
        """Send layer 0, then make and send the others."""
        session = self.session
        flight.sent = time.monotonic()
        self.metrics.count("keyframes", kind=kind)
        await self._send_all(made["messages"])
        if made["extra_layers"]:
            try:
                more = await self._unless(self.placement.outdated, MakeLayers(session=session.id, id=number))
            except ServiceError as error:
                await self.complain(error)
                return
            self.placement.delivered(whole=more is not None)
            await self._send_all([] if more is None else more["messages"])

    async def _send_all(self, messages: list[bytes]) -> None:
        for message in messages:
            await self.send(message)
            self.metrics.count("keyframe_bytes", len(message))

    def _moves(self) -> bool:
        """The view that was at rest moves again, or shows something else."""
        return self.placement.due(time.monotonic()) in ("moving", "spare", "preview")

    async def _unless(
        self, overtaken: Callable[[], bool], job: MakeKeyframe | MakeLayers | SmoothKeyframe
    ) -> dict[str, Any] | None:
        """The result; None where it is overtaken before it is there: then it is taken back at once."""
        running = asyncio.ensure_future(self._run(job))
        try:
            while not (await asyncio.wait({running}, timeout=LOOK_S))[0]:
                if overtaken():
                    return None
            return running.result()
        finally:
            if not running.done():
                running.cancel()
                await asyncio.wait({running})

    async def _run(self, job: MakeKeyframe | MakeLayers | SmoothKeyframe) -> dict[str, Any]:
        session = self.session
        return await self.pool.run(job, renderer=session.renderer, asked=Asked(client=session.client))

    def _job(self, number: int, pose: Pose, camera: CameraHeader, still: bool) -> MakeKeyframe:
        session = self.session
        lossless = still and self.webp
        speed = sum(v * v for v in pose.velocity) ** 0.5 if pose.moving else 0.0
        return MakeKeyframe(
            session=session.id,
            scene=session.scene,
            id=number,
            pose=pose.seq,
            time_ms=pose.time_ms,
            camera=camera,
            still=still,
            extra_layers=session.extra_layers,
            direction=pose.velocity if speed else (0.0, 0.0, 0.0),
            baseline=speed * REACH_S,
            color="webp" if lossless else "jpeg",
            quality=LOSSLESS if lossless else QUALITY_STILL if still else QUALITY_MOVING,
            bounds=session.bounds,
            mirrors=self.mirrors and session.tone_map == "none",  # light of two pictures adds up before a curve only
            density=session.density,
            asymmetry=session.asymmetry,
            scene_s=session.clock.at(time.monotonic()),
            settings=session.settings,
            exposure=session.exposure,
            tone_map=session.tone_map,
            off=session.off,
        )
