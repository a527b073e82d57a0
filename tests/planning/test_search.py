"""The choice of settings beside a slow twin that tries every combination one by one, on today's table and on others."""

from __future__ import annotations

import random
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import torchrender as tr
from torchrender.passes.contract import Pass
from torchrender.passes.outlook import Outlook
from torchrender.passes.table import PASSES
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import LIMIT, Pace
from torchrender.planning.costs import Knowledge, is_seen
from torchrender.planning.problem import Row, Stage
from torchrender.planning.question import Question
from torchrender.planning.search import HEADROOM, Choice, choose, cost_of
from torchrender.report.planning.tables import made_up, options_of, random_curves
from torchrender.scene.light import PointLight, RectLight
from torchrender.scene.model import Scene


def room() -> Scene:
    """A scene in which every pass may have something to do."""
    flat = torch.tensor([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    lamp = RectLight(
        corner=torch.tensor([-0.5, 2.0, -0.5]), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0]),
        radiance=torch.ones(3),
    )  # fmt: skip
    return Scene(
        meshes=(tr.Mesh(vertices=flat, faces=faces),),
        materials=(tr.Material(specular=0.9, shininess=1e4),),
        lights=(lamp, PointLight(position=torch.tensor([0.0, 1.0, 0.0]), intensity=torch.ones(3))),
    )


SCENE = room()
CAMERA = tr.Cameras.look_at([0.0, 1.0, 2.0], [0.0, 0.0, 0.0], width=64, height=48, near=0.1)
STARTED = tr.render(SCENE, CAMERA, options=RenderOptions(reflections="traced"), history=RenderHistory()).history


def question(
    seed: int,
    *,
    passes: Sequence[Pass] = PASSES,
    history: RenderHistory | None = None,
    options: RenderOptions | None = None,
    thin: int = 2,
) -> Question:
    """Random costs; of passes with many settings every ``thin``-th is open."""
    chance = random.Random(seed)
    options = replace(options or RenderOptions(ambient_visibility="horizon"), passes=tuple(passes))
    past = (history or RenderHistory()).of_scene(SCENE)
    outlook = Outlook(scene=SCENE, cameras=CAMERA, options=options, history=past)
    known = Knowledge(outlook=outlook, curves=random_curves(passes, outlook, chance), passes=tuple(passes))
    made = Question.about(known, options)
    few = {name: rows[:: thin if len(rows) > 3 else 1] for name, rows in made.open.items()}
    made = replace(made, open=few, _memo={})
    return held(made) if passes is PASSES else made


def held(asked: Question, most: int = 700) -> Question:
    """Passes that do not apply, and then the last ones, are held: so few combinations that all are tried."""
    applies = {step.name for step in asked.knowledge.passes if step.applies(asked.knowledge.outlook).runs}
    few, count = {}, 1
    for name, rows in asked.open.items():
        stands = [row for row in rows if row.matches(asked.options)] or rows[:1]
        few[name] = rows if name in applies and count * len(rows) <= most else tuple(stands[:1])
        count *= len(few[name])
    assert count > 20
    return replace(asked, open=few, _memo={})


def twin_cost(asked: Question, combination: Mapping[str, str]) -> tuple[float, float]:
    """Time and error of one combination, by the plan that it makes."""
    known = asked.knowledge
    options = asked.options_at(combination)
    graph, outlook = known.graph(options), known.outlook.at(options)
    time_ms, errors = 0.0, 0.0
    for step in graph.running:
        name = step.settings.current(options)
        if step.name not in asked.done:
            time_ms += known.predicted_ms(step, name, step.amounts(outlook)) or 0.0
        if is_seen(step, graph):
            errors += known.setting_error(step, name, options).error ** known.curves.norm
    for step in known.passes:
        if known.leaves_out(step, options):
            errors += known.setting_error(step, step.settings.current(options), options).error ** known.curves.norm
    return time_ms, errors ** (1 / known.curves.norm)


