"""Keyframes inside a renderer: what they may cost."""

from __future__ import annotations

import time

import pytest

from service import stream_renderer
from service.cameras import header_of
from service.jobs import Bounds, MakeKeyframe, SceneSource
from service.messages import Keyframe, Type, decode
from service.stream_renderer import MOVING_BUDGET_MS, PACKING_SHARE, STILL_FACTOR, StreamRenderer
from torchrender.scene.load import load

HUNDRED = Bounds(budget_ms=100.0)


@pytest.fixture(scope="module")
def scene():
    return load("cornell_box")


def budgets(scene, count: int, *, still: bool = False, bounds: Bounds = HUNDRED) -> list[float | None]:
    """Of the pictures inside ``count`` keyframes of one session."""
    renderer, camera = StreamRenderer(), header_of(scene.camera(width=64, height=48))
    found = []
    for number in range(count):
        job = MakeKeyframe(
            session="one",
            scene=SceneSource(id="cornell_box"),
            id=number,
            pose=number,
            time_ms=0.0,
            camera=camera,
            still=still,
            layers=0,
            direction=(0.0, 0.0, 0.0),
            baseline=0.0,
            color="jpeg",
            quality=85,
            bounds=bounds,
        )
        message = decode(renderer.make(scene, job)["messages"][0], (Type.KEYFRAME,)).message
        assert isinstance(message, Keyframe) and message.plan is not None
        found.append(message.plan["budget_ms"])
    return found


def test_a_budget_is_for_the_whole_keyframe(scene, monkeypatch) -> None:
    """What it took to pack the one before is kept free, half of the budget at most."""
    slow = stream_renderer.first_message

    def slower(*arguments, **options):
        time.sleep(pause)
        return slow(*arguments, **options)

    monkeypatch.setattr(stream_renderer, "first_message", slower)
    pause = 0.02
    first, second = budgets(scene, 2)
    assert first == 100.0
    assert second is not None and second <= 80.0
    pause = 0.2
    assert budgets(scene, 2)[1] == pytest.approx((1.0 - PACKING_SHARE) * 100.0)


def test_refinements_may_cost_more_and_moving_pictures_have_a_budget_anyway(scene) -> None:
    assert budgets(scene, 1, still=True) == [STILL_FACTOR * 100.0]
    assert budgets(scene, 1, bounds=Bounds()) == [MOVING_BUDGET_MS]
    assert budgets(scene, 1, still=True, bounds=Bounds()) == [None]
