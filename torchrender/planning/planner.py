"""Wanted buffers become ordered passes, each with the reason why it runs or does not, its setting and its cost.

With a budget or an error bound the settings of all passes are chosen together. The choice is made before the picture
and once more after the G-buffer, when the pixels that mirror are known and a part of the time is spent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from torchrender.checks import check_range
from torchrender.errors import InputError, OptionError
from torchrender.passes.load import Load
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.table import PASSES, Pass, find_pass
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.curves import Curves, load_curves
from torchrender.planning.knowledge import WANTED, Knowledge, make_load, question_about, reusable, reuses
from torchrender.planning.plan import Plan, PlanRow
from torchrender.planning.search import Choice, Question, choose, predicted_ms, setting_error
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

CUSTOM = "custom"


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


def make_plan(
    knowledge: Knowledge,
    options: RenderOptions,
    budget_ms: float | None = None,
    max_error: float | None = None,
    *,
    spent_ms: Mapping[str, float] | None = None,
) -> Plan:
    """The plan of a picture.

    Args:
        spent_ms: time that was spent so far, by pass; the settings of these passes are what the options say.
    """
    spent = dict(spent_ms or {})
    choice = None
    if budget_ms is not None or max_error is not None:
        choice = _choice(knowledge, options, budget_ms, max_error, spent)
        for step in knowledge.passes:
            if step.name in choice.settings:
                options = step.knob.setting(choice.settings[step.name]).applied(options)
    rows = _rows(knowledge, options)
    errors = [row.predicted_error for row in rows if row.runs]
    known = [e for e in errors if e is not None]
    plan = Plan(
        rows=rows,
        options=options,
        budget_ms=budget_ms,
        max_error=max_error,
        predicted_error=knowledge.curves.together(known) if len(known) == len(errors) else None,
    )
    if choice is None or choice.possible:
        return plan
    return replace(plan, possible=False, statement=_statement(plan, choice))


def _statement(plan: Plan, choice: Choice) -> str:
    if plan.budget_ms is not None and choice.predicted_ms > plan.budget_ms:
        return (
            f"a budget of {plan.budget_ms:g} ms is not enough for this picture: the cheapest settings are taken, "
            f"about {choice.predicted_ms:.0f} ms"
        )
    if plan.budget_ms is not None and plan.max_error is None:
        return f"a budget of {plan.budget_ms:g} ms leaves little headroom: the cheapest settings are taken"
    where = "" if plan.budget_ms is None else f" within {plan.budget_ms:g} ms"
    return f"no settings reach an error of {plan.max_error:g}{where}: about {choice.predicted_error:.4f} is expected"


def check_fixed(options: RenderOptions) -> None:
    """Refuse to hold passes that there are not, or that stand where no setting of their knob is.

    Raises:
        InputError: names the pass.
    """
    for name in options.fixed:
        step = find_pass(name)
        if step.knob.current(options) == CUSTOM:
            raise InputError(f"fixed: {name} stands at none of its settings {', '.join(step.knob.names)}")


def check_buffers(names: Sequence[str]) -> None:
    """Refuse names of buffers that no pass makes.

    Raises:
        InputError: lists the known ones.
    """
    known = dict.fromkeys(step.makes for step in PASSES)
    for name in names:
        if name not in known:
            raise InputError(f"no pass makes a buffer {name!r}; known buffers: {', '.join(known)}")


def verdicts(passes: tuple[Pass, ...], outlook: Outlook, buffers: Sequence[str] = (WANTED,)) -> dict[str, Verdict]:
    """Whether each pass runs, by name: it applies, makes what nobody made before, and somebody wants it."""
    found: dict[str, Verdict] = {}
    makers: dict[str, Pass] = {}
    for step in passes:
        verdict = step.applies(outlook)
        maker = makers.get(step.makes)
        if verdict.runs and maker is not None:
            verdict = Verdict(False, f"done by {maker.name}")
        if verdict.runs:
            makers[step.makes] = step
        found[step.name] = verdict
    wanted, open_ = set(), [name for name in buffers if name in makers]
    while open_:
        step = makers[open_.pop()]
        if step.name not in wanted:
            wanted.add(step.name)
            open_ += [name for name in (*step.needs, *step.uses) if name in makers]
    for name, verdict in found.items():
        if verdict.runs and name not in wanted:
            found[name] = Verdict(False, "nobody asks for what it makes")
    return found


def in_order(passes: tuple[Pass, ...], runs: Mapping[str, Verdict]) -> list[Pass]:
    """The passes that run, each after those whose buffers it asks for."""
    left = [step for step in passes if runs[step.name].runs]
    makes = {step.makes for step in left}
    made: set[str] = set()
    ordered: list[Pass] = []
    while left:
        ready = [s for s in left if all(n in made or n not in makes for n in (*s.needs, *s.uses))]
        if not ready:
            raise OptionError(f"passes wait for each other: {', '.join(s.name for s in left)}")
        ordered.append(ready[0])
        made.add(ready[0].makes)
        left.remove(ready[0])
    return ordered


def _rows(knowledge: Knowledge, options: RenderOptions) -> tuple[PlanRow, ...]:
    runs = verdicts(knowledge.passes, knowledge.outlook(options), knowledge.wanted)
    ordered = in_order(knowledge.passes, runs)
    rest = [step for step in knowledge.passes if not runs[step.name].runs]
    load, question = make_load(knowledge, options), question_about(knowledge)
    rows = []
    for step in (*ordered, *rest):
        setting, runs_here = step.knob.current(options), runs[step.name].runs
        time, error = None, None
        if runs_here and setting != CUSTOM:
            time = predicted_ms(question, step, setting, load)
            if step.name == "reflection_reuse" and not reuses(knowledge, options):
                time = _key_frame_ms(knowledge, options, load)
            error = setting_error(question, step, setting)
            unseen = step.knob.context.changes and options.supersample >= 1
            if unseen or (step.hidden_by and _is_hidden(step, ordered, options)):
                error = 0.0
        rows.append(
            PlanRow(
                name=step.name,
                runs=runs_here,
                reason=runs[step.name].reason,
                setting=setting,
                predicted_ms=time,
                predicted_error=error,
            )
        )
    return tuple(rows)


def _is_hidden(step: Pass, running: Sequence[Pass], options: RenderOptions) -> bool:
    """The pass's setting does not show: see :attr:`Pass.hidden_by`."""
    others = [other for other in running if other.name in step.hidden_by]
    return all(other.knob.current(options) in step.hidden_by[other.name] for other in others)