def all_costs(asked: Question) -> dict[tuple[str, ...], tuple[float, float]]:
    names = [[s.name for s in rows] for rows in asked.open.values()]
    return {choice: twin_cost(asked, dict(zip(asked.open, choice, strict=True))) for choice in product(*names)}


def checked(asked: Question, choice: Choice, spent: float = 0.0) -> tuple[float, float]:
    time_ms, error = twin_cost(asked, choice.settings)
    assert choice.predicted_ms == pytest.approx(time_ms + spent)
    assert choice.predicted_error == pytest.approx(error, abs=1e-9)
    return time_ms, error


HISTORIES = {"first picture": None, "after another": STARTED}


@pytest.fixture(scope="module", params=HISTORIES)
def asked(request: pytest.FixtureRequest) -> tuple[Question, dict[tuple[str, ...], tuple[float, float]]]:
    made = question(3, history=HISTORIES[request.param])
    return made, all_costs(made)


def test_every_combination_costs_what_its_plan_does(asked) -> None:
    found, costs = asked
    for number, (names, (time_ms, error)) in enumerate(costs.items()):
        if number % 37 == 0:
            own = cost_of(found, dict(zip(found.open, names, strict=True)))
            assert own[0] == pytest.approx(time_ms) and own[1] ** (1 / found.knowledge.curves.norm) == pytest.approx(
                error, abs=1e-9
            )


