"""Pictures of a sequence stand by the last one's choice while little has changed: a search takes as long as a small
picture.

What is expected of the choice is worked out anew for every picture, so that a choice which no longer keeps what was
wished for, or has become quicker, slower or less exact than it was, makes way for a search. That search has to be worth
its time: for a bound it is a small share of what the pictures took that stood by the last one, and under a budget it
comes after pictures, in what they leave of their time (:mod:`torchrender.planning.ahead`), while there is a choice that
fits. Within a picture, what its checkpoints found out counts in the same way.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from torchrender.passes.contract import Buffers
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import FIRST_SEARCHING, SEARCHING, TOLERANCE, Pace, Search
from torchrender.planning.costs import Knowledge
from torchrender.planning.foresight import Expected
from torchrender.planning.plan import Plan, PlanRow
from torchrender.planning.rows import expected_of, rows_of
from torchrender.planning.search import Choice, headroom

PICTURES = 8
"""That stand by a search at most, and half as many as were made before it: what is known of other settings changes,
fast at first."""

SLOWER, WORSE = 1.25, 1.1
"""Times that milliseconds and errors may have grown or shrunk since."""

LEAST_MS = 8.0
"""Changes of times below this are none: a search takes as long."""

SHARE = 0.05
"""Of a budget that searches may take, over the pictures that stand by them."""

FULL = 1.04
"""Times what a search may fill of a budget that a standing choice may: what a picture takes goes up and down."""

FILLED = 0.95
"""Share of what a search may fill: with a choice that takes as much there is little left to gain."""

LONGEST = 8 * PICTURES
"""Pictures that stand by any search at most."""

EARLY = 3
"""Pictures of a sequence after which another search is worth its time in any case: the first ones tell most."""

REST = 0.5
"""Of the time of a search that one takes over what is left in the middle of a picture, and of what is left that quicker
settings save, about."""

Cost = tuple[float, float, float]


class Standing(NamedTuple):
    """A choice with what a picture made by it is."""

    choice: Choice
    options: RenderOptions
    rows: tuple[PlanRow, ...]
    search: Search | None  # that it stands by; None: it is a new one
    later: Choice | None = None  # of pictures that need not pay for a search
    ahead: Buffers = ()  # that last, made for pictures to come


def cost_of_rows(rows: tuple[PlanRow, ...], expected: Expected | None, done: frozenset[str]) -> Cost:
    """Expected milliseconds of what is to run, error, and how much that is at most."""
    left = sum(row.predicted_ms or 0.0 for row in rows if row.runs and row.name not in done)
    return (left, *((0.0, 0.0) if expected is None else (expected.error, expected.interval[1])))


def stands(
    knowledge: Knowledge,
    options: RenderOptions,
    wishes: tuple[float | None, float | None],
    done: tuple[str, ...],
    spent_ms: float,
    before: Plan | None = None,
) -> Standing | None:
    """The choice of the last pictures, or of this one at an earlier place, if it was about the same and still holds.

    Args:
        options: before the choice, as far as passes did not run.
        done: passes that ran, in order.
        before: the plan that was made at an earlier place of this picture.
    """
    last = knowledge.pace.search if before is None else _left_of(knowledge, before, done)
    if last is None or not last.is_of(wishes, knowledge.outlook.options):
        return None
    made = _chosen_by(knowledge, options, last, done)
    if made is None:
        return None
    now = _priced(knowledge, last, made, (done, spent_ms), before is None)
    if before is None and _is_due(knowledge, last, wishes, now.choice.predicted_ms):
        return None
    assert now.search is not None
    if _holds(knowledge, last, wishes, now.search.cost, spent_ms, before is not None):
        stood = replace(last, pictures=last.pictures + (before is None))
        return now._replace(choice=replace(now.choice, possible=last.possible), search=stood)
    if before is not None or wishes[0] is None or wishes[1] is not None:
        return None
    return _instead(knowledge, options, now, spent_ms)


def _priced(
    knowledge: Knowledge, search: Search, made: RenderOptions, past: tuple[tuple[str, ...], float], whole: bool
) -> Standing:
    """A picture by that choice, with what it is expected to cost now.

    Args:
        past: passes that ran, and milliseconds that are spent. whole: it is all of the picture.
    """
    ahead = search.ahead if whole and not search.pictures else ()
    known = replace(knowledge, ahead=ahead) if ahead else knowledge
    rows = rows_of(known, made)
    expected = expected_of(known, rows, made)
    cost = cost_of_rows(rows, expected, frozenset(past[0]))
    choice = Choice(
        settings=search.settings, predicted_ms=past[1] + cost[0], predicted_error=cost[1], possible=search.possible
    )
    return Standing(choice, made, rows, replace(search, cost=cost), None, ahead)


def _instead(knowledge: Knowledge, options: RenderOptions, slow: Standing, spent_ms: float) -> Standing:
    """Where the last choice turned out too slow for a budget: a quicker one of the same search, or that before it.

    A search would make the picture late. What others cost is taken to have grown by as much; where none of them fits,
    the quickest is as good as it gets, and a search after the picture finds what does.
    """
    last = knowledge.pace.search
    assert last is not None and slow.search is not None and last.wishes[0] is not None
    left = headroom(knowledge.pace) * last.wishes[0] - spent_ms
    grown = slow.search.cost[0] / max(last.cost[0], 1e-3)
    others = last.quickly
    others[1:1] = [last.earlier] if last.earlier is not None else []
    fitting = [one for one in others if grown * one.cost[0] <= left]
    stood = 1
    for one in fitting[:1] or sorted(others, key=lambda one: one.cost[0])[:1]:
        made = _chosen_by(knowledge, options, one, ())
        found = None if made is None else _priced(knowledge, one, made, ((), spent_ms), True)
        if found is not None and found.choice.predicted_ms < slow.choice.predicted_ms:
            slow, stood = found, PICTURES  # it is coarse: a search is due as soon as there is time for it
    assert slow.search is not None
    fits = slow.choice.predicted_ms <= FULL * headroom(knowledge.pace) * last.wishes[0]
    return slow._replace(
        choice=replace(slow.choice, possible=fits), search=replace(slow.search, possible=fits, pictures=stood)
    )


def _chosen_by(
    knowledge: Knowledge, options: RenderOptions, search: Search, done: tuple[str, ...]
) -> RenderOptions | None:
    """The options with a search's settings; None where passes ran at others."""
    for step in knowledge.passes:
        if step.name in search.settings:
            setting = step.settings.named(search.settings[step.name])
            if step.name not in done:
                options = setting.applied(options)
            elif not setting.matches(options):
                return None
    return options


