"""What is open to a search: numbers of pixels near the last ones, what looks around cost, how long a choice stands."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import torchrender as tr
from torchrender.clock import StepClock
from torchrender.passes.light.shadow_map import SHADOW_MAP
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.mirrors.reflections import LOOK_MS
from torchrender.passes.mirrors.reflective_pixel import GLOSSY_SHARE, REFLECTIVE_SHARE
from torchrender.passes.mirrors.work import MOST_LIT, OF_AREA, OF_LOBE, OF_POINT, YOUNG
from torchrender.passes.senses import closely
from torchrender.passes.table import PASSES, find_pass
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import SPEED, Pace
from torchrender.planning import question
from torchrender.planning.costs import Knowledge, sense_of
from torchrender.planning.curves import load_curves
from torchrender.planning.question import Question
from torchrender.planning.search import HEADROOM, headroom
from torchrender.planning.standing import SHARE
from torchrender.run import Run
from torchrender.scene.light import RectLight
from torchrender.scene.model import Scene

GRASS = tr.load("grass", size=3000)
COUNTS = PASSES[0].settings.names


@pytest.fixture(scope="module")
def washroom() -> Scene:
    return tr.load("washroom", size=7000)


def asked_after(
    count: str, pictures: int = 2, options: RenderOptions | None = None, *, near: bool = True
) -> tuple[str, ...]:
    """Numbers of pixels that are open after pictures of which the last one had ``count``."""
    options = options or RenderOptions()
    history = replace(RenderHistory(), pictures=pictures, pace=Pace(choice={"gbuffer": count})).of_scene(GRASS)
    camera = GRASS.camera(width=64, height=48)
    known = Knowledge.of(GRASS, camera, options, history, load_curves())
    return tuple(setting.name for setting in Question.about(known, options, near=near).counts)


def test_numbers_of_pixels_beside_the_last_one_are_open() -> None:
    place = COUNTS.index("0.5")
    assert asked_after("0.5") == COUNTS[place - 1 : place + 2]
    assert asked_after(COUNTS[0]) == COUNTS[:2]
    assert asked_after(COUNTS[-1]) == COUNTS[-2:]


def test_all_numbers_of_pixels_are_open_before_two_pictures_and_without_a_budget() -> None:
    assert asked_after("0.5", pictures=1) == asked_after("0.5", near=False) == asked_after("3") == COUNTS
    held = RenderOptions(supersample=1, fixed=("gbuffer",))
    assert asked_after("1", options=held) == ("1",)


# ------------------------------------------------------------- looks around


def test_a_first_look_around_is_priced_once(monkeypatch: pytest.MonkeyPatch, washroom: Scene) -> None:
    """Where nothing looked around yet, of rays for a few pictures; where what shades hits is made anew, again."""
    camera, step = washroom.camera(width=40, height=40), find_pass("reflections")
    traced = replace(RenderOptions(reuse=None), reflections="traced")
    plain = replace(traced, reflections="environment")
    history = tr.render(washroom, camera, options=traced, history=RenderHistory()).history
    assert history is not None and history.get(HIT_SHADER) is not None

    def looks(options: RenderOptions, past: RenderHistory | None, looked: bool = False) -> float:
        monkeypatch.setattr(HitShader, "looked_around", property(lambda _: looked))
        known = Knowledge.of(washroom, camera, options, past, load_curves())
        return step.amounts(known.outlook.at(options))[-1]

    old, young = replace(history, pictures=YOUNG), replace(history, pictures=YOUNG - 1)
    lit = light_of(washroom)
    assert looks(plain, None) == looks(traced, None) == lit > 1.0
    assert looks(plain, old) == lit and looks(plain, old, looked=True) == 0.0
    assert looks(traced, young) == lit and looks(traced, young, looked=True) == looks(traced, old) == 0.0
    assert looks(replace(traced, reflections="clustered"), None) == lit

    monkeypatch.setattr(HitShader, "looked_around", property(lambda _: True))
    known = Knowledge.of(washroom, camera, plain, history, load_curves())
    setting, count = step.settings.named("environment"), PASSES[0].settings.named("1")
    fresh, kept = (Question.about(known, plain).time_ms(step, setting, count, anew) for anew in (True, False))
    price = lit * known.curves.weights["reflections"]["environment"][-1]
    assert price > 10.0 and fresh == pytest.approx(kept + known.pace.speed * price)


def light_of(scene: Scene) -> float:
    areas = sum(isinstance(light, RectLight) for light in scene.lights)
    return min(1.0 + OF_POINT * (len(scene.lights) - areas) + OF_AREA * areas, MOST_LIT)


@pytest.mark.parametrize("way", ["environment", "traced"])
def test_what_is_done_once_takes_as_much_longer_as_all_passes(washroom: Scene, way: str) -> None:
    """A machine half as fast takes twice as long to look around, too; and the look is a price worth telling."""
    camera, step = washroom.camera(width=40, height=40), find_pass("reflections")
    options = replace(RenderOptions(reuse=None), reflections=way, supersample=1)
    pace = Pace(known={SPEED: math.log(2.0)}, ratios={("reflections", way): 1.0})
    known = Knowledge.of(washroom, camera, options, replace(RenderHistory(), pace=pace), load_curves())
    amounts = step.amounts(known.outlook)
    all_of_it, each = (known.predicted_ms(step, way, work) or 0.0 for work in (amounts, step.again(amounts)))
    once = amounts[-1] * known.curves.weights["reflections"][way][-1]
    own = known.curves.scenes.get(known.name, {}).get("ratios", {}).get("reflections", {}).get(way, 1.0)
    assert once > 30.0 and all_of_it - each == pytest.approx(2.0 * own * once)


@pytest.mark.parametrize("looked", [False, True])
def test_times_with_a_look_around_teach_nothing_those_without_do(
    monkeypatch: pytest.MonkeyPatch, washroom: Scene, looked: bool
) -> None:
    """Of rays a first look is expected, and seldom comes: then the first picture tells what they take."""
    camera = washroom.camera(width=40, height=40)
    traced = replace(RenderOptions(reuse=None), reflections="traced", supersample=1)
    monkeypatch.setattr(HitShader, "looked_around", property(lambda _: looked))
    tr.render(washroom, camera, options=traced, history=RenderHistory())  # kernels are there
    history = tr.render(washroom, camera, options=traced, history=RenderHistory()).history
    assert history is not None and history.pace is not None
    assert (("reflections", "traced") in history.pace.ratios) != looked


def test_sensing_looks_around_only_where_a_budget_affords_it(washroom: Scene) -> None:
    camera = washroom.camera(width=40, height=40)
    known = Knowledge.of(washroom, camera, RenderOptions(), None, load_curves())

    def spare(budget: float | None, foreseen: float, late: float | None = None) -> float:
        pace = Pace() if late is None else Pace(misses=(late, late))
        past = replace(known.outlook.history, pace=pace)
        run = Run(replace(known, outlook=replace(known.outlook, history=past)), (budget, None), StepClock())
        run.foreseen_ms = foreseen
        return run._spare_ms

    assert spare(None, 50.0) == math.inf
    assert spare(200.0, 50.0) == pytest.approx(HEADROOM * 200.0 - 50.0)
    assert spare(200.0, 169.0) == spare(200.0, 1e6) == pytest.approx(SHARE * 200.0), "a small share in any case"
    late = headroom(Pace(misses=(0.3, 0.3)))
    assert spare(200.0, 50.0, late=0.3) == pytest.approx(late * 200.0 - 50.0) and late < HEADROOM

    seen = {}
    for budget in (0.5 * LOOK_MS, 1e7):
        options = replace(RenderOptions(reuse=None), reflections="traced", fixed=("reflections",))
        image = tr.render(washroom, camera, options=options, history=RenderHistory(), budget_ms=budget)
        assert image.history is not None and image.history.pace is not None
        seen[budget] = sense_of(closely("reflections")) in image.history.pace.known
    assert seen == {0.5 * LOOK_MS: False, 1e7: True}


def test_what_settings_show_in_is_found_without_options_made_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Options check all their values: hundreds of them made the second picture of a process late."""

    def refused() -> RenderOptions:
        raise AssertionError("options made anew")

    monkeypatch.setattr(question, "RenderOptions", refused)
    shown = {step.name for step in PASSES if question._shows_in.__wrapped__(SHADOW_MAP, step)}
    assert "shadow_map" in shown and "resample" not in shown


