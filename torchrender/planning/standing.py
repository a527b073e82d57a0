"""Pictures of a sequence stand by the last one's choice while little has changed: a search takes as long as a small
picture.

What is expected of the choice is worked out anew for every picture, so that a choice which no longer keeps what was
wished for, or has become quicker, slower or less exact than it was, makes way for a search.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Search
from torchrender.planning.costs import Knowledge
from torchrender.planning.foresight import Expected
from torchrender.planning.plan import PlanRow
from torchrender.planning.rows import expected_of, rows_of
from torchrender.planning.search import Choice, headroom

PICTURES = 8
"""That stand by a search at most, and half as many as were made before it: what is known of other settings changes,
fast at first."""

SLOWER, WORSE = 1.25, 1.1
"""Times that milliseconds and errors may have grown or shrunk since."""

LEAST_MS = 8.0
"""Changes of times below this are none: a search takes as long."""

Cost = tuple[float, float, float]


class Standing(NamedTuple):
    """A choice with what a picture made by it is."""

    choice: Choice
    options: RenderOptions
    rows: tuple[PlanRow, ...]
    search: Search | None  # that it stands by; None: it is a new one


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
) -> Standing | None:
    """The choice of the last pictures at this place, if it was about the same and still holds.

    Args:
        options: before the choice, as far as passes did not run.
        done: passes that ran, in order.
    """
    last = knowledge.pace.searches.get(done)
    most = min(PICTURES, knowledge.outlook.history.pictures // 2)
    if last is None or last.pictures >= most or not last.is_of(wishes, knowledge.outlook.options):
        return None
    for step in knowledge.passes:
        if step.name in last.settings:
            setting = step.settings.named(last.settings[step.name])
            if step.name not in done:
                options = setting.applied(options)
            elif not setting.matches(options):
                return None
    rows = rows_of(knowledge, options)
    expected = expected_of(knowledge, rows, options)
    cost = cost_of_rows(rows, expected, frozenset(done))
    if _moved(cost, last.cost) or last.possible != _kept(knowledge, wishes, cost, spent_ms):
        return None
    choice = Choice(
        settings=last.settings,
        predicted_ms=spent_ms + cost[0],
        predicted_error=cost[1],
        possible=last.possible,
    )
    return Standing(choice, options, rows, replace(last, pictures=last.pictures + 1))


def _moved(cost: Cost, before: Cost) -> bool:
    slower = max(cost[0], before[0]) > SLOWER * min(cost[0], before[0]) + LEAST_MS
    return slower or not math.isclose(cost[1], before[1], rel_tol=WORSE - 1.0, abs_tol=1e-6)


def _kept(knowledge: Knowledge, wishes: tuple[float | None, float | None], cost: Cost, spent_ms: float) -> bool:
    """What was wished for is kept; bounds that nothing surely keeps are those of the error alone."""
    budget, bound = wishes
    in_time = budget is None or spent_ms + cost[0] <= headroom(knowledge.pace) * budget
    return in_time and (bound is None or cost[1] <= bound)
