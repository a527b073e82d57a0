"""A camera, sessions and a pool as the service keeps them, for tests without a server."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec

from torchrender.wire.messages import CameraHeader
from torchrender_service.renderers.asked import Asked
from torchrender_service.renderers.contract import RendererHandle, RendererPool
from torchrender_service.renderers.jobs import Bounds, Describe, Forget, Job, Locate, SceneSource
from torchrender_service.streams.ledger import SessionRecord
from torchrender_service.streams.sessions import Session

IDENTITY = tuple(float(i % 5 == 0) for i in range(16))
CAMERA = CameraHeader(world_from_camera=IDENTITY, fx=50.0, fy=50.0, cx=32.0, cy=24.0, width=64, height=48, near=0.1)
FACTS = {"name": "box", "triangles": 96, "diagonal": 1.0, "bounds": [[0.0] * 3, [1.0] * 3]}


@dataclass(frozen=True, eq=False)
class Actor(RendererHandle):
    """What a remote pool might give out."""

    address: str


class FakePool(RendererPool):
    """Renders elsewhere: notes who is asked for what, and answers at once."""

    def __init__(self, *addresses: str) -> None:
        self.addresses = addresses or ("far away",)
        self.jobs: list[tuple[str | None, Job]] = []
        self.given: list[Actor] = []
        self.back: list[RendererHandle] = []

    ready, progress, waiting = True, "", 0

    def start(self) -> None:
        pass

    async def warm_up(self) -> None:
        pass

    async def drain(self, seconds: float) -> None:
        pass

    async def stop(self) -> None:
        pass

    def assign(self, *, background: bool = False) -> RendererHandle:
        del background
        self.given.append(Actor(self.addresses[len(self.given) % len(self.addresses)]))
        return self.given[-1]

    def release(self, renderer: RendererHandle) -> None:
        self.back.append(renderer)

    def idle(self, renderer: RendererHandle) -> bool:
        return renderer in self.given

    def alone(self, renderer: RendererHandle) -> bool:
        return self.idle(renderer)

    def load(self, renderer: RendererHandle) -> int:
        del renderer
        return 0

    async def run(
        self, job: Job, *, renderer: RendererHandle | None = None, asked: Asked | None = None
    ) -> dict[str, Any]:
        del asked
        assert renderer is None or isinstance(renderer, Actor)
        self.jobs.append((None if renderer is None else renderer.address, job))
        return self.answer(job)

    async def inspect(self, job: Job, asked: Asked | None = None) -> dict[str, Any]:
        del asked
        return self.answer(job)

    def forget(self, job: Forget) -> None:
        self.jobs.append((None, job))

    def answer(self, job: Job) -> dict[str, Any]:
        """What a renderer would say."""
        if isinstance(job, Describe):
            return dict(FACTS)
        if isinstance(job, Locate):
            return {"camera": msgspec.to_builtins(CAMERA)}
        raise AssertionError(f"nobody expects {job}")


def make_session(name: str, **rest: Any) -> Session:
    given = {
        "id": name,
        "scene": SceneSource(id="cornell_box"),
        "facts": {},
        "camera": CAMERA,
        "extra_layers": 0,
        "overscan": 1.0,
        "bounds": Bounds(),
        "renderer": Actor("far away"),
    }
    return Session(**given | rest)


def make_record(name: str, **rest: Any) -> SessionRecord:
    """Of a session that no stream was opened for yet."""
    return msgspec.structs.replace(make_session(name).record(), **rest)