def test_a_picture_without_time_left_senses_nothing(washroom: Scene) -> None:
    """One that stands by a choice; a new one needs to know what errors follow, and bounds take their time."""
    camera = washroom.camera(width=40, height=40)
    known = Knowledge.of(washroom, camera, RenderOptions(), RenderHistory(), load_curves())

    def looks(took_ms: float, stood: int, limits: tuple[float | None, float | None] = (60.0, None)) -> bool:
        run = Run(known, limits, StepClock())
        run._choose(known.outlook.options)
        run.searches = [replace(search, pictures=stood) for search in run.searches]
        run.done = [row.name for row in run.plan.running]
        run.clock.elapsed_ms = {"gbuffer": took_ms}
        return run._looks

    assert looks(50.0, 3) and not looks(67.0, 3) and not looks(50.0, 2)
    assert looks(67.0, 0) and looks(67.0, 3, (None, 0.1)) and not looks(50.0, 3, (None, None))


def test_glossy_pixels_look_at_surroundings_several_times(washroom: Scene) -> None:
    """And cast several rays. Nothing but mirrors is expected before a picture tells."""
    camera, step = washroom.camera(width=40, height=40), find_pass("reflections")
    options = replace(RenderOptions(reuse=None), reflections="environment", supersample=1)
    outlook = Knowledge.of(washroom, camera, options, None, load_curves()).outlook
    told = replace(outlook, known={REFLECTIVE_SHARE: 0.4, GLOSSY_SHARE: 0.1})
    assert step.amounts(outlook)[1] == pytest.approx(0.3 * 1600e-6)
    assert step.amounts(told)[1] == pytest.approx((0.4 + 0.1 * (OF_LOBE - 1.0)) * 1600e-6)
    traced = told.at(replace(options, reflections="traced"))
    rays = 0.4 + 0.1 * (traced.options.tracing.glossy_rays - 1.0)
    assert step.amounts(traced)[:2] == pytest.approx((2.0, light_of(washroom) * rays * 1600e-6))
    assert step.amounts(outlook.at(traced.options))[0] == 1.0
    history = tr.render(washroom, camera, options=options, history=RenderHistory()).history
    assert history is not None and history.pace is not None
    assert 0.0 <= history.pace.known[GLOSSY_SHARE] <= history.pace.known[REFLECTIVE_SHARE]


