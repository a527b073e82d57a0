"""What a stream tells a viewer beside its keyframes: how the server is, where to look, what a pixel shows."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import Literal, cast

import msgspec

from torchrender.wire.messages import CameraHeader, Look, Message, Pick, Picked, Settings, Status
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.asked import Asked
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.renderers.jobs import Bounds, FindPixel
from torchrender_service.streams.sessions import Session

OnPick = Callable[[str, Picked], None]
"""Called with the id of the scene and what was found."""
Kind = Literal["moving", "still", "smooth"]
LOOK_S = 0.05
"""Between two looks at what is to be told."""
LIFE_S = 1.0
"""Between two signs of life at most."""
TOLD_AFTER_S = 0.4
"""A picture that takes less is not announced."""


def take_settings(session: Session, message: Settings, now: float) -> None:
    """What a user wants from now on."""
    session.settings = message.seq
    session.bounds = Bounds(budget_ms=message.budget_ms, max_error=message.max_error)
    changes = {"extra_layers": message.layers}
    for name in ("density", "asymmetry", "exposure", "tone_map", "off"):
        changes[name] = getattr(message, name)
    for name, value in changes.items():
        if value is not None:
            setattr(session, name, value)
    if message.playing is not None:
        session.clock.play(message.playing and bool(session.facts.get("animations")), now)


class Viewing:
    """Of one stream.

    Args:
        send: a message to the client.
        on_pick: hears of every pixel that was asked for.
    """

    def __init__(
        self,
        session: Session,
        pool: RendererPool,
        send: Callable[[Message], Awaitable[None]],
        on_pick: OnPick | None = None,
    ) -> None:
        self._session, self._pool, self._send, self._on_pick = session, pool, send, on_pick
        self._doing: tuple[Kind, float] | None = None
        self._camera: CameraHeader | None = None
        self._pick: Pick | None = None  # a slot for one: the newest counts

    @contextlib.contextmanager
    def doing(self, kind: str) -> Iterator[None]:
        """A picture is being made."""
        self._doing = cast("Kind", "moving" if kind in ("spare", "preview") else kind), time.monotonic()
        try:
            yield
        finally:
            self._doing = None

    def look(self, camera: CameraHeader) -> None:
        """The client shall look from there."""
        self._camera = camera

    def pick(self, message: Pick) -> None:
        """The client wants to know."""
        self._pick = message

    async def report(self) -> None:
        """Tell the client all of this, until the stream ends."""
        told, at = Status(), 0.0
        while True:
            if self._camera is not None:
                camera, self._camera = self._camera, None
                await self._send(Look(camera=camera))
            if self._pick is not None:
                pick, self._pick = self._pick, None
                await self._answer(pick)
            now = self._now()
            changed = (now.doing, now.ahead) != (told.doing, told.ahead)
            if changed or time.monotonic() - at >= LIFE_S:
                await self._send(now)
                told, at = now, time.monotonic()
            await asyncio.sleep(LOOK_S)

    def _now(self) -> Status:
        doing, since = self._doing or (None, 0.0)
        passed = time.monotonic() - since
        if doing is None or passed < TOLD_AFTER_S:
            return Status()
        ahead = self._pool.load(self._session.renderer) - 1
        return Status(doing=doing, since_ms=round(1e3 * passed), ahead=max(0, ahead))

    async def _answer(self, pick: Pick) -> None:
        session = self._session
        job = FindPixel(
            scene=session.scene, camera=pick.camera, x=pick.x, y=pick.y, scene_s=session.clock.at(time.monotonic())
        )
        try:
            found = await self._pool.run(job, renderer=session.renderer, asked=Asked(client=session.client))
        except ServiceError:
            found = {"triangle": -1}  # the scene is gone, or the pixel lies outside
        picked = msgspec.convert({"seq": pick.seq, **found}, Picked)
        await self._send(picked)
        if self._on_pick is not None:
            self._on_pick(session.scene.id, picked)
