"""From what is due to what is sent, with a renderer that answers as it is told."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from service_parts import CAMERA, IDENTITY, Actor, FakePool, make_session
from torchrender.wire.messages import Ack, CameraHeader, Pose
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.renderers.jobs import Job, MakeKeyframe, MakeLayers, SmoothKeyframe
from torchrender_service.streams.placement import Placement
from torchrender_service.streams.prediction import margin_of
from torchrender_service.streams.producer import PREVIEW_SHARE, Producer


class Scripted(FakePool):
    """Answers as it is told, and lets things happen meanwhile."""

    def __init__(self) -> None:
        super().__init__()
        self.left = 3
        self.fails = False
        self.meanwhile: Callable[[], None] = lambda: None

    def answer(self, job: Job) -> dict[str, Any]:
        self.meanwhile()
        if self.fails:
            raise ServiceError(422, "too-slow", "too slow")
        if isinstance(job, MakeKeyframe):
            return {"messages": [b"first"], "extra_layers": job.extra_layers, "typical_depth": 2.0}
        if isinstance(job, MakeLayers):
            return {"messages": [b"extra"]}
        assert isinstance(job, SmoothKeyframe)
        self.left -= 1
        return {"messages": [] if self.left else [b"smooth"], "left": self.left, "extra_layers": 1}


class Stage:
    """A producer whose client stands at CAMERA."""

    def __init__(self) -> None:
        self.pool = Scripted()
        self.sent: list[bytes] = []
        self.problems: list[ServiceError] = []
        self.placement = Placement(0.0, 0.0)
        self.session = make_session("one", extra_layers=1, overscan=1.2, renderer=Actor("ours"))
        self.producer = Producer(
            session=self.session,
            placement=self.placement,
            pool=self.pool,
            metrics=Metrics(),
            max_pixels=10**6,
            webp=True,
            send=self.send,
            complain=self.complain,
        )
        self.stand(CAMERA)

    async def send(self, data: bytes) -> None:
        self.sent.append(data)

    async def complain(self, error: ServiceError) -> None:
        self.problems.append(error)

    def stand(self, camera: CameraHeader, seq: int = 1) -> None:
        self.placement.take_pose(Pose(seq=seq, time_ms=0.0, camera=camera, moving=False), 0.0)

    def go_on(self) -> str | None:
        """Do what is due, as the stream does; the client acknowledges at once."""
        kind = self.placement.due(time.monotonic())
        if kind is not None:
            asyncio.run(self.producer.make(kind))
            for number in range(self.session.next_id):
                self.placement.take_ack(Ack(id=number), time.monotonic())
        return kind


def test_a_view_at_rest_is_made_refined_and_smoothed() -> None:
    stage = Stage()
    assert [stage.go_on() for _ in range(6)] == ["moving", "still", "smooth", "smooth", "smooth", None]
    assert stage.sent == [b"first", b"extra"] * 2 + [b"smooth", b"extra"]
    keyframes = [job for _, job in stage.pool.jobs if isinstance(job, MakeKeyframe)]
    assert [(job.id, job.still, job.color) for job in keyframes] == [(0, False, "jpeg"), (1, True, "webp")]
    assert {job.id for _, job in stage.pool.jobs if isinstance(job, SmoothKeyframe)} == {2}
    assert stage.session.next_id == 3
    assert {address for address, _ in stage.pool.jobs} == {"ours"}, "what pictures share is kept in one renderer"


def test_a_changed_scene_takes_back_what_is_made_and_is_previewed_small() -> None:
    stage = Stage()
    for _ in range(3):
        stage.go_on()
    stage.pool.meanwhile = lambda: stage.placement.refresh(scene=True)
    before = len(stage.sent)
    assert stage.go_on() == "smooth" and len(stage.sent) == before
    stage.pool.meanwhile = lambda: None
    assert [stage.go_on(), stage.go_on()] == ["preview", "still"]
    assert stage.sent[before:] == [b"first", b"first", b"extra"], "no layers of the preview are waited for"
    preview, rest = [job for _, job in stage.pool.jobs if isinstance(job, MakeKeyframe)][-2:]
    assert preview.preview and not rest.preview
    assert (preview.extra_layers, preview.mirrors, preview.still) == (0, False, False)
    pixels = preview.camera.width * preview.camera.height
    assert pixels <= PREVIEW_SHARE * CAMERA.width * CAMERA.height < pixels + CAMERA.width + CAMERA.height
    shares = [job.camera.fx / job.camera.width for job in (preview, rest)]
    assert shares[0] == pytest.approx(CAMERA.fx / CAMERA.width, rel=0.01) and shares[1] < shares[0], "no overscan"


@pytest.mark.parametrize("change", ["moved", "settings"])
def test_what_happens_during_the_last_picture_goes_first(change: str) -> None:
    stage = Stage()
    for _ in range(4):
        stage.go_on()
    aside = msgspec.structs.replace(CAMERA, world_from_camera=(*IDENTITY[:3], 1.0, *IDENTITY[4:]))
    happens = {"moved": lambda: stage.stand(aside, 2), "settings": stage.placement.refresh}
    stage.pool.meanwhile = happens[change]
    before = len(stage.sent)
    assert stage.go_on() == "smooth"
    stage.pool.meanwhile = lambda: None
    assert len(stage.sent) == before, "the picture of what was wanted before is not sent"
    assert stage.go_on() == "moving"


def test_a_refinement_that_fails_stays_as_it_is() -> None:
    stage = Stage()
    stage.go_on(), stage.go_on()
    stage.pool.fails = True
    assert stage.go_on() == "smooth"
    assert stage.go_on() is None and not stage.problems


def test_a_keyframe_that_fails_is_told_and_its_credit_comes_back() -> None:
    stage = Stage()
    stage.pool.fails = True
    for _ in range(5):  # more than there are credits
        assert stage.placement.due(1.0) == "moving"
        with pytest.raises(ServiceError, match="too slow"):
            stage.go_on()


def test_layers_that_fail_are_told_and_layer_0_stays() -> None:
    stage = Stage()

    def fail_later() -> None:
        stage.pool.fails = isinstance(stage.pool.jobs[-1][1], MakeLayers)

    stage.pool.meanwhile = fail_later
    stage.go_on()
    assert stage.sent == [b"first"] and len(stage.problems) == 1


@pytest.mark.parametrize("kind", ["still", "smooth"])
def test_a_picture_at_rest_is_taken_back_once_the_view_moves(kind: str) -> None:
    stage = Stage()
    while stage.placement.due(1.0) != kind:
        stage.go_on()
    aside = msgspec.structs.replace(CAMERA, world_from_camera=(*IDENTITY[:3], 1.0, *IDENTITY[4:]))
    taken_back = []

    async def slow(job: Job, **_: Any) -> dict[str, Any]:
        stage.stand(aside, 2)
        try:
            await asyncio.sleep(60.0)
        except asyncio.CancelledError:
            taken_back.append(job)
            raise
        return {}

    stage.pool.run = slow  # type: ignore[method-assign]
    sent = len(stage.sent)
    asyncio.run(stage.producer.make(kind))
    assert len(taken_back) == 1 and len(stage.sent) == sent and not stage.problems
    assert stage.placement.due(1.0) == "moving"


def test_layers_of_what_has_changed_are_not_waited_for() -> None:
    stage = Stage()
    usual, taken_back = stage.pool.run, []

    async def slow(job: Job, **how: Any) -> dict[str, Any]:
        if not isinstance(job, MakeLayers):
            return await usual(job, **how)
        stage.placement.refresh()
        try:
            await asyncio.sleep(60.0)
        except asyncio.CancelledError:
            taken_back.append(job)
            raise
        return {}

    stage.pool.run = slow  # type: ignore[method-assign]
    assert stage.go_on() == "moving"
    assert len(taken_back) == 1 and stage.sent == [b"first"] and not stage.problems
    assert stage.placement.due(1.0) == "moving", "the new state is next"
    assert not stage.placement.outdated(), "of two in a row one is whole"
    stage.pool.run = usual  # type: ignore[method-assign]
    assert stage.go_on() == "moving" and stage.sent == [b"first", b"first", b"extra"]
    stage.placement.refresh()
    assert stage.placement.outdated()


def test_renderers_know_what_of_a_picture_is_shown() -> None:
    stage = Stage()
    stage.go_on()
    made = stage.pool.jobs[0][1]
    assert isinstance(made, MakeKeyframe)
    assert made.margin == ((made.camera.width - CAMERA.width) // 2, (made.camera.height - CAMERA.height) // 2)
    assert min(made.margin) > 0 and margin_of(CAMERA, CAMERA) == (0, 0)