def test_what_is_done_once_counts_in_part_where_pictures_share_it(washroom: Scene) -> None:
    """A first picture looks around for those that follow; what lasts counts in full all the same."""
    camera, step = washroom.camera(width=40, height=40), find_pass("reflections")
    options = replace(RenderOptions(reuse=None), reflections="environment")
    known = Knowledge.of(washroom, camera, options, RenderHistory(), load_curves())
    setting, count = step.settings.named("environment"), PASSES[0].settings.named("1")
    maps = find_pass("shadow_map")
    whole, shared = (Question.about(known, options, share_once=share) for share in (1.0, 0.125))
    each = Question.about(known, options, share_once=1e-9).time_ms(step, setting, count, True)
    once = whole.time_ms(step, setting, count, True) - each
    assert once > 10.0 and shared.time_ms(step, setting, count, True) == pytest.approx(each + 0.125 * once)
    texels = maps.settings.all[0]
    assert whole.time_ms(maps, texels, count, True) == shared.time_ms(maps, texels, count, True) > 0.0


def test_rays_shared_out_over_blocks_err_more_with_fewer_pixels() -> None:
    """Also in a scene that was measured, at one rendered pixel per pixel; nothing else does there."""
    box = tr.load("cornell_box")
    knowledge = Knowledge.of(box, box.camera(width=512, height=512), RenderOptions(), None, load_curves())
    assert not knowledge.unseen
    for step in PASSES:
        if step.settings.is_choice and step is not PASSES[0]:
            for name in step.settings.names:
                fine, coarse = (
                    knowledge.setting_error(step, name, RenderOptions(supersample=s)).error for s in (1.0, 0.25)
                )
                if fine > 0.0 and coarse > 0.0:
                    assert coarse == pytest.approx(fine * (2.0 if name in step.patterns else 1.0)), name
    shared = find_pass("ambient_visibility")
    assert set(shared.patterns) < set(shared.settings.names)
    found = Question.about(knowledge, RenderOptions())
    name = shared.settings.named(shared.patterns[0])
    errors = {count.name: found.error(shared, name, count) for count in found.counts}
    assert errors["0.25"] > errors["0.5"] > errors["1"] == errors["2"]