def _key_frame_ms(knowledge: Knowledge, options: RenderOptions, load: Load) -> float | None:
    """A key frame of reuse is made by the pass that reuse stands in for."""
    for step in knowledge.passes:
        if step.name == "reflections":
            setting = step.knob.current(options)
            return None if setting == CUSTOM else predicted_ms(question_about(knowledge), step, setting, load)
    return None


def _choice(
    knowledge: Knowledge,
    options: RenderOptions,
    budget_ms: float | None,
    max_error: float | None,
    spent: Mapping[str, float],
) -> Choice:
    # Which passes apply must not depend on where their knobs stand now.
    open_options = replace(options, area_shadows="pcss", point_shadows="maps")
    if options.reflections != "off":
        open_options = replace(open_options, reflections="clustered")
    outlook = knowledge.outlook(open_options)
    passes = [step for step in knowledge.passes if step.applies(outlook).runs]
    settings, loads = {}, {}
    for step in passes:
        names = step.knob.names
        if step.name in spent or step.name in options.fixed:
            names = (step.knob.current(options),)
        settings[step.name] = names
    for name in settings[passes[0].name]:
        loads[name] = make_load(knowledge, passes[0].knob.setting(name).applied(options))
    question = Question(
        passes=passes,
        settings=settings,
        loads=loads,
        curves=knowledge.curves,
        scene=knowledge.name,
        pace=knowledge.pace,
        reusable=reusable(knowledge),
    )
    return choose(question, budget_ms, max_error, sum(spent.values()) - _repeated(question, spent))


def _repeated(question: Question, spent: Mapping[str, float]) -> float:
    """What the tables predict for passes that are done: their real time is counted instead."""
    first = question.settings[question.passes[0].name][0]
    return sum(
        predicted_ms(question, step, question.settings[step.name][0], question.loads[first]) or 0.0
        for step in question.passes
        if step.name in spent
    )


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
    check_wishes(budget_ms, max_error)
    options = options or RenderOptions()
    check_fixed(options)
    knowledge = Knowledge.of(scene, camera, history, curves or load_curves())
    return make_plan(knowledge, options, budget_ms, max_error)
