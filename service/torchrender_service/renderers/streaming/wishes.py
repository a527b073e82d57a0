"""What the pictures of a stream may cost, and what is said where that is not enough."""

from __future__ import annotations

from typing import Any

from torchrender_service.renderers.jobs import Bounds, MakeKeyframe

MOVING_BUDGET_MS = 95.0
"""Time for a moving keyframe where the session asks for no other: eight of them a second leave 30 ms for what is not
done beside."""
STILL_FACTOR = 4.0
"""A refinement may take this many times the budget."""
PACKING_SHARE = 0.5
"""Of the budget, at most, that is kept free for making messages."""


def picture_bounds(job: MakeKeyframe, packing_ms: float) -> Bounds:
    """What the picture of layer 0 may cost, which then takes ``packing_ms`` to become a message.

    A bound of the error holds at rest; while the view moves, as far as there is time for it.
    """
    budget, error = job.bounds.budget_ms, job.bounds.max_error
    if budget is None and not job.still:
        budget = MOVING_BUDGET_MS
    if budget is not None:
        budget *= STILL_FACTOR if job.still else 1.0
        budget -= min(packing_ms, PACKING_SHARE * budget)
    return Bounds(budget_ms=budget, max_error=error)


def in_words_of(job: MakeKeyframe, plan: dict[str, Any]) -> dict[str, Any]:
    """A picture's plan as plain values; why it is not possible is told by what the session asked for: the planner knows
    only the budget that was made of it."""
    budget, asked = plan["budget_ms"], job.bounds.budget_ms
    if not plan["statement"] or budget is None or budget == asked:
        return plan
    if asked is not None:
        share = f"{STILL_FACTOR:g} times that, at rest" if job.still else "that"
        origin = f"of a budget of {asked:g} ms the picture has {budget:.3g} ms: {share}, less what sending it takes"
        return {**plan, "statement": f"{origin}; {plan['statement']}"}
    told = f"while the view moves a picture has about {budget:.0f} ms"
    if plan["predicted_ms"] is not None:
        told += f", and this one is expected to take {plan['predicted_ms']:.0f} ms"
    if plan["max_error"] is not None:
        error = plan["predicted_error"]
        expected = "" if error is None else f": an error of about {error:.2g} is expected"
        told += f"{expected}; the bound of {plan['max_error']:g} is for the view at rest"
    return {**plan, "statement": told}
