"""Choices beyond a single search: the quickest that surely keeps an error bound, and what a first picture makes for
those that follow."""

from __future__ import annotations

from dataclasses import replace

from torchrender.passes.contract import Buffers
from torchrender.pipeline.buffer import same
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.foresight import LEAST
from torchrender.planning.question import Question
from torchrender.planning.rows import expected_of, most_of, rows_of
from torchrender.planning.search import LOYALTY, Choice, choose, fits
from torchrender.planning.standing import PICTURES, Standing

ROUNDS = 6
"""Of looking for the quickest choice that surely keeps a bound."""

SURE = (1.0, 0.6, 0.3, 0.0)
"""Shares of what errors may be above what is expected, on a logarithmic scale, that a bound is kept by: the first one
where some settings do."""

WARY = 1.0
"""Standard deviations that a setting's error counts higher by where a bound is to be kept: of two settings that err
about alike the surer one is taken."""

HOPE = 2.0
"""Of a budget: later pictures may take half of what is expected, before one tells how fast the machine is."""

MOST = 1.5
"""Times a budget that a first picture may take longer for those that follow."""

CLOSE = 0.97
"""Of a bound: what fills it that far is not searched for again."""


def chosen(question: Question, choice: Choice, later: Choice | None = None) -> Standing:
    """A choice with its rows, and the error that is expected of it."""
    options = question.options_at(choice.settings)
    rows = rows_of(question.knowledge, options)
    expected = expected_of(question.knowledge, rows, options)
    if expected is not None:
        choice = replace(choice, predicted_error=expected.error)
    return Standing(choice, options, rows, None, later)


def surely(question: Question, wishes: tuple[float | None, float, float]) -> Standing:
    """The quickest choice that keeps an error bound as surely as any does; the most exact one where none does."""
    made: Standing | None = None
    for share in SURE:
        found = _as_sure(question, wishes, share)
        if found.choice.possible:
            return found
        made = made or found
    assert made is not None
    return made


def _as_sure(question: Question, wishes: tuple[float | None, float, float], share: float) -> Standing:
    """The quickest choice whose error, taken that far up in its interval, keeps the bound.

    How far a prediction may be off depends on what is chosen: what the search may take errors to be follows that.
    """
    budget_ms, max_error, spent_ms = wishes
    bound, best, tried = max_error, None, set()
    for _ in range(ROUNDS):
        choice = choose(question, budget_ms, bound, spent_ms)
        found = chosen(question, choice)
        expected = expected_of(question.knowledge, found.rows, found.options)
        if expected is None:
            return found
        most = expected.error * (most_of(question.knowledge, expected) / max(expected.error, LEAST)) ** share
        settings = tuple(sorted(found.choice.settings.items()))
        if most <= max_error:
            if fits(question, budget_ms, found.choice) and (best is None or found.choice.predicted_ms < best[0]):
                best = found.choice.predicted_ms, found
            if most >= CLOSE * max_error:
                break
        if settings in tried or (most > max_error and not choice.possible):
            break
        tried.add(settings)
        # What the search takes the error of this choice to be stands for the most that it may be.
        bound = min(choice.predicted_error * max_error / max(most, LEAST) * (CLOSE if most > max_error else 1.0), 1.0)
    if best is not None:
        return best[1]._replace(choice=replace(best[1].choice, possible=True))
    least = chosen(question, choose(question, budget_ms, 0.0, spent_ms))
    return least._replace(choice=replace(least.choice, possible=False))


