"""Bounds kept by what is surest among the quick, what first pictures make for later ones, and what changes save."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest

import torchrender as tr
from torchrender.clock import StepClock
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import SPEED, Pace
from torchrender.planning.choices import MOST, paid_once
from torchrender.planning.costs import Knowledge
from torchrender.planning.curves import Curves, load_curves
from torchrender.planning.plan import Plan
from torchrender.planning.question import Question
from torchrender.planning.search import choose
from torchrender.report.unseen.study import walk_of
from torchrender.run import OFF, Run
from torchrender.scene.camera import Cameras
from torchrender.scene.procedural.anything import anything

GRASS = tr.load("grass", size=3000)
VIEW = GRASS.camera(width=256, height=256)
OPTIONS = RenderOptions(reuse=None)


def priced(**fixed_ms: float) -> Curves:
    """Curves with other prices of passes, whatever their work."""
    curves = load_curves()
    weights = dict(curves.weights)
    for name, ms in fixed_ms.items():
        weights[name] = {s: [ms, *(0.0 for _ in row[1:])] for s, row in weights[name].items()}
    return replace(curves, weights=weights)


# -------------------------------------------------------------------- bounds


def test_settings_that_nobody_measured_cost_no_other_its_place() -> None:
    """A quick setting of hardly known error once made bounds so tight that the most exact settings were taken."""
    box = tr.load("cornell_box")
    camera = box.camera(width=512, height=512)
    curves = load_curves()
    key = "cornell_box/96"
    passes = curves.scenes[key]["passes"]
    ambient = {name: one for name, one in passes["ambient_visibility"].items() if "rays, " not in name}
    lines = {name: rows for name, rows in curves.lines.items() if not name.startswith("ambient")}
    scenes = {key: {**curves.scenes[key], "passes": {**passes, "ambient_visibility": ambient}}}
    less = replace(curves, scenes=scenes, lines=lines)
    for bound in (0.06, 0.04):
        plan = tr.plan(box, camera, options=OPTIONS, max_error=bound, curves=less)
        exact = tr.plan(box, camera, options=OPTIONS, max_error=0.0, curves=less)
        assert plan.possible and plan.error_interval is not None
        assert (plan.predicted_ms or 0.0) < 0.2 * (exact.predicted_ms or 0.0)


def test_a_quicker_choice_is_not_surer_than_it_has_to_be() -> None:
    """What fills a bound is taken: tighter bounds take longer, and no choice within one is far below it."""
    box = tr.load("cornell_box")
    camera = box.camera(width=512, height=512)
    times = []
    for bound in (0.1, 0.05, 0.03):
        plan = tr.plan(box, camera, options=OPTIONS, max_error=bound)
        assert plan.possible and (plan.predicted_error or 1.0) <= bound
        times.append(plan.predicted_ms or 0.0)
    assert times[0] < times[1] < times[2]


# --------------------------------------------------- for the pictures to come


HELD = replace(OPTIONS, fixed=("point_shadow",))  # by maps: rays are for ambient light alone


def first_plan(budget: float, curves: Curves, history: RenderHistory | None) -> Plan:
    return tr.plan(GRASS, VIEW, options=HELD, history=history, budget_ms=budget, curves=curves)


def test_a_first_picture_over_its_budget_makes_what_later_ones_look_up() -> None:
    curves = priced(shadow_map=80.0, ray_caster=30.0)
    plan = first_plan(150.0, curves, RenderHistory())
    assert not plan.possible and RAY_CASTER in plan.ahead
    assert plan.row("ray_caster").runs and plan.row("ray_caster").predicted_ms == pytest.approx(30.0)
    assert not plan.row("ambient_visibility").runs, "all else is as quick as can be"
    alone = first_plan(150.0, curves, None)
    assert not alone.possible and not alone.ahead and not alone.row("ray_caster").runs
    dear = first_plan(150.0, priced(shadow_map=80.0, ray_caster=240.0), RenderHistory())
    assert not dear.possible and not dear.row("ray_caster").runs, "no more than the budget is spent on others"
    hopeless = first_plan(1.0, curves, RenderHistory())
    assert not hopeless.possible and not hopeless.ahead, "no later picture keeps that either"


def test_what_is_made_ahead_is_there_for_the_next_picture() -> None:
    curves = priced(shadow_map=80.0, ray_caster=30.0)
    known = Knowledge.of(GRASS, VIEW, HELD, RenderHistory(), curves)
    clock = StepClock()
    run = Run(known, (150.0, None), clock)
    image = run.image()
    assert run.plan.row("ambient_visibility").setting == "off"
    assert "ray_caster" in run.done and "ray_caster" not in image.buffers
    history = run.history(run.plan.measured(clock.elapsed_ms, run.amounts, 1.0))
    assert history.get(RAY_CASTER) is not None


def test_a_second_picture_makes_it_where_its_budget_allows() -> None:
    """Dearer than all that a budget leaves beside it, it is not made."""
    past = replace(RenderHistory(), pictures=1, pace=Pace()).of_scene(GRASS)
    past = replace(past, pace=Pace())
    quickest = first_plan(1e-3, priced(ray_caster=1.0), None).predicted_ms or 0.0
    budget = 4.0 * quickest
    kept = first_plan(budget, priced(ray_caster=1.5 * quickest), past)
    assert kept.possible and (kept.predicted_ms or 0.0) <= budget
    assert kept.row("ray_caster").runs or not kept.ahead
    dear = first_plan(budget, priced(ray_caster=4.0 * quickest), past)
    assert dear.possible and not dear.ahead and not dear.row("ray_caster").runs


# -------------------------------------------------------------------- pace


def test_passes_that_no_picture_ran_are_as_slow_as_the_others() -> None:
    pace = Pace()
    assert pace.ratio("ambient_visibility", "1 x 12") == 1.0
    slow = Pace(known=pace.hurried(30.0, 10.0))
    assert slow.ratio("ambient_visibility", "1 x 12") == pytest.approx(3.0)
    faded = slow.learned("gbuffer", "1", 10.0, 10.0)
    for _ in range(40):
        faded = faded.aged(set())
    assert faded.ratio("gbuffer", "1") == pytest.approx(3.0, rel=0.05), "what is not seen again goes back to that"
    assert slow.hurried(0.0, 10.0) == slow.hurried(5.0, 0.0) == {}
    halfway = slow.hurried(25.0, 10.0)[SPEED]
    assert math.exp(halfway) == pytest.approx(math.sqrt(3.0 * 2.5))


def test_a_picture_tells_how_fast_the_machine_is() -> None:
    slow = replace(load_curves(), weights={
        name: {s: [1e-3 * w for w in row] for s, row in rows.items()} for name, rows in load_curves().weights.items()
    })  # fmt: skip
    history = RenderHistory()
    for _ in range(2):
        known = Knowledge.of(GRASS, VIEW, OPTIONS, history, slow)
        run = Run(known, (None, None), clock := StepClock())
        run.image()
        history = run.history(run.plan.measured(clock.elapsed_ms, run.amounts, 1.0))
    fast = Knowledge.of(GRASS, VIEW, OPTIONS, history, load_curves())
    assert history.pace is not None and fast.pace.known.get(SPEED, 0.0) <= math.log(8.0) + 1e-9


def test_maps_that_fit_a_still_eye_cost_nothing_again() -> None:
    history = tr.render(GRASS, VIEW, options=OPTIONS, history=RenderHistory()).history
    assert history is not None
    step = next(one for one in tr.plan(GRASS, VIEW).rows if one.name == "shadow_map")
    assert step.predicted_ms is not None and step.predicted_ms > 0.0

    def price(camera: Cameras, options: RenderOptions = OPTIONS, past: RenderHistory | None = history) -> float:
        return tr.plan(GRASS, camera, options=options, history=past).row("shadow_map").predicted_ms or 0.0

    assert price(VIEW) == price(VIEW, replace(OPTIONS, supersample=0.5)) == 0.0
    assert price(VIEW, past=RenderHistory()) > 0.0
    assert price(VIEW, replace(OPTIONS, shadow=replace(OPTIONS.shadow, size=512))) > 0.0
    moved = GRASS.camera(width=256, height=256)
    matrix = moved.camera_from_world.clone()
    matrix[:, 0, 3] += 0.01 * GRASS.diagonal
    k = moved.intrinsics.clone()
    k[:, 0, 0] *= 1.2
    assert price(replace(moved, camera_from_world=matrix)) > 0.0
    assert price(replace(moved, intrinsics=k)) > 0.0


# ----------------------------------------------------------------- in words


def test_fewer_pixels_save_what_all_passes_take_less() -> None:
    free = tr.plan(GRASS, VIEW, options=OPTIONS)
    plan = tr.plan(GRASS, VIEW, options=OPTIONS, budget_ms=0.3 * (free.predicted_ms or 0.0))
    told = {text.split(":")[0]: re.search(r"(saves|takes) (\d+) ms", text) for text in plan.changes}
    saved = {name: float(one[2]) * (1 if one[1] == "saves" else -1) for name, one in told.items() if one is not None}
    own = (free.row("gbuffer").predicted_ms or 0.0) - (plan.row("gbuffer").predicted_ms or 0.0)
    assert saved["gbuffer"] > own + 1.0
    new = sum(row.predicted_ms or 0.0 for row in plan.running if not free.row(row.name).runs)
    old = sum(row.predicted_ms or 0.0 for row in free.running if not plan.row(row.name).runs)
    whole = (free.predicted_ms or 0.0) - (plan.predicted_ms or 0.0)
    assert sum(saved.values()) == pytest.approx(whole, abs=new + old + len(saved))


@pytest.mark.parametrize(("late_ms", "again"), [(0.0, False), (1.0, False), (30.0, True), (-30.0, True)])
def test_a_picture_on_time_is_not_planned_anew(late_ms: float, again: bool) -> None:
    run = Run(Knowledge.of(GRASS, VIEW, OPTIONS, None, load_curves()), (100.0, None), StepClock())
    run._choose(OPTIONS)
    foreseen = 40.0
    rows = [replace(row, predicted_ms=foreseen) if row.name == "gbuffer" else row for row in run.plan.rows]
    run.plan, run.done = replace(run.plan, rows=tuple(rows)), ["gbuffer"]
    run.clock.elapsed_ms["gbuffer"] = foreseen + late_ms
    assert run._off_time == again == (abs(late_ms) > OFF * 100.0)
    run.limits = (None, 0.1)
    assert not run._off_time


def test_a_first_picture_that_is_late_makes_no_finer_maps_of_what_the_eye_leaves_behind() -> None:
    """Triangles for rays serve all that follow; maps fitted to what is seen are drawn anew where the eye goes."""
    scene = anything(10_033)
    walk = walk_of(scene, 240, 2)
    plan = tr.plan(scene, walk[0], history=tr.RenderHistory(), budget_ms=200.0)
    assert not plan.possible and plan.row("shadow_map").setting == "256"


def _standing(wary: int = 0) -> Question:
    """Of a sequence whose pictures kept no shadow map so far."""
    history = replace(RenderHistory(), pictures=3, pace=Pace(wary=wary, misses=(0.0, 0.0)), seen_from=VIEW)
    curves = priced(shadow_map=20.0, point_shadow=0.1, direct_light=1.0, ambient_visibility=1e4)
    options = replace(OPTIONS, fixed=("point_shadow",))
    return Question.about(Knowledge.of(GRASS, VIEW, options, history, curves), options)


def test_what_lasts_is_paid_by_one_standing_picture() -> None:
    """Where the drawing of shadow maps fits no budget, and their pictures do."""
    question = _standing()
    budget, quick = 30.0, choose(question, 30.0, None)
    assert quick.predicted_ms >= 40.0 and not quick.possible
    found = paid_once(question, quick, budget, 0.0)
    assert found is not None and not found.choice.possible
    assert budget < found.choice.predicted_ms <= (1.0 + MOST) * budget
    following = sum(row.predicted_ms or 0.0 for row in found.rows if row.runs and not row.lasts)
    assert following <= budget
    poor = replace(quick, possible=True)
    assert paid_once(question, poor, budget, 0.0) is not None, "it is better than what keeps the budget"
    assert paid_once(_standing(wary=3), poor, budget, 0.0) is None, "one was late a short while ago"
    assert paid_once(_standing(wary=3), quick, budget, 0.0) is not None, "they all are"
    less = 9.0  # not enough for anything: the quickest in the end
    late = paid_once(question, choose(question, less, None), less, 0.0)
    assert late is None or late.choice.predicted_ms <= (1.0 + MOST) * less
    assert paid_once(question, quick, 40.0 / (1.0 + MOST) / 1.1, 0.0) is None, "so late that nobody waits for it"
    assert paid_once(question, replace(found.choice, possible=True), budget, 0.0) is None, "no better"
