"""Pictures of a sequence stand by the last one's choice while little has changed: a search takes as long as a small
picture.

What is expected of the choice is worked out anew for every picture, so that a choice which no longer keeps what was
wished for, or has become quicker, slower or less exact than it was, makes way for a search. That search has to be worth
its time: it is a small share of what the pictures took that stood by the last one, and under a budget it fits into what
the choice leaves, while there is a choice that fits.
Within a picture, what its checkpoints found out counts in the same way.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from torchrender.passes.contract import Buffers
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import FIRST_SEARCHING, SEARCHING, TOLERANCE, Search
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

FILLED = 0.9
"""Share of what a search may fill: with a choice that takes as much there is little left to gain."""

LONGEST = 8 * PICTURES
"""Pictures that stand by any search at most."""

EARLY = 3
"""Pictures of a sequence after which another search is worth its time in any case: the first ones tell most."""

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
    # Where a new choice turned out too slow for a budget, the one before it is as good as known, and needs no search.
    back = last is not None and before is None and wishes[0] is not None and wishes[1] is None
    tries = (last, last.earlier if back and last is not None else None)
    for search in tries:
        if search is None or not search.is_of(wishes, knowledge.outlook.options):
            return None
        made = _chosen_by(knowledge, options, search, done)
        if made is None:
            return None
        rows = rows_of(knowledge, made)
        expected = expected_of(knowledge, rows, made)
        cost = cost_of_rows(rows, expected, frozenset(done))
        if before is None and search is last and _is_due(knowledge, search, wishes, spent_ms + cost[0]):
            return None
        if _holds(knowledge, search, wishes, cost, spent_ms, before is not None):
            choice = Choice(
                settings=search.settings,
                predicted_ms=spent_ms + cost[0],
                predicted_error=cost[1],
                possible=search.possible,
            )
            stood = (search.pictures if search is last else 0) + (before is None)
            return Standing(choice, made, rows, replace(search, pictures=stood))
    return None


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
    if begun and search.possible:
        # What is left varies as whole pictures do; what was chosen for it stays while it ends within the tolerance.
        fits = spent_ms + cost[0] / headroom(knowledge.pace) <= TOLERANCE * budget
    else:
        fits = _fits(knowledge, search, budget, spent_ms + cost[0])
    return fits and ((not begun and _is_patient(knowledge, search, budget)) or not _moved(cost, search.cost))


def _left_of(knowledge: Knowledge, before: Plan, done: tuple[str, ...]) -> Search | None:
    """The search of an earlier place, with what it expected of the passes that are left."""
    if before.search is None:
        return None
    expected = expected_of(knowledge, before.rows, before.options)
    return replace(before.search, cost=cost_of_rows(before.rows, expected, frozenset(done)))


def _is_due(knowledge: Knowledge, last: Search, wishes: tuple[float | None, float | None], needed_ms: float) -> bool:
    """Enough pictures stood by a choice for another search to be worth its time.

    Under a budget that is where the choice leaves enough of it for the search, or more than little after the first
    pictures, and later after ``PICTURES``: one that pays for a search by its own settings is worse than its neighbours.
    """
    pictures = knowledge.outlook.history.pictures
    if last.pictures < min(PICTURES, pictures // 2):
        return False
    budget, bound = wishes
    if pictures < 2 or last.pictures >= LONGEST:
        return True
    early = pictures <= EARLY
    if budget is None:
        return early or last.pictures >= _searching(knowledge) / (SHARE * max(needed_ms, LEAST_MS))
    if bound is not None:
        return True
    if last.possible and needed_ms + knowledge.pace.search_ms <= headroom(knowledge.pace) * budget:
        return True
    filled = last.possible and needed_ms >= FILLED * headroom(knowledge.pace) * budget
    return (early or last.pictures >= PICTURES) and not filled


def _is_patient(knowledge: Knowledge, last: Search, budget: float) -> bool:
    """Too few pictures stood by a search under a budget for another one; the first picture's are of no use later."""
    if knowledge.outlook.history.pictures < 2:
        return False
    return last.pictures < min(PICTURES, _searching(knowledge) / (SHARE * budget))


def _searching(knowledge: Knowledge) -> float:
    """Milliseconds of a search."""
    return knowledge.pace.known.get(SEARCHING, FIRST_SEARCHING)


def _fits(knowledge: Knowledge, last: Search, budget: float, needed_ms: float) -> bool:
    """The choice still fits a budget; one that did not fit does not fit better with the time of another search."""
    if last.possible:
        return needed_ms <= FULL * headroom(knowledge.pace) * budget
    return needed_ms + knowledge.pace.search_ms > headroom(knowledge.pace) * budget


def _moved(cost: Cost, before: Cost) -> bool:
    slower = max(cost[0], before[0]) > SLOWER * min(cost[0], before[0]) + LEAST_MS
    return slower or not math.isclose(cost[1], before[1], rel_tol=WORSE - 1.0, abs_tol=1e-6)


def _kept(knowledge: Knowledge, wishes: tuple[float | None, float | None], cost: Cost, spent_ms: float) -> bool:
    """What was wished for is kept; bounds that nothing surely keeps are those of the error alone."""
    budget, bound = wishes
    in_time = budget is None or spent_ms + cost[0] <= headroom(knowledge.pace) * budget
    return in_time and (bound is None or cost[1] <= bound)