def looked_ahead(
    question: Question, choice: Choice, budget_ms: float, spent_ms: tuple[float, float]
) -> Standing | None:
    """A first or second picture of a sequence with a budget that makes what lasts for those that follow.

    What lasts, as triangles sorted for rays, may be more than any single picture can pay, and yet let all that follow
    be more exact at the same time. A first picture that does not keep its budget in any case makes it, if that takes
    not much longer than the budget itself; a second one does where something that keeps the budget is left beside it.

    Args:
        choice: that keeps the budget, or is the quickest.
        spent_ms: without and with a search.

    Returns:
        None where there is nothing to make, or no time.
    """
    knowledge = question.knowledge
    pictures = knowledge.outlook.history.pictures
    if pictures > 1 or (pictures == 1 and not choice.possible):
        return None
    hoped_ms = budget_ms if choice.possible else HOPE * budget_ms
    aim = choose(replace(question, share=1.0 / PICTURES, _memo={}), hoped_ms, None, spent_ms[0])
    if not aim.possible:
        return None
    if choice.possible:
        ahead = _missing(question, question.options_at(choice.settings), question.options_at(aim.settings))
        found = _richer(question, choice, ahead, (budget_ms, spent_ms[1])) if ahead else None
        return found if found is not None and found.choice.possible else None
    # What belongs to the sequence, as maps fitted to what is seen, is made anew where the eye goes on.
    kinds = {step.name: step.makes.lasting for step in knowledge.passes}
    lasting = {name for name, kind in kinds.items() if kind is not None and kind.shared}
    for own in ({name: setting for name, setting in aim.settings.items() if name in lasting}, {}):
        settings = {**choice.settings, **own}
        ahead = _missing(question, question.options_at(settings), question.options_at(aim.settings))
        found = _richer(question, replace(choice, settings=settings), ahead, (None, spent_ms[1]))
        if found.choice.predicted_ms - choice.predicted_ms <= MOST * budget_ms:
            return found
    return None


def paid_once(question: Question, choice: Choice, budget_ms: float, spent_ms: float) -> Standing | None:
    """A better choice for pictures that stay where they are, which only what lasts keeps from fitting a budget: one of
    them makes that, and is late.

    Args:
        choice: that keeps the budget, or is the quickest.

    Returns:
        None where there is none, the picture would be very late, or one has been late a short while ago that need not.
    """
    if choice.possible and question.knowledge.pace.wary:
        return None
    aim = choose(replace(question, share=1.0 / PICTURES, _memo={}), budget_ms, None, spent_ms)
    if choice.possible:
        better = aim.possible and aim.predicted_error * LOYALTY < choice.predicted_error
    else:
        better = aim.possible or aim.predicted_ms * LOYALTY < choice.predicted_ms
    if not better:
        return None
    found = chosen(question, replace(aim, possible=False))
    taken = spent_ms + sum(row.predicted_ms or 0.0 for row in found.rows if row.runs)
    if taken > (1.0 + MOST) * budget_ms:
        return None
    return found._replace(choice=replace(found.choice, predicted_ms=taken, possible=taken <= budget_ms))


def _richer(question: Question, choice: Choice, ahead: Buffers, wish: tuple[float | None, float]) -> Standing:
    """A choice that makes something for later pictures: the best within a budget, or as it is without one."""
    budget_ms, spent_ms = wish
    richer = replace(question, knowledge=replace(question.knowledge, ahead=ahead), _memo={})
    if budget_ms is not None:
        return chosen(richer, choose(richer, budget_ms, None, spent_ms))._replace(ahead=ahead)
    found = chosen(richer, choice)
    taken = spent_ms + sum(row.predicted_ms or 0.0 for row in found.rows if row.runs)
    return found._replace(choice=replace(found.choice, predicted_ms=taken), ahead=ahead)


def _missing(question: Question, options: RenderOptions, aim: RenderOptions) -> Buffers:
    """What lasts that pictures with the options ``aim`` use, these do not make, and would be the same."""
    running = {step.makes for step in question.knowledge.graph(options).running}
    found = []
    for step in question.knowledge.graph(aim).running:
        lasting = step.makes.lasting
        if lasting is None or step.for_next or step.makes in running:
            continue
        if same(lasting.options(options), lasting.options(aim)):
            found.append(step.makes)
    return tuple(found)
