"""Wanted buffers become ordered passes, each with the reason why it runs or does not, its setting and its cost.

With a budget or an error bound the settings of all passes are chosen together. The choice is made before the picture
and again after its checkpoints, when more is known and a part of the time is spent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from torchrender.arrays import in_single_precision
from torchrender.checks import check_class, check_range, options_of
from torchrender.errors import InputError, OptionError
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import find_pass, table_of
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Search
from torchrender.planning.choices import WARY, chosen, looked_ahead, surely
from torchrender.planning.costs import Knowledge
from torchrender.planning.curves import Curves, load_curves
from torchrender.planning.graph import AnyBuffer
from torchrender.planning.plan import Plan, PlanRow
from torchrender.planning.question import Question
from torchrender.planning.rows import expected_of, rows_of
from torchrender.planning.search import Choice, choose
from torchrender.planning.standing import PICTURES, Standing, cost_of_rows, stands
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def check_wishes(budget_ms: float | None, max_error: float | None) -> None:
    """Refuse wishes that mean nothing.

    Raises:
        OptionError: ``budget_ms`` not positive, ``max_error`` outside [0, 1], or either not a number.
    """
    for name, value in (("budget_ms", budget_ms), ("max_error", max_error)):
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise OptionError(f"{name} must be a number or None, got {type(value).__name__}")
    if budget_ms is not None:
        if not budget_ms > 0:
            raise OptionError(f"budget_ms must be > 0, got {budget_ms}")
        check_range("budget_ms", budget_ms, 0.0, 1e9)
    if max_error is not None:
        check_range("max_error", max_error, 0.0, 1.0)


def check_names(options: RenderOptions) -> None:
    """Refuse passes and buffers that there are not, and to hold passes that stand at none of their settings.

    Raises:
        InputError: names them.
    """
    passes = table_of(options)
    for name in options.fixed:
        step = find_pass(name, passes)
        if step.settings.current(options) == CUSTOM:
            raise InputError(f"fixed: {name} stands at none of its settings {', '.join(step.settings.names)}")
    for name in options.effects:
        find_pass(name, passes)
    known = dict.fromkeys(buffer.name for step in passes for buffer in step.makes_all)
    for name in options.buffers:
        if name not in known:
            raise InputError(f"no pass makes a buffer {name!r}; known buffers: {', '.join(known)}")


def wishes_about(
    cameras: Cameras, budget_ms: float | None, max_error: float | None
) -> tuple[float | None, float | None]:
    """What is to be met by a picture of these cameras: no pictures have no error and take no time to choose by."""
    return (budget_ms, max_error) if len(cameras) else (None, None)


def make_plan(
    knowledge: Knowledge,
    options: RenderOptions,
    budget_ms: float | None = None,
    max_error: float | None = None,
    *,
    done: Mapping[str, float] | None = None,
    spent_ms: float = 0.0,
    before: Plan | None = None,
) -> Plan:
    """The plan of a picture.

    Args:
        done: passes that ran, with what they took; their settings are what the options say.
        spent_ms: time that was spent so far.
        before: the plan that was made at an earlier place of the picture.
    """
    ran = frozenset(done or ())
    wishes = (budget_ms, max_error)
    found = None if wishes == (None, None) else _found(knowledge, options, wishes, tuple(done or ()), spent_ms, before)
    options = settled(knowledge, options, ran) if found is None else found.options
    rows = rows_of(knowledge, options) if found is None else found.rows
    expected = expected_of(knowledge, rows, options)
    plan = Plan(
        rows=rows,
        options=options,
        budget_ms=budget_ms,
        max_error=max_error,
        predicted_error=None if expected is None else expected.error,
        error_interval=None if expected is None else expected.interval,
        ahead=() if found is None else found.ahead,
    )
    if found is None:
        return plan
    choice, search = found.choice, found.search
    if search is None:
        earlier_place = None if before is None else before.search
        search = search_of(knowledge, wishes, found, ran)
        search = replace(search, later=None if earlier_place is None else earlier_place.later)
        if found.later is not None:
            cost = (found.later.predicted_ms - spent_ms, found.later.predicted_error, found.later.predicted_error)
            chosen, possible = found.later.settings, found.later.possible
            search = replace(search, later=replace(search, settings=chosen, possible=possible, cost=cost))
    plan = replace(plan, changes=search.changes, search=search)
    return plan if choice.possible else replace(plan, possible=False, statement=_statement(plan, choice, spent_ms))


def search_of(
    knowledge: Knowledge,
    wishes: tuple[float | None, float | None],
    found: Standing,
    done: frozenset[str] = frozenset(),
) -> Search:
    """What a new choice came to, for pictures that stand by it."""
    asked = settled(knowledge, knowledge.outlook.options, done)
    expected = expected_of(knowledge, found.rows, found.options)
    return Search(
        wishes=wishes,
        asked=knowledge.outlook.options,
        settings=found.choice.settings,
        possible=found.choice.possible,
        changes=_changes(knowledge, asked, found.options, found.rows),
        cost=cost_of_rows(found.rows, expected, done),
        earlier=None if knowledge.pace.search is None else knowledge.pace.search.tried,
        ahead=found.ahead,
    )


def _found(
    knowledge: Knowledge,
    options: RenderOptions,
    wishes: tuple[float | None, float | None],
    done: tuple[str, ...],
    spent_ms: float,
    before: Plan | None,
) -> Standing:
    """The choice of the last pictures, or of an earlier place of this one, where it holds, else that of a search."""
    kept = stands(knowledge, options, wishes, done, spent_ms, before)
    if kept is not None:
        return kept
    options = settled(knowledge, options, frozenset(done))
    past, ran = knowledge.outlook.history, frozenset(done)
    going_on = past.sequence and not past.moves and not done
    budget_ms, max_error = wishes
    if budget_ms is None:
        assert max_error is not None
        share = 1.0 / PICTURES if going_on else 1.0
        return surely(Question.about(knowledge, options, ran, wary=WARY, share=share), (None, max_error, spent_ms))
    # A first picture looks around for all that follow: what they choose by its light, none of them pays for.
    once = 1.0 / PICTURES if going_on and not past.pictures and max_error is None else 1.0
    wary = 0.0 if max_error is None else WARY
    question = Question.about(knowledge, options, ran, near=True, wary=wary, careful=True, share_once=once)
    # After the first picture of a sequence those that follow are chosen for anew.
    alone = done or max_error is not None or (going_on and not past.pictures)
    later = None if alone else choose(question, budget_ms, None, spent_ms)
    paid_ms = spent_ms if done else spent_ms + knowledge.pace.search_ms
    if max_error is not None:
        return surely(question, (budget_ms, max_error, paid_ms))
    choice = choose(question, budget_ms, None, paid_ms)
    ahead = looked_ahead(question, choice, budget_ms, (spent_ms, paid_ms)) if going_on else None
    return chosen(question, choice, later) if ahead is None else ahead._replace(later=later)


def _changes(
    knowledge: Knowledge, asked: RenderOptions, chosen: RenderOptions, rows: tuple[PlanRow, ...]
) -> tuple[str, ...]:
    """What a choice took away, or added, in words; what saves most comes first.

    Fewer pixels save what all passes of the choice take less by them, another setting what its pass takes less at as
    many pixels as were asked for.
    """
    first = knowledge.passes[0]
    usual = first.settings.current(asked)
    as_many = rows
    if usual not in (CUSTOM, first.settings.current(chosen)):
        as_many = rows_of(knowledge, first.settings.named(usual).applied(chosen))
    before, between, after = (
        {row.name: row for row in made if row.runs} for made in (rows_of(knowledge, asked), as_many, rows)
    )
    found = []
    for step in knowledge.passes:
        old, new = before.get(step.name), after.get(step.name)
        if old is None or old.setting == CUSTOM or (new is not None and old.setting == new.setting):
            continue
        if step is first:
            saved = _total(between) - _total(after)
        else:
            saved = (old.predicted_ms or 0.0) - _total({step.name: between.get(step.name)})
        now = f"{new.setting} instead of {old.setting}" if new is not None else f"left out instead of {old.setting}"
        cost = f"saves {saved:.0f} ms" if saved >= 0 else f"takes {-saved:.0f} ms more"
        found.append((-saved, f"{step.name}: {now}, {cost}"))
    return tuple(text for _, text in sorted(found))


def _total(rows: Mapping[str, PlanRow | None]) -> float:
    return sum(row.predicted_ms or 0.0 for row in rows.values() if row is not None)


def settled(knowledge: Knowledge, options: RenderOptions, done: frozenset[str]) -> RenderOptions:
    """The options with what the wish leaves to the planner, as far as its pass has not run."""

    def prices(other: RenderOptions) -> dict[AnyBuffer, float | None]:
        outlook, found = knowledge.outlook.at(other), {}
        for step in knowledge.graph(other).running:
            if step.name not in done:
                setting = step.settings.current(other)
                known = setting != CUSTOM
                found[step.makes] = knowledge.predicted_ms(step, setting, step.amounts(outlook)) if known else None
        return found

    for step in knowledge.passes:
        if step.settle is not None and step.name not in done:
            options = step.settle(knowledge.outlook.at(options), prices)
    return options


def _statement(plan: Plan, choice: Choice, spent_ms: float) -> str:
    """Why a wish cannot be met; times are those of the table."""
    if plan.budget_ms is not None and choice.predicted_ms > plan.budget_ms:
        expected = choice.predicted_ms if plan.predicted_ms is None else plan.predicted_ms
        spent = f" ({spent_ms:.0f} ms were spent when the rest was chosen)" if spent_ms >= 1.0 else ""
        after = plan.following_ms
        first, follow = "", ""
        if after is not None and after != plan.predicted_ms:
            first, follow = "first ", f", each that follows in a sequence about {after:.0f} ms"
        return (
            f"a budget of {plan.budget_ms:g} ms is not enough for this {first}picture: the cheapest settings are taken "
            f"({_named(plan)}), about {expected:.0f} ms{spent}{follow}"
        )
    if plan.budget_ms is not None and plan.max_error is None:
        told = f"the cheapest settings are taken ({_named(plan)})"
        return f"a budget of {plan.budget_ms:g} ms leaves little headroom: {told}"
    where = "" if plan.budget_ms is None else f" within {plan.budget_ms:g} ms"
    return f"no settings reach an error of {plan.max_error:g}{where}: about {choice.predicted_error:.4f} is expected"


def _named(plan: Plan) -> str:
    """The settings of passes that have some."""
    rows = [row for row in plan.running if row.setting not in ("-", CUSTOM)]
    return ", ".join(f"{row.name} {row.setting}" for row in rows)


@in_single_precision
def plan(
    scene: Scene,
    camera: Cameras,
    *,
    options: RenderOptions | None = None,
    history: RenderHistory | None = None,
    budget_ms: float | None = None,
    max_error: float | None = None,
    curves: Curves | None = None,
) -> Plan:
    """What :func:`torchrender.render` would do: which passes run and why, their settings, predicted time and error.

    Raises:
        OptionError: ``budget_ms`` not positive, ``max_error`` outside [0, 1].
        InputError: ``options.fixed`` names no pass.
    """
    check_class("scene", scene, Scene)
    check_class("camera", camera, Cameras)
    check_wishes(budget_ms, max_error)
    options = options_of(options, RenderOptions)
    check_names(options)
    knowledge = Knowledge.of(scene, camera, options, history, curves or load_curves())
    return make_plan(knowledge, options, *wishes_about(camera, budget_ms, max_error))
