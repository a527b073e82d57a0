"""The choice of settings beside a slow twin that tries every combination one by one."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import pytest

from torchrender.passes.load import Load
from torchrender.passes.table import PASSES
from torchrender.pipeline.pace import LIMIT, Pace
from torchrender.planning.curves import Curves
from torchrender.planning.search import HEADROOM, Choice, Question, choose

SETTINGS = {step.name: step.knob.names[:: 2 if len(step.knob.names) > 3 else 1] for step in PASSES}
LOAD = Load(
    picture=0.25, pixels=0.25, triangles=0.1, views=6, map_size=None, point_lights=1, area_lights=1, reflective=0.1,
    caster=False, occluders=False, shader=False,
)  # fmt: skip


def random_question(seed: int, reusable: Mapping[str, str] | None = None) -> Question:
    chance = random.Random(seed)
    loads = {name: replace(LOAD, pixels=float(name) ** 2 * 0.25) for name in SETTINGS["gbuffer"]}
    weights, records = {}, {}
    for step in PASSES:
        length = len(step.work(LOAD, step.knob.settings[0]))
        weights[step.name] = {s: [chance.uniform(0, 40) for _ in range(length)] for s in step.knob.names}
        records[step.name] = {s: {"flip": chance.uniform(0, 0.2)} for s in step.knob.names}
    curves = Curves(weights, {"scene": {"passes": records}}, chance.choice((1.0, 1.5, 2.0)), {}, "chance")
    return Question(
        passes=PASSES, settings=SETTINGS, loads=loads, curves=curves, scene="scene", pace=Pace(), reusable=reusable
    )


def cost(question: Question, combination: Mapping[str, str]) -> tuple[float, float]:
    """Time and error of one combination, by the book."""
    kept = question.reusable
    reused = (
        kept is not None
        and combination["reflection_reuse"] != "off"
        and all(combination[name] == value for name, value in kept.items())
    )
    time, errors = 0.0, 0.0
    for step in PASSES:
        name, setting = step.name, combination[step.name]
        load = question.loads[combination["gbuffer"]]
        amounts = step.work(load, step.knob.setting(setting))
        runs = {"reflections": not reused, "reflection_reuse": reused}.get(name, True)
        if runs:
            time += question.curves.time_ms(name, setting, amounts, "scene") or 0.0
        error = question.curves.error(name, setting, "scene")
        if step.knob.context.changes:
            error -= min(question.curves.error(name, s, "scene") for s in step.knob.names)
        hidden = step.hidden_by and all(combination[other] in some for other, some in step.hidden_by.items())
        if not hidden:
            errors += error**question.curves.norm
    return time, errors ** (1 / question.curves.norm)


def all_costs(question: Question) -> list[tuple[float, float]]:
    return [cost(question, dict(zip(SETTINGS, names, strict=True))) for names in product(*SETTINGS.values())]


def checked(question: Question, choice: Choice, spent: float = 0.0) -> tuple[float, float]:
    time, error = cost(question, choice.settings)
    assert choice.predicted_ms == pytest.approx(time + spent) and choice.predicted_error == pytest.approx(error)
    return time, error


@pytest.mark.parametrize("seed", range(3))
def test_a_budget_gives_the_least_error_within_it(seed: int) -> None:
    kept = {"gbuffer": "0.5", "reflections": "environment"} if seed else None
    question = random_question(seed, kept)
    costs = all_costs(question)
    times = sorted(t for t, _ in costs)
    for place in (0, len(times) // 50, len(times) // 2):
        budget = times[place] / HEADROOM * (1 + 1e-9)
        found = choose(question, budget, None)
        _, error = checked(question, found)
        assert found.possible and error == pytest.approx(min(e for t, e in costs if t <= HEADROOM * budget))
    nothing = choose(question, times[0] * 0.5, None)
    assert not nothing.possible and checked(question, nothing)[0] == pytest.approx(times[0])
    middle = times[len(times) // 2]
    spent = (middle - times[0]) / 2
    late = choose(question, middle / HEADROOM, None, spent_ms=spent)
    checked(question, late, spent)
    assert late.possible and late.predicted_ms <= middle * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_bound_gives_the_least_time_within_it(seed: int) -> None:
    question = random_question(seed)
    costs = all_costs(question)
    errors = sorted(e for _, e in costs)
    for place in (0, len(errors) // 2):
        bound = errors[place] * (1 + 1e-9)
        found = choose(question, None, bound)
        time, _ = checked(question, found)
        assert found.possible and time == pytest.approx(min(t for t, e in costs if e <= bound))
    exact = choose(question, None, 0.0)
    assert not exact.possible and checked(question, exact)[1] == pytest.approx(errors[0])


def test_both_wishes() -> None:
    question = random_question(7)
    costs = all_costs(question)
    good = sorted(costs)[len(costs) // 3]
    budget, bound = good[0] / HEADROOM * (1 + 1e-9), good[1] * (1 + 1e-9)
    found = choose(question, budget, bound)
    assert found.possible
    assert checked(question, found)[0] == pytest.approx(min(t for t, e in costs if e <= bound))
    clash = choose(question, budget, min(e for _, e in costs) * 0.5)
    assert not clash.possible and checked(question, clash)[0] <= HEADROOM * budget * (1 + 1e-9)


def test_the_last_choice_stays_while_it_is_nearly_as_good() -> None:
    question = random_question(11)
    costs = {names: cost(question, dict(zip(SETTINGS, names, strict=True))) for names in product(*SETTINGS.values())}
    budget = sorted(t for t, _ in costs.values())[len(costs) // 2] / HEADROOM
    best = min(e for t, e in costs.values() if t <= HEADROOM * budget)
    near = next(n for n, (t, e) in costs.items() if t <= HEADROOM * budget and best < e < 1.09 * best)
    far = next(n for n, (t, e) in costs.items() if t <= HEADROOM * budget and e > 1.2 * best)
    for names, stays in ((near, True), (far, False)):
        last = dict(zip(SETTINGS, names, strict=True))
        found = choose(replace(question, pace=Pace(choice=last)), budget, None)
        assert (dict(found.settings) == last) == stays


def test_predictions_learn_within_limits() -> None:
    pace = Pace().learned("gbuffer", "1", 20.0, 10.0)
    assert pace.ratio("gbuffer", "1") == pace.ratio("gbuffer", "2") == 2.0 and pace.ratio("resolve", "x") == 1.0
    assert pace.learned("gbuffer", "1", 40.0, 10.0).ratio("gbuffer", "1") == pytest.approx(3.0)
    assert Pace().learned("a", "b", 1e9, 1.0).ratio("a", "b") == LIMIT
    assert Pace().learned("a", "b", 1.0, 1e9).ratio("a", "b") == 1 / LIMIT
    assert Pace().learned("a", "b", 5.0, 0.0) == Pace()


def test_what_one_picture_took_does_not_count_for_ever() -> None:
    """A setting that was slow once, because its kernel had to be loaded, gets another chance; one in use is known."""
    pace = Pace().learned("a", "b", 80.0, 10.0).learned("a", "c", 20.0, 10.0)
    for _ in range(20):
        pace = pace.aged({("a", "c")})
    assert 1.0 < pace.ratio("a", "b") < 1.2
    assert pace.ratio("a", "c") == 2.0
