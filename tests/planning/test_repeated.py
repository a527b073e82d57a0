"""Pictures that repeat the last one are made by its plans, and by new ones as soon as anything is another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

import torchrender as tr
import torchrender.run
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.pace import REPEATING
from torchrender.planning import repeated
from torchrender.planning.plan import Plan
from torchrender.planning.repeated import Repeated

SCENE = tr.load("grass", size=3000)
CAMERA = SCENE.camera(width=64, height=48)
OPTIONS = tr.RenderOptions(reuse=None)
WISHES: tuple[dict[str, Any], ...] = ({}, {"budget_ms": 1e5}, {"max_error": 0.3})


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Plan]:
    """Plans that were not taken over."""
    plans: list[Plan] = []
    plain = torchrender.run.make_plan

    def make(*given: Any, **more: Any) -> Plan:
        plans.append(plain(*given, **more))
        return plans[-1]

    monkeypatch.setattr(torchrender.run, "make_plan", make)
    return plans


def after(count: int, **wishes: Any) -> RenderHistory:
    """What so many pictures leave."""
    history: RenderHistory | None = RenderHistory()
    for _ in range(count):
        history = tr.render(SCENE, CAMERA, options=OPTIONS, history=history, **wishes).history
    assert history is not None
    return history


def standing(**wishes: Any) -> RenderHistory:
    """Before a picture that repeats the last one."""
    history = after(4, **wishes)
    for _ in range(8):
        assert history.pace is not None
        found = history.pace.repeated
        if isinstance(found, Repeated) and found.search is history.pace.search:
            return history
        history = tr.render(SCENE, CAMERA, options=OPTIONS, history=history, **wishes).history or history
    raise AssertionError("no picture was repeated")


@pytest.mark.parametrize("wishes", WISHES, ids=["none", "budget", "bound"])
def test_the_same_picture_is_planned_once(made: list[Plan], wishes: dict[str, Any]) -> None:
    history = standing(**wishes)
    assert made
    made.clear()
    again = tr.render(SCENE, CAMERA, options=OPTIONS, history=history, **wishes)
    assert not made and again.plan is not None and again.history is not None and again.history.pace is not None
    assert history.pace is not None
    anew = tr.render(SCENE, CAMERA, options=OPTIONS, history=forgetful(history), **wishes)
    assert made and anew.plan is not None
    assert torch.equal(again.radiance, anew.radiance)
    for name in ("options", "possible", "changes", "predicted_error", "error_interval"):
        assert getattr(again.plan, name) == getattr(anew.plan, name), name
    one, other = ([replace(row, measured_ms=None) for row in image.plan.rows] for image in (again, anew) if image.plan)
    assert [row.reason for row in one] == [row.reason for row in other]
    assert [row.amounts for row in one] == [row.amounts for row in other]
    assert [row.predicted_ms for row in one] == pytest.approx([row.predicted_ms for row in other])
    assert again.history.pace.known[REPEATING] == again.timings_ms["plan"]


def forgetful(history: RenderHistory) -> RenderHistory:
    assert history.pace is not None
    return replace(history, pace=replace(history.pace, repeated=None))


CHANGES: dict[str, Callable[[RenderHistory], dict[str, Any]]] = {
    "camera": lambda _: {"camera": tr.Cameras.look_at([3.0, 2.0, 4.0], [0.0, 0.0, 0.0], width=64, height=48)},
    "size": lambda _: {"camera": SCENE.camera(width=48, height=48)},
    "options": lambda _: {"options": tr.RenderOptions(reuse=None, background=[0.1, 0.2, 0.3])},
    "scene": lambda _: {"scene": SCENE.replace(name="another")},
    "budget": lambda _: {"budget_ms": 9e4},
    "bound": lambda _: {"budget_ms": None, "max_error": 0.4},
    "what is kept": lambda history: {"history": replace(history, kept={})},
    "alone": lambda history: {"history": replace(history, sequence=False)},
}


@pytest.mark.parametrize("change", CHANGES)
def test_anything_else_is_planned_anew(made: list[Plan], change: str) -> None:
    history = standing(budget_ms=1e5)
    made.clear()
    given: dict[str, Any] = {"scene": SCENE, "camera": CAMERA, "options": OPTIONS, "history": history, "budget_ms": 1e5}
    tr.render(**{**given, **CHANGES[change](history)})
    assert made


def test_times_are_foreseen_by_what_pictures_took() -> None:
    history = standing(budget_ms=1e5)
    pace = history.pace
    assert pace is not None
    slower = replace(history, pace=replace(pace, ratios={key: 2.0 * ratio for key, ratio in pace.ratios.items()}))
    found = [tr.render(SCENE, CAMERA, options=OPTIONS, history=one, budget_ms=1e5).plan for one in (history, slower)]
    assert found[0] is not None and found[1] is not None
    for one, other in zip(found[0].running, found[1].running, strict=True):
        own = (one.name, one.setting) in pace.ratios
        assert one.predicted_ms == 0.0 or not own or other.predicted_ms == pytest.approx(2.0 * (one.predicted_ms or 0))


def test_a_choice_that_no_longer_fits_is_not_repeated(made: list[Plan]) -> None:
    history = standing(budget_ms=1e5)
    pace = history.pace
    assert pace is not None
    made.clear()
    slower = replace(history, pace=replace(pace, ratios={key: 1e6 * ratio for key, ratio in pace.ratios.items()}))
    tr.render(SCENE, CAMERA, options=OPTIONS, history=slower, budget_ms=1e5)
    assert made


def test_a_picture_that_runs_late_is_planned_anew_in_its_middle(
    made: list[Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    history = standing(budget_ms=1e5)
    made.clear()
    monkeypatch.setattr(repeated, "still_in_time", lambda *_: False)
    tr.render(SCENE, CAMERA, options=OPTIONS, history=history, budget_ms=1e5)
    assert made


def test_what_a_picture_makes_for_the_next_is_no_repetition() -> None:
    history = after(1)
    assert history.pace is not None and history.pace.repeated is None, "it made what lasts"


def test_no_history_keeps_more_than_the_last_plans() -> None:
    history = standing(budget_ms=1e5)
    last = history.pace.repeated if history.pace is not None else None
    assert isinstance(last, Repeated)
    assert not any(isinstance(value, RenderHistory) for value in vars(last).values())