def _holds(
    knowledge: Knowledge,
    search: Search,
    wishes: tuple[float | None, float | None],
    cost: Cost,
    spent_ms: float,
    begun: bool,
) -> bool:
    """The choice still keeps what was wished for, as far as it did, at about the same cost.

    Args:
        begun: some passes of the picture ran.
    """
    budget, bound = wishes
    if budget is None or bound is not None:
        return not _moved(cost, search.cost) and search.possible == _kept(knowledge, wishes, cost, spent_ms)
    if not begun or not search.possible:
        return _fits(knowledge, search, budget, spent_ms + cost[0])
    # What is left varies as whole pictures do; what was chosen for it stays while it ends within the tolerance and
    # leaves no time for another search, and where a search takes about what quicker settings save.
    again_ms, needed_ms = REST * knowledge.pace.search_ms, spent_ms + cost[0] / headroom(knowledge.pace)
    fits = needed_ms <= TOLERANCE * budget or again_ms > REST * cost[0]
    return fits and (needed_ms + again_ms > budget or not _moved(cost, search.cost))


def still_holds(
    knowledge: Knowledge, last: Search, wishes: tuple[float | None, float | None], cost: Cost, spent_ms: float
) -> bool:
    """A whole picture by a choice, which now costs so much, does not ask for another one."""
    due = _is_due(knowledge, last, wishes, spent_ms + cost[0])
    return not due and _holds(knowledge, last, wishes, cost, spent_ms, False)


