"""What a picture tells the next one of its sequence about time beside its passes."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from torchrender.pipeline.pace import (
    BESIDE,
    FIRST_BESIDE,
    FIRST_SEARCHING,
    FIRST_UNPRICED,
    LAST_UNPRICED,
    REPEATING,
    SEARCHING,
    UNPRICED,
    Search,
)
from torchrender.planning.costs import Knowledge
from torchrender.planning.plan import Plan

YOUNG = 2
"""Pictures of a sequence that load much for what they sense."""


def beside(
    knowledge: Knowledge, took: Mapping[str, float], searches: Sequence[Search], repeats: bool
) -> dict[str, float]:
    """What later pictures will spend beside their passes, about: with a search, standing by this choice, and repeating
    its plans.

    Args:
        took: milliseconds by step. searches: of its plans. repeats: it was made by the plans of the last one.
    """
    past = knowledge.outlook.history
    found: dict[str, float] = {}
    stands = bool(searches) and all(search.pictures for search in searches)
    if repeats:
        found[REPEATING] = took.get("plan", 0.0)
        return found | ({BESIDE["senses"]: took["senses"]} if "senses" in took else {})
    for name, known in BESIDE.items():
        most = FIRST_BESIDE[name] if name == "plan" or past.pictures < YOUNG else math.inf
        if name == "plan" and past.pictures:
            most = math.inf if stands else knowledge.pace.known.get(known, most)
        if name == "plan" or name in took:
            found[known] = min(took.get(name, 0.0), most)
    if past.pictures and searches and not stands:
        searching = sum(took.get(name, 0.0) for name in BESIDE)
        # Of a second picture, much of it is done for the first time.
        found[SEARCHING] = min(searching, FIRST_SEARCHING) if past.pictures == 1 else searching
    return found


def unpriced(
    knowledge: Knowledge, plan: Plan, took: Mapping[str, float], untypical: Collection[str]
) -> dict[str, float]:
    """What no curve prices of the time of a picture after another one: the least of the last two."""
    if not knowledge.outlook.history.pictures:
        return {}
    priced = sum(row.measured_ms or 0.0 for row in plan.running if row.predicted_ms or row.name in untypical)
    now = max(took.get("total", 0.0) - priced - sum(took.get(name, 0.0) for name in BESIDE), 0.0)
    return {UNPRICED: min(now, knowledge.pace.known.get(LAST_UNPRICED, FIRST_UNPRICED)), LAST_UNPRICED: now}
