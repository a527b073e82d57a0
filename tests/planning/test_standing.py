"""Pictures of a sequence stand by a choice while it holds, and learn how far a budget may be filled."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

import torchrender as tr
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.pace import MISSES, SEARCHING, TOLERANCE, Pace, Search
from torchrender.planning import choices, planner
from torchrender.planning.plan import Plan
from torchrender.planning.search import HEADROOM, HEADROOMS, choose, headroom
from torchrender.planning.standing import FULL, LEAST_MS, LONGEST, PICTURES, SHARE, SLOWER

SCENE = tr.load("grass", size=3000)
CAMERA = SCENE.camera(width=64, height=48)
BOUND = {"max_error": 0.2}
OPTIONS = tr.RenderOptions(reuse=None)


@pytest.fixture(scope="module")
def past() -> RenderHistory:
    """After a picture, with what a search before the next one came to."""
    history = tr.render(SCENE, CAMERA, history=RenderHistory(), options=OPTIONS, **BOUND).history
    assert history is not None
    found = tr.plan(SCENE, CAMERA, history=with_search(history, None), options=OPTIONS, **BOUND).search
    assert found is not None and found.pictures == 0
    return with_search(history, found)


def with_search(history: RenderHistory, search: Search | None) -> RenderHistory:
    assert history.pace is not None
    return replace(history, pictures=100, pace=replace(history.pace, search=search))


def last(history: RenderHistory) -> Search:
    assert history.pace is not None
    assert history.pace.search is not None
    return history.pace.search


def planned(monkeypatch: pytest.MonkeyPatch, history: RenderHistory, **wishes: Any) -> tuple[Plan, int]:
    """The plan of the next picture, and how often settings were searched for it."""
    calls = []
    search = choose
    for module in (planner, choices):
        monkeypatch.setattr(module, "choose", lambda *given: (calls.append(1), search(*given))[1])
    return tr.plan(SCENE, CAMERA, history=history, **{"options": OPTIONS, **BOUND, **wishes}), len(calls)


def test_a_choice_that_holds_is_taken_without_a_search(monkeypatch: pytest.MonkeyPatch, past: RenderHistory) -> None:
    plan, searches = planned(monkeypatch, past, options=tr.RenderOptions(reuse=None))
    assert searches == 0 and plan.search is not None and plan.search.pictures == 1
    anew, searches = planned(monkeypatch, with_search(past, None))
    assert searches > 0
    assert [(row.name, row.setting) for row in plan.rows] == [(row.name, row.setting) for row in anew.rows]
    assert plan.predicted_ms == anew.predicted_ms and plan.error_interval == anew.error_interval
    assert plan.changes == anew.changes and plan.possible == anew.possible


@pytest.mark.parametrize("wishes", [
    {"max_error": 0.1},
    {"budget_ms": 100.0},
    {"options": tr.RenderOptions(reuse=None, shadows=False)},
    {"options": tr.RenderOptions(reuse=None, background=[0.1, 0.2, 0.3])},
], ids=["bound", "budget", "options", "background"])  # fmt: skip
def test_another_wish_is_searched_for(
    monkeypatch: pytest.MonkeyPatch, past: RenderHistory, wishes: dict[str, Any]
) -> None:
    assert planned(monkeypatch, past, **wishes)[1] > 0


@pytest.mark.parametrize("later, worse, searched", [
    (1.0, 1.05, False), (2 * LEAST_MS, 1.0, True), (0.0, 0.8, True), (0.0, 1.25, True),
])  # fmt: skip
def test_costs_that_moved_are_searched_for(
    monkeypatch: pytest.MonkeyPatch, past: RenderHistory, later: float, worse: float, searched: bool
) -> None:
    ms, error, most = last(past).cost
    assert error > 0.01, "far from where changes are none"
    moved = replace(last(past), cost=((SLOWER if later > LEAST_MS else 1.0) * ms + later, worse * error, most))
    assert (planned(monkeypatch, with_search(past, moved))[1] > 0) == searched


def test_no_choice_stands_for_ever(monkeypatch: pytest.MonkeyPatch, past: RenderHistory) -> None:
    """As long as its search was dear, beside what pictures take, and never longer than that."""
    for searching, stood in ((SHARE * last(past).cost[0], PICTURES), (1e9, LONGEST)):
        assert past.pace is not None
        known = replace(past, pace=replace(past.pace, known={**past.pace.known, SEARCHING: searching}))
        assert planned(monkeypatch, with_search(known, replace(last(past), pictures=stood - 1)))[1] == 0
        assert planned(monkeypatch, with_search(known, replace(last(past), pictures=stood)))[1] > 0


@pytest.mark.parametrize("share, searching, stood, searched", [
    (0.95, 1e3, PICTURES, False), (0.95, 1e3, LONGEST, True), (0.8, 1e3, PICTURES - 1, False),
    (0.8, 1e3, PICTURES, True), (0.95, 0.1, PICTURES, True),
])  # fmt: skip
def test_a_choice_that_fills_its_budget_stands(
    monkeypatch: pytest.MonkeyPatch, past: RenderHistory, share: float, searching: float, stood: int, searched: bool
) -> None:
    """No picture is worse than those beside it to pay for a search that has little to find."""
    rest = with_search(past, None)
    plan, _ = planned(monkeypatch, rest, max_error=None, budget_ms=1000.0)
    assert plan.search is not None and plan.possible and rest.pace is not None
    costly = replace(rest.pace, known={**rest.pace.known, SEARCHING: searching})
    budget = (plan.predicted_ms or 0.0) / (share * HEADROOM)
    kept = replace(plan.search, wishes=(budget, None), pictures=stood)
    past = replace(rest, pace=replace(costly, search=kept))
    assert (planned(monkeypatch, past, max_error=None, budget_ms=budget)[1] > 0) == searched


@pytest.mark.parametrize("searching", [10.0, 30.0, 1e3])
def test_choices_stand_for_as_long_as_their_search_was_dear(
    monkeypatch: pytest.MonkeyPatch, past: RenderHistory, searching: float
) -> None:
    """Whatever moved meanwhile, if the choice fits: until the search is a small share of the budget of those pictures,
    or as many stood by it as ever do."""
    budget = 100.0
    rest = with_search(past, None)
    plan, _ = planned(monkeypatch, rest, max_error=None, budget_ms=budget)
    assert plan.search is not None and plan.possible and rest.pace is not None
    later = plan.search.later
    assert later is not None
    ms, error, most = later.cost
    moved = replace(later, cost=(ms, 2.0 * error, most))
    known = replace(rest, pace=replace(rest.pace, known={**rest.pace.known, SEARCHING: searching}))
    length = min(PICTURES, math.ceil(searching / (SHARE * budget)))
    for stood in (length - 1, length):
        kept = with_search(known, replace(moved, pictures=stood))
        searched = planned(monkeypatch, kept, max_error=None, budget_ms=budget)[1] > 0
        assert searched == (stood == length), stood
    first = replace(with_search(known, replace(moved, pictures=0)), pictures=1)
    assert planned(monkeypatch, first, max_error=None, budget_ms=budget)[1] > 0, "of the first picture's no use"


def test_what_became_possible_is_searched_for(monkeypatch: pytest.MonkeyPatch, past: RenderHistory) -> None:
    plan, _ = planned(monkeypatch, with_search(past, None), max_error=None, budget_ms=1000.0)
    assert plan.search is not None and plan.possible
    assert planned(monkeypatch, with_search(past, plan.search), max_error=None, budget_ms=1000.0)[1] == 0
    lost = with_search(past, replace(plan.search, possible=False))
    assert planned(monkeypatch, lost, max_error=None, budget_ms=1000.0)[1] > 0


def test_first_choices_stand_for_a_short_time(monkeypatch: pytest.MonkeyPatch, past: RenderHistory) -> None:
    young = replace(with_search(past, replace(last(past), pictures=1)), pictures=3)
    assert planned(monkeypatch, young)[1] > 0
    assert planned(monkeypatch, replace(young, pictures=4))[1] == 0


def test_a_budget_that_became_too_small_is_searched_for(monkeypatch: pytest.MonkeyPatch, past: RenderHistory) -> None:
    """The same wish and the same predictions, but less of the budget may be filled."""
    assert past.pace is not None
    rest = with_search(past, None)
    plan, _ = planned(monkeypatch, rest, max_error=None, budget_ms=1000.0)
    assert plan.search is not None and plan.possible
    tight = 1.02 * (plan.predicted_ms or 0.0) / (FULL * HEADROOM)
    kept = with_search(past, replace(plan.search, wishes=(tight, None)))
    assert planned(monkeypatch, kept, max_error=None, budget_ms=tight)[1] == 0
    assert kept.pace is not None
    late = replace(kept, pace=replace(kept.pace, misses=(0.35, 0.35)))
    assert planned(monkeypatch, late, max_error=None, budget_ms=tight)[1] > 0


def test_from_a_choice_that_turned_out_too_slow_the_way_back_is_no_search(
    monkeypatch: pytest.MonkeyPatch, past: RenderHistory
) -> None:
    rest = with_search(past, None)
    plans = [planned(monkeypatch, rest, max_error=None, budget_ms=budget)[0] for budget in (30.0, 1000.0)]
    quick, slow = (plan.search for plan in plans)
    assert quick is not None and slow is not None and quick.possible and quick.settings != slow.settings
    middle = 0.5 * sum(plan.predicted_ms or 0.0 for plan in plans)
    stood = replace(quick, wishes=(middle, None), pictures=3)
    assert stood.tried is not None and stood.tried.settings is stood.settings
    assert replace(quick, earlier=stood).tried is stood and quick.tried is None
    missed = replace(slow, wishes=(middle, None), pictures=1, earlier=stood)
    plan, searches = planned(monkeypatch, with_search(rest, missed), max_error=None, budget_ms=middle)
    assert searches == 0 and plan.search is not None and plan.search.settings == quick.settings
    assert plan.search.pictures == 1, "it stands for as long as a new one"
    lost = replace(missed, earlier=None)
    assert planned(monkeypatch, with_search(rest, lost), max_error=None, budget_ms=middle)[1] > 0


def test_headroom_follows_how_far_times_are_missed() -> None:
    assert headroom(Pace()) == HEADROOM
    pace = Pace()
    for _ in range(MISSES):
        pace = pace.missed(100.0, 100.0)
    assert headroom(pace) == HEADROOMS[1], "as foreseen, picture after picture"
    for _ in range(MISSES):
        pace = pace.missed(125.0, 100.0)
    assert headroom(pace) == pytest.approx(TOLERANCE / 1.25), "always a quarter later"
    for number in range(MISSES):
        pace = pace.missed(145.0 if number % 2 else 100.0, 100.0)
    assert headroom(pace) == pytest.approx(TOLERANCE / 1.45) and headroom(pace) > HEADROOMS[0]
    assert pace.missed(100.0, 0.0) is pace.missed(0.0, 100.0) is pace


def test_one_late_picture_of_twenty_takes_no_headroom() -> None:
    steady = Pace()
    for _ in range(MISSES):
        steady = steady.missed(100.0, 100.0)
    once = steady.missed(140.0, 100.0)
    assert headroom(once) == headroom(steady)
    assert headroom(once.missed(140.0, 100.0)) == pytest.approx(TOLERANCE / 1.4)
    assert steady.missed(200.0, 100.0) is steady, "no headroom would have kept that"


def test_a_search_is_paid_by_its_picture_alone(past: RenderHistory) -> None:
    """What is chosen for the pictures after it may fill what the search takes."""
    found = with_search(past, None)
    assert found.pace is not None
    usual = tr.plan(SCENE, CAMERA, history=found, options=OPTIONS, budget_ms=1000.0).predicted_ms or 0.0
    costly = replace(found, pace=replace(found.pace, known={**found.pace.known, SEARCHING: usual}))
    plan = tr.plan(SCENE, CAMERA, history=costly, options=OPTIONS, budget_ms=1.2 * usual / HEADROOM)
    assert plan.search is not None and plan.search.later is not None
    assert (plan.predicted_ms or 0.0) < plan.search.later.cost[0]
