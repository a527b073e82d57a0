"""Pictures of a sequence stand by a choice while it holds, and learn how far a budget may be filled."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import torchrender as tr
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.pace import MISSES, SEARCHING, TOLERANCE, Pace, Search
from torchrender.planning import choices, planner, standing
from torchrender.planning.costs import Knowledge
from torchrender.planning.curves import load_curves
from torchrender.planning.plan import Plan
from torchrender.planning.search import HEADROOM, HEADROOMS, choose, headroom
from torchrender.planning.standing import FULL, LEAST_MS, LONGEST, PICTURES, SHARE, SLOWER

SCENE = tr.load("grass", size=3000)
CAMERA = SCENE.camera(width=64, height=48)
BOUND = {"max_error": 0.2}
OPTIONS = tr.RenderOptions(reuse=None)


@pytest.fixture(scope="module")
def past() -> RenderHistory:
    """After a picture that took what was predicted, with what a search before the next one came to."""
    history = tr.render(SCENE, CAMERA, history=RenderHistory(), options=OPTIONS, **BOUND).history
    assert history is not None and history.pace is not None
    # What the picture really took is this machine's, and that of the tests beside this one.
    ratios = dict.fromkeys(history.pace.ratios, 1.0)
    history = replace(history, pace=Pace(ratios=ratios, choice=history.pace.choice))
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


@pytest.mark.parametrize("share", [0.2, 0.95, 1.5])
@pytest.mark.parametrize("stood", [0, PICTURES, LONGEST])
@pytest.mark.parametrize("pictures", [1, 2, 100])
def test_under_a_budget_no_picture_pays_for_a_search(
    monkeypatch: pytest.MonkeyPatch, past: RenderHistory, share: float, stood: int, pictures: int
) -> None:
    """Whatever the choice leaves of it, and however long it stood: searches come after pictures."""
    plan, _ = planned(monkeypatch, with_search(past, None), max_error=None, budget_ms=1000.0)
    assert plan.search is not None and plan.possible
    budget = (plan.predicted_ms or 0.0) / (share * HEADROOM)
    kept = with_search(past, replace(plan.search, wishes=(budget, None), pictures=stood, quicker=None, earlier=None))
    again, searches = planned(monkeypatch, replace(kept, pictures=pictures), max_error=None, budget_ms=budget)
    assert searches == 0 and again.search is not None and again.search.settings == plan.search.settings
    assert again.possible == (share < 1.0), "it says so"


@pytest.mark.parametrize("spent, ms, moved, holds", [
    (70.0, 20.0, True, True), (20.0, 20.0, True, False), (20.0, 20.0, False, True),
    (105.0, 20.0, False, True), (60.0, 60.0, False, False),
], ids=["no room", "room", "as it was", "little to save", "much to save"])  # fmt: skip
def test_in_the_middle_of_a_picture_a_search_has_to_be_worth_its_time(
    past: RenderHistory, spent: float, ms: float, moved: bool, holds: bool
) -> None:
    """A budget of 100 ms, of which a search takes 40 and half of one 20; errors that moved ask for one."""
    assert past.pace is not None
    usual = sum(past.pace.beside(past.pace.looks_next).values())
    known = {**past.pace.known, SEARCHING: usual + 40.0}
    history = replace(past, pace=replace(past.pace, known=known))
    knowledge = Knowledge.of(SCENE, CAMERA, OPTIONS, history, load_curves())
    search = replace(last(past), wishes=(100.0, None), possible=True, cost=(ms, 0.1, 0.2))
    cost = (ms, 0.2 if moved else 0.1, 0.3)
    assert standing._holds(knowledge, search, search.wishes, cost, spent, True) == holds


def test_what_became_possible_is_said_to_be(monkeypatch: pytest.MonkeyPatch, past: RenderHistory) -> None:
    plan, _ = planned(monkeypatch, with_search(past, None), max_error=None, budget_ms=1000.0)
    assert plan.search is not None and plan.possible
    assert planned(monkeypatch, with_search(past, plan.search), max_error=None, budget_ms=1000.0)[1] == 0
    lost = with_search(past, replace(plan.search, possible=False))
    again, searches = planned(monkeypatch, lost, max_error=None, budget_ms=1000.0)
    assert again.possible and searches == 0


def test_first_choices_stand_for_a_short_time(monkeypatch: pytest.MonkeyPatch, past: RenderHistory) -> None:
    young = replace(with_search(past, replace(last(past), pictures=1)), pictures=3)
    assert planned(monkeypatch, young)[1] > 0
    assert planned(monkeypatch, replace(young, pictures=4))[1] == 0


def test_where_a_budget_became_too_small_something_quicker_is_taken(
    monkeypatch: pytest.MonkeyPatch, past: RenderHistory
) -> None:
    """The same wish and the same predictions, but less of the budget may be filled: what the search found beside its
    choice, as quick as need be."""
    assert past.pace is not None
    rest = with_search(past, None)
    plans = [planned(monkeypatch, rest, max_error=None, budget_ms=budget)[0] for budget in (1000.0, 60.0, 20.0)]
    chosen, quick, least = (plan.search for plan in plans)
    assert chosen is not None and quick is not None and least is not None
    assert chosen.cost[0] > quick.cost[0] > least.cost[0] and chosen.possible
    tight = 1.02 * (plans[0].predicted_ms or 0.0) / (FULL * HEADROOM)
    wishes = (tight, None)
    quick = replace(quick, wishes=wishes, quicker=replace(least, wishes=wishes))
    kept = with_search(past, replace(chosen, wishes=wishes, quicker=quick))
    stays = planned(monkeypatch, kept, max_error=None, budget_ms=tight)[0].search
    assert stays is not None and stays.settings == chosen.settings
    assert kept.pace is not None
    for slower, wanted in ((1.5, quick), (1e3, least)):
        ratios = {key: slower * kept.pace.ratio(*key) for key in chosen.settings.items()}
        late = replace(kept, pace=replace(kept.pace, ratios=ratios, misses=(0.35, 0.35)))
        plan, searches = planned(monkeypatch, late, max_error=None, budget_ms=tight)
        assert searches == 0 and plan.search is not None and plan.search.settings == wanted.settings, slower
        assert plan.search.pictures == PICTURES, "it is coarse: a search is due as soon as there is time"
        assert plan.possible == (slower < 10.0)


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
    assert plan.search.pictures == PICTURES and plan.possible, "a search is due as soon as there is time"
    lost, searches = planned(
        monkeypatch, with_search(rest, replace(missed, earlier=None)), max_error=None, budget_ms=middle
    )
    assert searches == 0 and not lost.possible and lost.search is not None and lost.search.settings == slow.settings


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
