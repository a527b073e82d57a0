"""A scene that moves, played in the browser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from browser_stage import COMPLETE, Service, Visit
from torchrender.wire.messages import Settings, Type

TIMES = "() => window.torchrender.keyframes[0]?.scene_s"


@pytest.fixture(scope="module")
def service(browser: object) -> Service:  # type: ignore[misc]
    del browser
    server = Service(scenes="walker,cornell_box")
    server.start()
    yield server
    server.stop()


def test_the_animation_plays_and_stops(visit: Callable[..., Visit]) -> None:
    page = visit(scene="walker", layers=0, budget_ms=30)
    page.wait(COMPLETE)
    assert page.page.evaluate(TIMES) is None
    before = page.capture()[0].astype(int)
    page.page.evaluate("() => document.getElementById('play').click()")
    page.wait("() => window.torchrender.keyframes[0]?.scene_s > 0.3")
    assert len({k.get("scene_s") for k in page.state("keyframes")}) == 1, "no picture of another time is drawn"
    assert np.abs(page.capture()[0].astype(int) - before).max() > 40, "the figure has moved"
    page.page.evaluate("() => document.getElementById('play').click()")
    page.wait("() => { const k = window.torchrender.keyframes[0]; return k && k.still; }")
    stopped = page.page.evaluate(TIMES)
    assert stopped > 0.3
    asked = [m.playing for m in page.messages(Type.SETTINGS) if isinstance(m, Settings)]
    assert asked == [True, False]
    assert not page.problems


def test_what_does_not_move_cannot_be_played(visit: Callable[..., Visit]) -> None:
    page = visit()
    page.wait(COMPLETE)
    assert page.page.evaluate("() => document.getElementById('play-row').hidden")
