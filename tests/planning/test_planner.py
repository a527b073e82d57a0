"""Plans: what runs and why, in what order, within which budget; and that nothing else is paid for."""

from __future__ import annotations

import gc
import math
import re
import weakref
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch

import torchrender as tr
from torchrender.clock import ProcessorTimes, StepClock
from torchrender.errors import InputError, OptionError
from torchrender.passes.contract import Pass, always
from torchrender.passes.light.shadow_map import SHADOW_MAP
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.outlook import Outlook
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import PASSES, PICTURE, find_pass
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import Knowledge, is_seen
from torchrender.planning.curves import Curves, load_curves
from torchrender.planning.graph import resolve
from torchrender.planning.plan import Plan
from torchrender.planning.planner import _statement, make_plan
from torchrender.planning.question import Question
from torchrender.planning.search import Choice, cost_of
from torchrender.run import Run
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene


@pytest.fixture(scope="module")
def washroom() -> Scene:
    return load("washroom", size=7000)


@pytest.fixture(scope="module")
def grass() -> Scene:
    return load("grass", size=3000)


@pytest.fixture(scope="module")
def box() -> Scene:
    return load("cornell_box")


def view(scene: Scene, size: int = 40) -> Cameras:
    return scene.camera(width=size, height=size)


def running(plan: Plan) -> list[str]:
    return [row.name for row in plan.running]


# ------------------------------------------------------------------ reasons


def test_only_what_the_scene_calls_for(grass: Scene, box: Scene, washroom: Scene) -> None:
    end = ["ambient_visibility", "direct_light", "composite", "resample"]
    lit = ["gbuffer", "light_reach", "ray_caster", "shadow_map"]
    assert running(tr.plan(grass, view(grass))) == [*lit, "point_shadow", *end]
    assert running(tr.plan(box, view(box))) == [*lit, "soft_shadow", *end]
    seen = ["gbuffer", "reflective_pixel", "light_reach", "ray_caster"]
    names = [*seen, "shadow_map", "point_shadow", "soft_shadow", *end[:2], "hit_shader"]
    assert running(tr.plan(washroom, view(washroom))) == [*names, "reflections", *end[2:]]
    first = tr.plan(washroom, view(washroom), history=RenderHistory())
    assert running(first) == [*names, "reflections", "key_frame", *end[2:]]
    assert first.row("reflection_reuse").reason == "nothing to use again: this picture is a key frame"
    started = tr.render(washroom, view(washroom), history=RenderHistory()).history
    next_one = tr.plan(washroom, view(washroom), history=started)
    assert {"reflection_reuse", "ray_caster"} < set(running(next_one))
    assert next_one.row("reflections").reason == next_one.row("key_frame").reason == "done by reflection_reuse"


def test_what_lasts_says_for_whom(washroom: Scene) -> None:
    plan = tr.plan(washroom, view(washroom))
    assert plan.row("shadow_map").reason.endswith(": for point_shadow, soft_shadow, hit_shader")
    exact = RenderOptions(point_shadows="traced", area_shadows="sampled", reflections="traced")
    plan = tr.plan(washroom, view(washroom), options=exact)
    assert plan.row("shadow_map").reason.endswith(": for hit_shader")
    assert plan.row("shadow_map").predicted_error == 0.0, "the picture itself does not look maps up"
    assert plan.row("ray_caster").reason.endswith(": for point_shadow, ambient_visibility, hit_shader, reflections")
    dull = tr.plan(washroom, view(washroom), options=replace(exact, reflections="off"))
    assert dull.row("shadow_map").reason == "nobody asks for what it makes"


def test_mirrors_sort_triangles_where_their_lights_are_sampled(washroom: Scene) -> None:
    ways = ({"area_shadows": "pcss"}, {"area_shadows": "sampled"})
    plans = [tr.plan(washroom, view(washroom), options=RenderOptions(reflections="traced", **way)) for way in ways]
    assert [plan.row("occluders").runs for plan in plans] == [False, True]