def still_in_time(budget: float, needed_ms: float) -> bool:
    """What was foreseen of a picture, as far as it goes, is kept: nothing asks to choose anew in the middle of it."""
    return needed_ms <= TOLERANCE * budget


def _left_of(knowledge: Knowledge, before: Plan, done: tuple[str, ...]) -> Search | None:
    """The search of an earlier place, with what it expected of the passes that are left."""
    if before.search is None:
        return None
    expected = expected_of(knowledge, before.rows, before.options)
    return replace(before.search, cost=cost_of_rows(before.rows, expected, frozenset(done)))


def _is_due(knowledge: Knowledge, last: Search, wishes: tuple[float | None, float | None], needed_ms: float) -> bool:
    """Enough pictures stood by a choice for another search to be worth its time, where a bound is to be kept."""
    pictures = knowledge.outlook.history.pictures
    budget, bound = wishes
    if bound is None or last.pictures < min(PICTURES, pictures // 2):
        return False
    if budget is not None or pictures < 2 or last.pictures >= LONGEST:
        return True
    searching = searching_of(knowledge.pace)
    return pictures <= EARLY or last.pictures >= searching / (SHARE * max(needed_ms, LEAST_MS))


def is_due_after(pace: Pace, pictures: int, budget: float, took_ms: float, error: float | None) -> bool:
    """After a picture under a budget it is time for another search, for those that follow.

    After the first one it is, which tells how fast the machine is, after one that took more than may be filled, once
    the search of a choice that errs by something else than it did is a small share of what pictures took since, and
    once enough pictures stood by one that leaves some of the budget.

    Args:
        pictures: of the sequence so far. took_ms: of the last one, with what it is expected to err by.
    """
    last = pace.search
    if last is None:
        return False
    if pictures < 2 or last.pictures >= LONGEST or (last.ahead and last.pictures == 1):
        return True
    room = headroom(pace) * budget
    if took_ms > FULL * room:
        return last.pictures >= (1 if last.possible or pictures <= EARLY else PICTURES)
    if error is not None and not _about(error, last.cost[1]):
        return last.pictures >= max(min(PICTURES, searching_of(pace) / (SHARE * budget)), 1)
    return took_ms < FILLED * room and last.pictures >= min(PICTURES, pictures // 2)


def searching_of(pace: Pace) -> float:
    """Milliseconds of a search."""
    return pace.known.get(SEARCHING, FIRST_SEARCHING)


def _fits(knowledge: Knowledge, last: Search, budget: float, needed_ms: float) -> bool:
    """The choice still fits a budget; one that did not fit does not fit better with the time of another search."""
    if last.possible:
        return needed_ms <= FULL * headroom(knowledge.pace) * budget
    return needed_ms + knowledge.pace.search_ms > headroom(knowledge.pace) * budget


def _moved(cost: Cost, before: Cost) -> bool:
    slower = max(cost[0], before[0]) > SLOWER * min(cost[0], before[0]) + LEAST_MS
    return slower or not _about(cost[1], before[1])


def _about(error: float, before: float) -> bool:
    """Errors are about the same."""
    return math.isclose(error, before, rel_tol=WORSE - 1.0, abs_tol=1e-6)


def _kept(knowledge: Knowledge, wishes: tuple[float | None, float | None], cost: Cost, spent_ms: float) -> bool:
    """What was wished for is kept; bounds that nothing surely keeps are those of the error alone."""
    budget, bound = wishes
    in_time = budget is None or spent_ms + cost[0] <= headroom(knowledge.pace) * budget
    return in_time and (bound is None or cost[1] <= bound)
