"""What passes of a picture cost and err by with given options: rows of its plan."""

from __future__ import annotations

from torchrender.passes.settings import CUSTOM
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import Knowledge, is_seen
from torchrender.planning.foresight import Expected
from torchrender.planning.plan import PlanRow

NOTHING = Expected(0.0, 0.0)

GUARD, UNSEEN_GUARD, FIRST_GUARD = 0.6, 0.75, 0.9
"""Powers of what an interval leaves above an error that bounds are kept by: of a scene that was measured, of another
one, and of its first picture, which a look with a quarter of the pixels tells less of. Of 36 first pictures 5 came out
beyond six tenths of it and 2 beyond nine, of 60 later ones 5, and 1 beyond three quarters. Times over the cheapest that
keeps a bound: 1.10 in the median with six tenths in any case, 1.11 with three quarters, and 1.35 with 0.95."""


def rows_of(knowledge: Knowledge, options: RenderOptions) -> tuple[PlanRow, ...]:
    """Of all passes: those that run, in order, then the others."""
    graph, outlook = knowledge.graph(options), knowledge.outlook.at(options)
    rows = []
    for step in (*graph.running, *(step for step in knowledge.passes if not graph.verdicts[step.name].runs)):
        setting, verdict = step.settings.current(options), graph.verdicts[step.name]
        time, error = None, None
        if verdict.runs and setting != CUSTOM:
            time = knowledge.predicted_ms(step, setting, step.amounts(outlook))
            error = knowledge.setting_error(step, setting, options) if is_seen(step, graph) else NOTHING
        elif knowledge.leaves_out(step, options):
            error = knowledge.setting_error(step, setting, options)
        rows.append(
            PlanRow(
                name=step.name,
                runs=verdict.runs,
                reason=verdict.reason,
                setting=setting,
                predicted_ms=time,
                expected_error=error,
                lasts=step.makes.lasting is not None,
            )
        )
    return tuple(rows)


def expected_of(knowledge: Knowledge, rows: tuple[PlanRow, ...], options: RenderOptions) -> Expected | None:
    """The error of a picture whose passes run like this; None where one was never measured."""
    found = [row.expected_error for row in rows if row.runs or row.expected_error is not None]
    known = [one for one in found if one is not None]
    unseen = options if knowledge.unseen else None
    if len(known) != len(found):
        return None
    return knowledge.curves.together(known, scene=knowledge.name, unseen=unseen)


def most_of(knowledge: Knowledge, expected: Expected) -> float:
    """What the error of a picture is taken to be at most where a bound is to be kept."""
    if expected.error <= 0.0:
        return expected.interval[1]
    guard = (UNSEEN_GUARD if knowledge.outlook.history.pictures else FIRST_GUARD) if knowledge.unseen else GUARD
    return float(expected.error * (expected.interval[1] / expected.error) ** guard)