def test_a_map_shows_where_one_kind_of_light_looks_it_up(washroom: Scene) -> None:
    """All must look elsewhere for its error to be hidden."""
    known = Knowledge.of(washroom, view(washroom), RenderOptions(), None, load_curves())
    for options, seen in (
        (RenderOptions(area_shadows="sampled"), True),
        (RenderOptions(point_shadows="traced"), True),
        (RenderOptions(area_shadows="sampled", point_shadows="traced"), False),
    ):
        assert is_seen(find_pass("shadow_map"), known.graph(options)) == seen


def test_reasons_name_the_cause(grass: Scene, washroom: Scene) -> None:
    plan = tr.plan(grass, view(grass))
    assert "hard shadows by shadow map instead" in plan.row("soft_shadow").reason
    assert plan.row("reflections").reason == "no material mirrors"
    off = tr.plan(washroom, view(washroom), options=RenderOptions(shadows=False, reflections="off"))
    assert off.row("shadow_map").reason == off.row("soft_shadow").reason == "shadows are turned off"
    assert off.row("reflections").reason == "reflections are turned off"
    low, high = washroom.bounds
    outside = (high + (high - low)).tolist()
    away = Cameras.look_at(outside, [2 * x for x in outside], width=16, height=16, near=0.1)
    assert tr.plan(washroom, away).row("reflections").reason == "no reflector meets the view frustum"
    alone = tr.plan(washroom, view(washroom), options=RenderOptions(area_shadows="sampled", reflections="off"))
    assert alone.row("shadow_map").reason.endswith(": for point_shadow")