def test_a_budget_gives_the_least_error_within_it(asked) -> None:
    found, costs = asked
    times = sorted(t for t, _ in costs.values())
    for place in (0, len(times) // 50, len(times) // 7, len(times) // 2, len(times) - 1):
        budget = times[place] / HEADROOM * (1 + 1e-9)
        made = choose(found, budget, None)
        _, error = checked(found, made)
        best = min(e for t, e in costs.values() if t <= HEADROOM * budget * (1 + 1e-9))
        assert made.possible and error == pytest.approx(best, abs=1e-9)
    nothing = choose(found, times[0] * 0.5, None)
    assert not nothing.possible and checked(found, nothing)[0] == pytest.approx(times[0])
    middle = times[len(times) // 2]
    spent = (middle - times[0]) / 2
    late = choose(found, middle / HEADROOM, None, spent_ms=spent)
    checked(found, late, spent)
    assert late.possible and late.predicted_ms <= middle * (1 + 1e-9)


def test_a_bound_gives_the_least_time_within_it(asked) -> None:
    found, costs = asked
    errors = sorted(e for _, e in costs.values())
    for place in (0, len(errors) // 5, len(errors) // 2):
        bound = errors[place] * (1 + 1e-9) + 1e-12
        made = choose(found, None, bound)
        time_ms, _ = checked(found, made)
        assert made.possible and time_ms == pytest.approx(min(t for t, e in costs.values() if e <= bound))
    if errors[0] > 0:
        exact = choose(found, None, errors[0] * 0.5)
        assert not exact.possible and checked(found, exact)[1] == pytest.approx(errors[0])


def test_both_wishes(asked) -> None:
    found, costs = asked
    good = sorted(costs.values())[len(costs) // 3]
    budget, bound = good[0] / HEADROOM * (1 + 1e-9), good[1] * (1 + 1e-9) + 1e-12
    made = choose(found, budget, bound)
    assert made.possible
    assert checked(found, made)[0] == pytest.approx(min(t for t, e in costs.values() if e <= bound))
    least = min(e for t, e in costs.values() if t <= HEADROOM * budget)
    if least > 0:
        clash = choose(found, budget, least * 0.5)
        assert not clash.possible and checked(found, clash)[0] <= HEADROOM * budget * (1 + 1e-9)
        assert clash.predicted_error == pytest.approx(least)


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0), after=st.booleans())
def test_any_costs_and_any_budget(seed: int, share: float, after: bool) -> None:
    found = question(seed, history=STARTED if after else None, thin=4)
    costs = list(all_costs(found).values())
    times = sorted(t for t, _ in costs)
    budget = times[int(share * (len(times) - 1))] / HEADROOM * (1 + 1e-9)
    best = min(e for t, e in costs if t <= HEADROOM * budget * (1 + 1e-9))
    assert checked(found, choose(found, budget, None))[1] == pytest.approx(best, abs=1e-9)
    bound = sorted(e for _, e in costs)[int(share * (len(costs) - 1))] * (1 + 1e-9) + 1e-12
    quickest = min(t for t, e in costs if e <= bound)
    assert checked(found, choose(found, None, bound))[0] == pytest.approx(quickest)


# --------------------------------------------------------------- other tables


def test_a_stage_costs_what_its_bits_say() -> None:
    """Nothing unless it runs; as if made anew where what was kept does not hold; an error only where it shows."""
    row = Row("slow", kept_ms=2.0, fresh_ms=7.0, error=0.25, sets=0, breaks=False)
    stage = Stage("pass", (row,), run=2, seen=4, fresh=8)
    costs = {bits: stage.cost(row, bits) for bits in (0, 8, 2, 2 | 8, 2 | 4, 2 | 4 | 8, 4 | 8)}
    nothing = (0.0, 0.0)
    assert costs == {
        0: nothing, 8: nothing, 2: (2.0, 0.0), 10: (7.0, 0.0), 6: (2.0, 0.25), 14: (7.0, 0.25), 12: nothing,
    }  # fmt: skip
    always = Stage("pass", (row,))
    assert always.cost(row, 0) == (2.0, 0.25)
    for one in (stage, always, Stage("pass", (row,), fresh=8)):
        costs_of_one = [one.cost(row, bits) for bits in range(16)]
        assert one.least(row) == tuple(min(column) for column in zip(*costs_of_one, strict=True))


@pytest.mark.parametrize("seed", range(4))
def test_passes_that_share_something_pay_for_it_once(seed: int) -> None:
    table = made_up(6, random.Random(seed), asking=3)
    found = question(seed, passes=table, options=options_of(table), thin=3)
    costs = all_costs(found)
    times = sorted(t for t, _ in costs.values())
    for place in range(0, len(times), max(len(times) // 9, 1)):
        budget = times[place] / HEADROOM * (1 + 1e-9)
        best = min(e for t, e in costs.values() if t <= HEADROOM * budget * (1 + 1e-9))
        assert checked(found, choose(found, budget, None))[1] == pytest.approx(best, abs=1e-9)


def test_twenty_passes_are_chosen_from_in_no_time() -> None:
    """The product of all settings has more than 10^11 combinations; a loose bound, for machines that are busy."""
    table = made_up(21, random.Random(1), asking=2)
    took = []
    for seed in range(5):
        found = question(seed, passes=table, options=options_of(table), thin=1)
        quickest = choose(found, 1e-9, None).predicted_ms
        begin = time.perf_counter()
        made = choose(found, 2.0 * quickest / HEADROOM, None)
        took.append(time.perf_counter() - begin)
        assert made.possible and made.predicted_ms <= 2.0 * quickest * (1 + 1e-9)
    assert min(took) < 0.1


# -------------------------------------------------------------- loyalty, pace


def near_and_far(seed: int) -> tuple[Question, float, tuple[str, ...] | None, tuple[str, ...] | None]:
    """A question, a budget, and allowed combinations that err a little and much more than the best."""
    found = question(seed, thin=4)
    costs = all_costs(found)
    budget = sorted(t for t, _ in costs.values())[len(costs) // 2] / HEADROOM
    allowed = {names: error for names, (time_ms, error) in costs.items() if time_ms <= HEADROOM * budget}
    best = min(allowed.values())
    near = next((n for n, e in allowed.items() if 1.001 * best < e < 1.09 * best), None)
    return found, budget, near, next((n for n, e in allowed.items() if e > 1.2 * best), None)


def test_the_last_choice_stays_while_it_is_nearly_as_good() -> None:
    tried = (near_and_far(seed) for seed in range(40))
    found, budget, near, far = next(one for one in tried if None not in one)
    for names, stays in ((near, True), (far, False)):
        assert names is not None
        last = dict(zip(found.open, names, strict=True))
        past = replace(found.knowledge.outlook.history, pace=Pace(choice=last))
        outlook = replace(found.knowledge.outlook, history=past)
        again = replace(found, knowledge=replace(found.knowledge, outlook=outlook), _memo={})
        made = choose(again, budget, None)
        ran = {step.name for step in again.knowledge.graph(again.options_at(last)).running}
        assert all((made.settings[name] == last[name]) for name in last if name in ran) == stays


def test_settings_of_passes_that_ran_stay_and_their_time_is_spent() -> None:
    found = question(5)
    late = replace(found, done=frozenset({"gbuffer"}), open={**found.open, "gbuffer": found.open["gbuffer"][:1]})
    made = choose(late, 1e9, None, spent_ms=7.0)
    assert made.settings["gbuffer"] == found.open["gbuffer"][0].name
    time_ms, _ = twin_cost(late, made.settings)
    assert made.predicted_ms == pytest.approx(time_ms + 7.0)


def test_spent_exactly_as_predicted_gives_the_same_plan() -> None:
    """Nothing that was spent is counted twice."""
    found = question(8)
    times = sorted(t for t, _ in all_costs(found).values())
    budget = times[len(times) // 3] / HEADROOM * (1 + 1e-9)
    first = choose(found, budget, None)
    gbuffer = found.knowledge.passes[0]
    count = next(s for s in found.open["gbuffer"] if s.name == first.settings["gbuffer"])
    spent = found.time_ms(gbuffer, count, count, True)
    late = replace(found, done=frozenset({"gbuffer"}), open={**found.open, "gbuffer": (count,)}, _memo={})
    second = choose(late, budget, None, spent_ms=spent)
    assert second.predicted_error == pytest.approx(first.predicted_error)
    assert second.predicted_ms == pytest.approx(first.predicted_ms)


def test_predictions_learn_within_limits() -> None:
    pace = Pace().learned("gbuffer", "1", 20.0, 10.0)
    assert pace.ratio("gbuffer", "1") == pace.ratio("gbuffer", "2") == 2.0 and pace.ratio("resample", "x") == 1.0
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


@pytest.mark.parametrize("seed", [3, 8])
def test_time_that_was_spent_is_missing_once_from_the_budget(seed: int) -> None:
    """A budget of which some is spent is a smaller one, whatever that comes to: no step of the choice hides it."""
    found = question(seed)
    times = sorted({t for t, _ in all_costs(found).values()})
    spent = times[len(times) // 2] / 3
    for limit in times[:: max(1, len(times) // 12)]:
        whole = choose(found, limit / HEADROOM * (1 + 1e-9), None)
        late = choose(found, (limit + spent) / HEADROOM * (1 + 1e-9), None, spent_ms=spent)
        assert late.settings == whole.settings and late.predicted_ms == pytest.approx(whole.predicted_ms + spent)


@pytest.mark.parametrize("change", [{"reflections": "off"}, {"transparency": "off"}, {"shadows": False}])
@pytest.mark.parametrize("wish", [{"budget_ms": 100.0}, {"max_error": 0.1}])
def test_options_may_change_in_the_middle_of_a_sequence(change: dict[str, object], wish: dict[str, float]) -> None:
    """The last picture's choice may be one that there no longer is."""
    scene = tr.load("washroom", size=20_000)
    camera = scene.camera(width=64, height=48)
    history = tr.RenderHistory()
    for options in (tr.RenderOptions(), tr.RenderOptions(), tr.RenderOptions(**change), tr.RenderOptions()):
        image = tr.render(scene, camera, options=options, history=history, **wish)
        assert image.history is not None and bool(image.radiance.isfinite().all())
        history = image.history