def test_mirrors_in_the_frustum_that_no_pixel_shows() -> None:
    """Known only after the G-buffer: a mirror behind a wall."""
    wall = tr.Mesh(
        vertices=torch.tensor([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    hidden = tr.Mesh(vertices=wall.vertices * 0.1 - torch.tensor([0.0, 0, 1]), faces=wall.faces, material=1)
    materials = (tr.Material(), tr.Material(specular=0.9, shininess=1e4))
    assert materials[1].is_reflector
    scene = tr.Scene(meshes=(wall, hidden), materials=materials)
    camera = Cameras.look_at([0.0, 0, 4], [0.0, 0, 0], width=16, height=16, near=0.1)
    assert tr.plan(scene, camera).row("reflections").runs
    image = tr.render(scene, camera)
    assert image.plan is not None
    assert not image.plan.row("reflections").runs and "no pixel" in image.plan.row("reflections").reason
    assert "reflections" not in image.timings_ms


def test_the_plan_prints_itself(washroom: Scene) -> None:
    text = str(tr.plan(washroom, view(washroom)))
    for step in PASSES:
        assert step.name in text
    assert "no history was given" in text and "in all" in text
    record = tr.plan(washroom, view(washroom), budget_ms=200).to_dict()
    assert record["rows"][0]["pass"] == "gbuffer" and record["rows"][0]["runs"]
    assert record["budget_ms"] == 200 and record["predicted_ms"] > 0 and 0 <= record["predicted_error"] <= 1


# -------------------------------------------------------------------- order


def stand_in(name: str, makes: Buffer, needs: tuple[Buffer, ...] = (), uses: tuple[Buffer, ...] = ()) -> Pass:
    return Pass(
        name=name, summary=".", makes=makes, needs=needs, uses=uses, applies=always("."), run=lambda _: None,
        amounts=lambda _: (1.0,),
    )  # fmt: skip


def test_passes_run_after_those_they_ask(box: Scene) -> None:
    a, b, c, d, x, y = (Buffer(name, object) for name in "abcdxy")
    outlook = Outlook(scene=box, cameras=view(box), options=RenderOptions(), history=RenderHistory())
    steps = (
        stand_in("last", PICTURE, (b,), (c,)),
        stand_in("second", b, (a,)),
        stand_in("third", c, (b,)),
        stand_in("first", a),
        stand_in("unwanted", d),
        stand_in("late", a),
        stand_in("helpless", d, (x,)),
    )
    found = resolve(steps, outlook, (PICTURE,))
    assert found.verdicts["unwanted"].reason == "nobody asks for what it makes"
    assert found.verdicts["late"].reason == "done by first" and found.verdicts["helpless"].reason == "nobody makes x"
    assert [s.name for s in found.running] == ["first", "second", "third", "last"]
    assert found.asked[b] == {PICTURE, c}
    assert resolve(steps, outlook, (PICTURE, d)).verdicts["unwanted"].runs
    given = resolve(steps, outlook, (PICTURE,), (b,))
    assert [s.name for s in given.running] == ["third", "last"] and given.verdicts["second"].reason == "given"
    circle = (stand_in("x", x, (y,)), stand_in("y", y, (x,)), stand_in("end", PICTURE, (x,)))
    with pytest.raises(OptionError, match="wait for each other: x, y, end"):
        resolve(circle, outlook, (PICTURE,))


def test_buffers_are_released_after_their_last_reader(washroom: Scene) -> None:
    """What nobody asks for any more is gone before the picture is put together."""
    kept: list[weakref.ref[torch.Tensor]] = []
    alive: list[bool] = []

    def watched(frame: object) -> object:
        made = find_pass("point_shadow").run(frame)  # type: ignore[arg-type]
        kept.extend(weakref.ref(image) for image in made[0].values())
        return made

    def at_the_end(frame: object) -> object:
        gc.collect()
        alive.extend(ref() is not None for ref in kept)
        return find_pass("resample").run(frame)  # type: ignore[arg-type]

    changed = {"point_shadow": watched, "resample": at_the_end}
    steps = tuple(replace(s, run=changed.get(s.name, s.run)) for s in PASSES)
    camera = view(washroom)
    tr.render(washroom, camera, options=RenderOptions(passes=steps))
    assert alive and not any(alive)


def test_wanted_buffers_come_with_the_picture(washroom: Scene) -> None:
    image = tr.render(washroom, view(washroom), options=RenderOptions(buffers=("reflections", "direct_light")))
    layer, direct = image.buffers["reflections"], image.buffers["direct_light"]
    assert layer.color.shape == direct.shape == (1, 40, 40, 3)
    assert not torch.equal(direct, image.radiance)
    with pytest.raises(InputError, match="known buffers: gbuffer, reflective_pixel"):
        tr.render(washroom, view(washroom), options=RenderOptions(buffers=("deph",)))


def test_a_diffuse_scene_runs_the_same_with_the_other_passes_deleted(grass: Scene) -> None:
    needless = ("soft_shadow", "reflections", "reflection_reuse", "key_frame", "hit_shader", "reflective_pixel")
    few = tuple(s for s in PASSES if s.name not in needless)
    camera, pictures = view(grass), []
    for steps in (PASSES, few):
        pictures.append(tr.render(grass, camera, options=RenderOptions(passes=steps)))
        ran = set(pictures[-1].timings_ms) - {"plan", "total"}
        light = {"light_reach", "shadow_map", "point_shadow", "ambient_visibility", "direct_light"}
        assert ran == {"gbuffer", "ray_caster", *light, "composite", "resample"}
    assert torch.equal(pictures[0].radiance, pictures[1].radiance)


# ------------------------------------------------------------------ budgets


@pytest.mark.parametrize(
    "wish", [{"budget_ms": 0}, {"budget_ms": -5.0}, {"budget_ms": math.nan}, {"budget_ms": math.inf}]
)
def test_budgets_that_mean_nothing(box: Scene, wish: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="budget_ms must be"):
        tr.render(box, view(box), **wish)  # type: ignore[arg-type]


def test_error_bounds_that_mean_nothing(box: Scene) -> None:
    for wrong in (-0.1, 1.5, math.nan):
        with pytest.raises(OptionError, match="max_error must be"):
            tr.plan(box, view(box), max_error=wrong)
    with pytest.raises(OptionError, match="budget_ms must be a number"):
        tr.plan(box, view(box), budget_ms="fast")  # type: ignore[arg-type]


def test_an_impossible_budget_gives_the_cheapest_complete_picture(washroom: Scene) -> None:
    image = tr.render(washroom, view(washroom), budget_ms=1e-3)
    assert image.plan is not None and not image.plan.possible
    assert "not enough" in image.plan.statement and image.plan.statement in str(image.plan)
    assert image.plan.row("gbuffer").setting == "0.25"
    ways = find_pass("reflections").settings.all
    held = [replace(way.applied(tr.RenderOptions()), fixed=("reflections",)) for way in ways]
    others = [tr.plan(washroom, view(washroom), options=options, budget_ms=1e-3) for options in held]
    quickest = tr.plan(washroom, view(washroom), budget_ms=1e-3)
    assert all((quickest.predicted_ms or 0.0) <= (one.predicted_ms or 0.0) + 1e-6 for one in others)
    assert "gbuffer: 0.25 instead of 1, saves" in str(image.plan)
    assert image.radiance.shape == (1, 40, 40, 3) and bool(torch.isfinite(image.radiance).all())
    assert float((image.radiance.sum(-1) > 0).float().mean()) > 0.99
    assert image.gbuffer.depth.shape == (1, 40, 40)


def test_a_plan_speaks_with_one_voice(washroom: Scene) -> None:
    """Before anything is spent, table, total and statement say the same; later pictures are told apart."""
    camera = view(washroom, 256)
    plan = tr.plan(washroom, camera, budget_ms=1.0)
    assert plan.predicted_ms is not None and plan.following_ms is not None
    assert plan.predicted_ms == pytest.approx(sum(row.predicted_ms or 0.0 for row in plan.running))
    assert f"about {plan.predicted_ms:.0f} ms" in plan.statement
    made_once = {row.name for row in plan.running if row.lasts}
    assert "ray_caster" not in {row.name for row in plan.running} or "ray_caster" in made_once
    assert (
        plan.following_ms < plan.predicted_ms
        and f"follows in a sequence about {plan.following_ms:.0f} ms" in plan.statement
    )
    assert "the cheapest settings are taken (gbuffer 0.25, " in plan.statement  # by name
    lines = [line for line in str(plan).splitlines() if "in all" in line]
    assert all(f"{ms:.1f} ms" in line for ms, line in zip((plan.predicted_ms, plan.following_ms), lines, strict=True))
    assert "first picture" in lines[0] and "each that follows" in lines[1]
    told = plan.to_dict()
    assert told["following_ms"] == pytest.approx(plan.following_ms, abs=0.01) and told["changes"] == list(plan.changes)
    free = tr.plan(washroom, camera)
    for text in plan.changes:
        name, setting = text.split(":")[0], free.row(text.split(":")[0]).setting
        assert f"instead of {setting}" in text and plan.row(name).setting != setting
    assert not free.changes and len(plan.changes) >= 2
    amounts = [re.search(r"(saves|takes) (\d+) ms", text) for text in plan.changes]
    saved = [float(found[2]) * (1 if found[1] == "saves" else -1) for found in amounts if found]
    assert len(saved) == len(plan.changes) and saved == sorted(saved, reverse=True) and saved[0] > saved[-1]


def test_a_statement_tells_what_was_spent_and_what_follows_where_there_is_something_to_tell(washroom: Scene) -> None:
    known = Knowledge.of(washroom, view(washroom), RenderOptions(), None, load_curves())
    told = make_plan(known, RenderOptions(), 0.5, spent_ms=7.0)
    assert "(7 ms were spent when the rest was chosen)" in told.statement
    assert "spent" not in make_plan(known, RenderOptions(), 0.5, spent_ms=0.2).statement
    assert "for this first picture" in told.statement and "each that follows" in told.statement
    alone = replace(told, rows=tuple(replace(row, lasts=False) for row in told.rows))
    assert alone.following_ms == alone.predicted_ms and told.search is not None
    made = Choice(settings=told.search.settings, predicted_ms=9.0, predicted_error=0.1, possible=False)
    found = _statement(alone, made, 0.0)
    assert "for this picture" in found and "follows" not in found


def test_a_huge_budget_gives_the_reference(box: Scene) -> None:
    plan = tr.plan(box, view(box), budget_ms=1e8)
    assert plan.possible and not plan.statement
    for row in plan.running:
        if row.name not in ("resample", "shadow_map"):
            choices = find_pass(row.name).settings
            best = row.setting in (choices.reference.name, choices.all[-1].name)
            assert best or row.predicted_error == 0.0, row  # what is as good as the reference here may be quicker
    assert plan.predicted_error is not None and plan.predicted_error < 0.01


def test_more_budget_is_never_worse(washroom: Scene) -> None:
    errors = [
        tr.plan(washroom, view(washroom, 512), budget_ms=ms).predicted_error for ms in (100, 200, 400, 1e3, 1e4, 1e6)
    ]
    assert all(b <= a + 1e-9 for a, b in pairwise(errors)) and errors[0] > errors[-1]


def test_a_tighter_bound_is_never_quicker(washroom: Scene) -> None:
    plans = [tr.plan(washroom, view(washroom, 512), max_error=e) for e in (0.3, 0.1, 0.03, 0.01)]
    times = [plan.predicted_ms for plan in plans]
    assert all(a <= b for a, b in pairwise(times))
    assert all(p.predicted_error <= e for p, e in zip(plans, (0.3, 0.1, 0.03, 0.01), strict=True) if p.possible)


def test_a_bound_of_zero_is_the_reference_or_a_statement(washroom: Scene) -> None:
    plan = tr.plan(washroom, view(washroom), max_error=0.0)
    if not plan.possible:
        assert "no settings reach an error of 0" in plan.statement
    assert plan.row("reflections").setting == "traced" and plan.row("gbuffer").setting == "2"


def test_conflicting_wishes_are_said(washroom: Scene) -> None:
    plan = tr.plan(washroom, view(washroom, 512), budget_ms=150, max_error=0.001)
    assert not plan.possible and plan.statement
    both = tr.plan(washroom, view(washroom, 512), budget_ms=1e6, max_error=0.05)
    assert both.possible and both.predicted_error <= 0.05
    alone = tr.plan(washroom, view(washroom, 512), max_error=0.05)
    assert both.predicted_ms == pytest.approx(alone.predicted_ms)


def test_wishes_for_passes_that_are_off_stay_off(washroom: Scene) -> None:
    options = RenderOptions(reflections="off", shadows=False, ambient_visibility="off")
    plan = tr.plan(washroom, view(washroom), options=options, budget_ms=1e6)
    assert set(running(plan)) - {"picture_visibility"} == {"gbuffer", "direct_light", "composite", "resample"}


def test_what_is_left_out_of_what_was_asked_for_is_an_error(box: Scene) -> None:
    """For the search as for what is told; what a user turned off is none."""
    scene, step = replace(box, ambient=torch.ones(3)), find_pass("ambient_visibility")
    camera = scene.camera(width=400, height=400)  # about as large as what was measured
    usual = RenderOptions(reflections="traced")
    others = [s for s in PASSES if s.settings.is_choice and s.settings.current(usual) != CUSTOM and s is not step]
    options = replace(usual, fixed=tuple(s.name for s in others))
    plans = {}
    for name in ("off", "64 rays"):
        known = Knowledge.of(scene, camera, options, None, load_curves())
        asked = Question.about(known, step.settings.named(name).applied(options))
        found = make_plan(known, asked.options)
        assert not known.unseen and found.predicted_error is not None
        combination = {s.name: s.settings.current(asked.options) for s in PASSES if s.name in asked.open}
        assert cost_of(asked, combination)[1] ** (1 / known.curves.norm) == pytest.approx(found.predicted_error)
        opened = Question.about(known, options)
        assert cost_of(opened, combination)[1] ** (1 / known.curves.norm) == pytest.approx(found.predicted_error)
        plans[name] = found
    row = plans["off"].row(step.name)
    curves = load_curves()
    alone = curves.own_factor(known.name) * curves.error(step.name, "off", known.name).error
    assert not row.runs and row.predicted_error == pytest.approx(alone)
    assert plans["off"].predicted_error > max(row.predicted_error, plans["64 rays"].predicted_error)
    wished = tr.plan(scene, camera, options=replace(options, ambient_visibility="off"))
    assert wished.row(step.name).predicted_error is None
    assert wished.predicted_error < plans["64 rays"].predicted_error


@pytest.mark.parametrize(("side", "alike"), [(48, False), (300, False), (400, True), (700, True), (800, False)])
def test_errors_that_were_measured_hold_for_pictures_of_about_that_size(box: Scene, side: int, alike: bool) -> None:
    known = Knowledge.of(box, box.camera(width=side, height=side), RenderOptions(), None, load_curves())
    assert known.unseen != alike
    step = find_pass("soft_shadow")
    measured = known.curves.error(step.name, "pcss", known.name)
    assert (known._error(step, "pcss") == measured) == alike
    assert not replace(known, curves=replace(known.curves, side=side)).unseen


# ---------------------------------------------------------------- sequences


def test_a_sequence_learns_what_passes_take(grass: Scene) -> None:
    """Predictions that are wrong by a factor are right after a few pictures."""
    curves = load_curves()
    wrong = replace(curves, weights={
        name: {s: [40.0 * w for w in weights] for s, weights in settings.items()}
        for name, settings in curves.weights.items()
    })  # fmt: skip
    camera = view(grass, 64)
    history = RenderHistory()
    ratios = []
    for _ in range(5):
        known = Knowledge.of(grass, camera, RenderOptions(), history, wrong)
        clock = StepClock()
        run = Run(known, (None, None), clock)
        run.image()
        plan = run.plan.measured(clock.elapsed_ms, run.amounts, 1.0)
        row = plan.row("gbuffer")
        assert row.predicted_ms and row.measured_ms
        ratios.append(abs(math.log(row.predicted_ms / row.measured_ms)))
        history = run.history(plan)
    assert history.pace is not None and history.pace.choice["gbuffer"] == "1"
    assert min(ratios[1:]) < ratios[0]


def test_a_choice_before_the_gbuffer_drops_nothing_that_the_next_one_uses(washroom: Scene) -> None:
    """Maps drawn once serve all pictures of a sequence whose choice comes out the same."""
    history, maps = RenderHistory(), []
    for _ in range(4):
        image = tr.render(washroom, view(washroom, 64), history=history, budget_ms=1e-3)
        assert image.history is not None
        history = image.history
        maps.append(history.get(SHADOW_MAP))
    assert maps[0] is not None and all(later is maps[0] for later in maps[1:])
    assert history.get(HIT_SHADER) is not None


def test_a_scene_that_changes_while_a_sequence_runs(washroom: Scene) -> None:
    history: RenderHistory | None = RenderHistory()
    scenes = (washroom, replace(washroom, meshes=washroom.meshes[:-1]), washroom)
    for scene in scenes:
        image = tr.render(scene, view(scene), history=history, budget_ms=300)
        history = image.history
        assert bool(torch.isfinite(image.radiance).all())
        assert image.gbuffer.triangle.max() < scene.geometry.triangle_count


def test_curves_without_measurements_predict_nothing(box: Scene) -> None:
    empty = Curves({}, {}, 1.5, {}, "nothing")
    plan = tr.plan(box, view(box), curves=empty)
    assert plan.predicted_ms is None and "in all" in str(plan)


def test_a_budget_leaves_fixed_passes_alone(box: Scene) -> None:
    camera = view(box, 256)
    for upscaling in ("nearest", "joint"):
        options = RenderOptions(upscaling=upscaling, fixed=("resample",))
        made = tr.plan(box, camera, options=options, budget_ms=5.0)
        assert made.options.upscaling == upscaling
        assert made.options.supersample < 1
        assert tr.render(box, camera, options=options, budget_ms=5.0).plan.options.upscaling == upscaling


def test_what_cannot_be_fixed_is_named(box: Scene) -> None:
    camera = view(box, 8)
    for options, words in (
        (RenderOptions(fixed=("fog",)), "no pass 'fog'"),
        (RenderOptions(fixed=("gbuffer",), supersample=1.3), "gbuffer stands at none of its settings"),
    ):
        with pytest.raises(InputError, match=words):
            tr.plan(box, camera, options=options, budget_ms=5.0)
        with pytest.raises(InputError, match=words):
            tr.render(box, camera, options=options)


def test_any_pass_may_be_held_at_any_setting_in_a_sequence(washroom: Scene) -> None:
    """Where that makes invalid what the earlier picture left, the picture is made anew."""
    camera = view(washroom)
    options = RenderOptions(reflections="traced")
    history = tr.render(washroom, camera, history=RenderHistory(), options=options).history
    for step in PASSES:
        for setting in step.settings.all:
            wish = setting.applied(RenderOptions())
            if step.settings.current(wish) == setting.name:
                held = replace(wish, fixed=(step.name,))
                plan = tr.plan(washroom, camera, options=held, history=history, budget_ms=80.0)
                assert step.settings.current(plan.options) == setting.name


def test_a_plan_says_when_the_machine_was_busy(box: Scene) -> None:
    made = tr.plan(box, view(box), budget_ms=50.0)
    expected = made.predicted_ms
    assert expected is not None
    busy = made.measured({}, {}, 4.0 * expected, waited=0.6)
    assert "took 4.0 times as long as predicted: the machine is busy, 60 % of the time" in str(busy)
    assert busy.to_dict()["note"] == busy.note != ""
    assert made.measured({}, {}, 4.0 * expected, waited=0.05).note == "", "that is no reason"
    assert made.measured({}, {}, 1.1 * expected, waited=0.6).note == "", "and that no question"


def test_time_waited_for_a_processor_is_told() -> None:
    first = ProcessorTimes(2.0, 1.0)
    assert ProcessorTimes(3.0, 4.0).share(first) == pytest.approx(0.75)
    assert first.share(first) == 0.0 == StepClock().waited
    if Path("/proc/self/task").is_dir():
        before = ProcessorTimes.now()
        sum(k * k for k in range(300_000))
        after = ProcessorTimes.now()
        assert before is not None and after is not None
        assert after.ran > before.ran and 0.0 <= after.share(before) <= 1.0


def test_what_ran_before_a_look_left_it_out_is_told(washroom: Scene) -> None:
    known = Knowledge.of(washroom, view(washroom), RenderOptions(reflections="off"), None, load_curves())
    plan = make_plan(known, known.outlook.options)
    row = plan.row("reflective_pixel")
    assert not row.runs
    whole = plan.measured({"reflective_pixel": 7.0}, {}, 20.0)
    assert whole.predicted_ms == plan.predicted_ms is not None, "it foresaw no time for it"
    told = whole.row("reflective_pixel")
    assert told.runs and told.measured_ms == 7.0
    assert told.reason == f"it ran before this was known: {row.reason}"
    assert plan.measured({}, {}, 20.0).row("reflective_pixel") == row
