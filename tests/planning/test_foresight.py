"""Errors of scenes nobody measured: lines, spreads, sums, and choices that stay on the safe side."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import torchrender as tr
from torchrender.passes.senses import closely
from torchrender.passes.table import find_pass
from torchrender.planning.costs import Knowledge, sense_of
from torchrender.planning.curves import load_curves
from torchrender.planning.foresight import (
    COVERED,
    LEAST,
    LEAST_TAIL,
    Expected,
    Joint,
    Line,
    Whole,
    fitted,
    joint_of_pictures,
    parse_lines,
    together,
)
from torchrender.planning.rows import FIRST_GUARD, GUARD, UNSEEN_GUARD, most_of
from torchrender.scene.procedural.anything import anything


def samples(count: int, slope: float, left: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    sensed = np.exp(rng.uniform(-5.0, -2.0, count))
    return 0.4 * sensed**slope * np.exp(rng.normal(0.0, left, count)), sensed


def test_a_fit_finds_the_line_and_how_far_pairs_lie_from_it() -> None:
    errors, sensed = samples(400, 0.8, 0.3)
    line = fitted(errors.tolist(), sensed.tolist())
    assert line.slope == pytest.approx(0.8, abs=0.05) and line.left == pytest.approx(0.3, abs=0.03)
    assert line.expected(0.05).error == pytest.approx(0.4 * 0.05**0.8, rel=0.05)
    assert line.expected(None).error == pytest.approx(errors.mean(), rel=1e-6)
    assert line.expected(None).spread > 2 * line.expected(0.05).spread


def test_nine_of_ten_new_pairs_lie_in_the_interval_even_after_few() -> None:
    inside = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        sensed = np.exp(rng.uniform(-5.0, -2.0, 13))
        errors = 0.5 * sensed * np.exp(rng.normal(0.0, 0.4, 13))
        low, high = fitted(errors[:-1].tolist(), sensed[:-1].tolist()).expected(float(sensed[-1])).interval
        inside.append(low <= errors[-1] <= high)
    assert 0.84 <= np.mean(inside) <= 0.97


def test_more_to_be_seen_never_means_less_error() -> None:
    errors, sensed = samples(50, -0.7, 0.1)
    line = fitted(errors.tolist(), sensed.tolist())
    assert line.slope == 0.0 and line.expected(0.01) == line.expected(0.1)


@pytest.mark.parametrize("sensed", [0.0, 1e-30, 1.0, 1e30])
def test_whatever_is_sensed_errors_stay_numbers(sensed: float) -> None:
    errors, seen = samples(30, 1.5, 0.2)
    found = fitted(errors.tolist(), seen.tolist()).expected(sensed)
    assert 0.0 < found.error <= 1.0 and math.isfinite(found.spread) and found.interval[1] <= 1.0


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_pairs_are_not_trusted(count: int) -> None:
    assert fitted([0.1] * count, [0.1] * count).expected(0.1) == Expected(pytest.approx(0.1), 1.0)


def test_pairs_that_are_all_alike_have_no_slope() -> None:
    line = fitted([0.1, 0.2, 0.1, 0.2, 0.15], [1.0] * 5)
    assert line.slope == 0.0 and line.left == pytest.approx(line.spread, rel=0.3)
    assert fitted([0.0] * 6, [0.0] * 6).expected(None).error == pytest.approx(LEAST)


def test_errors_add_up_by_the_norm_and_spreads_by_their_shares() -> None:
    both = together([Expected(0.3, 0.4), Expected(0.4, 0.2)], 2.0, 0.0)
    assert both.error == pytest.approx(0.5)
    assert both.spread == pytest.approx(math.hypot(0.36 * 0.4, 0.64 * 0.2))
    assert together([], 2.0, 0.1) == Expected(0.0, 0.1)
    assert together([Expected(0.1, 0.3), Expected(0.0, 9.0)], 1.5, 0.4).spread == pytest.approx(0.5)


def test_whole_pictures_tell_the_factor_and_both_tails() -> None:
    generator = np.random.default_rng(4)
    z = generator.exponential(1.0, 4000)  # a long tail up, none down
    told = [Expected(0.01, spread) for spread in generator.uniform(0.2, 0.6, len(z))]
    pictures = [
        Whole(one.error * 1.3 * math.exp(one.spread * (v - math.log(2.0))), one) for v, one in zip(z, told, strict=True)
    ]
    joint = joint_of_pictures(pictures)
    assert joint.factor == pytest.approx(1.3, rel=0.05)
    assert joint.above == pytest.approx(-math.log(0.05) - math.log(2.0), rel=0.1)
    assert joint.below == pytest.approx(max(math.log(2.0) + math.log(0.95), LEAST_TAIL), rel=0.1)
    assert joint_of_pictures([]) == Joint() and joint_of_pictures(pictures[:9]).above == COVERED
    alike = joint_of_pictures([Whole(0.02, Expected(0.01, 0.3))] * 50)
    assert alike.factor == pytest.approx(2.0) and alike.above == alike.below == LEAST_TAIL


def test_tails_hold_nine_of_ten_pictures_to_come() -> None:
    """Not of those that they were found by: of few, quantiles as they are hold too little."""
    generator = np.random.default_rng(7)
    held = []
    for _ in range(400):
        offs = generator.normal(0.0, 0.5, 31)
        joint = joint_of_pictures([Whole(0.02 * math.exp(off), Expected(0.02, 0.3)) for off in offs[:-1]])
        low, high = (0.02 * joint.factor * math.exp(tail * 0.3) for tail in (-joint.below, joint.above))
        held.append(low <= 0.02 * math.exp(offs[-1]) <= high)
    assert 0.88 <= float(np.mean(held)) <= 0.97


def test_fewer_rendered_pixels_err_by_more_than_their_passes() -> None:
    """By a power of how many there are; pictures with others in between follow it."""
    generator = np.random.default_rng(3)
    sizes = generator.choice([0.25, 0.35, 0.5, 0.7], 400)
    pictures = [
        Whole(0.02 * 1.2 * n**-0.3 * math.exp(generator.normal(0.0, 0.1)), Expected(0.02, 0.1), n) for n in sizes
    ]
    joint = joint_of_pictures(pictures)
    assert joint.slope == pytest.approx(0.3, abs=0.03) and joint.factor == pytest.approx(1.2, rel=0.05)
    assert joint.at(0.5).factor == pytest.approx(1.2 * 2**0.3, rel=0.05) and joint.at(0.5).above == joint.above
    assert joint.above == pytest.approx(1.645, rel=0.2), "the sizes are no part of it"
    assert joint_of_pictures([one._replace(supersample=1.0) for one in pictures]).slope == 0.0
    assert joint_of_pictures([one._replace(error=0.02 * one.supersample) for one in pictures]).slope == 0.0


def test_tails_of_few_scenes_hold_nine_of_ten_pictures_of_others() -> None:
    """Pictures of one scene lie off alike: as many of different scenes say more."""
    generator = np.random.default_rng(11)
    held: dict[bool, list[bool]] = {False: [], True: []}
    for _ in range(60):
        offs = generator.normal(0.0, 0.5, 21)
        pictures = [
            Whole(0.02 * math.exp(off + generator.normal(0.0, 0.1)), Expected(0.02, 0.3), 1.0, scene)
            for scene, off in enumerate(offs)
            for _ in range(5)
        ]
        for told in (False, True):
            known = [one if told else one._replace(scene=None) for one in pictures[:-5]]
            joint = joint_of_pictures(known)
            low, high = (0.02 * joint.factor * math.exp(tail * 0.3) for tail in (-joint.below, joint.above))
            held[told] += [low <= one.error <= high for one in pictures[-5:]]
    assert np.mean(held[True]) >= 0.9 > np.mean(held[False]) - 0.05
    assert np.mean(held[True]) > np.mean(held[False])


def test_lines_go_through_json() -> None:
    line = Line(-2.0, 0.5, -3.0, -2.1, 0.9, 0.2)
    assert parse_lines({"gbuffer": {"1": line.to_list()}}) == {"gbuffer": {"1": line}}


@pytest.mark.parametrize("values", [[0.0, -1.0, 0, 0, 0, 0], [0, 0, 0, 0, -1.0, 0], [float("nan"), 0, 0, 0, 0, 0]])
def test_lines_of_nonsense_are_refused(values: list[float]) -> None:
    with pytest.raises(ValueError, match="gbuffer, 1"):
        parse_lines({"gbuffer": {"1": values}})


def test_a_picture_teaches_the_next_one_of_a_scene_nobody_measured() -> None:
    scene = anything(3)
    camera = scene.camera(width=64, height=48)
    first = tr.plan(scene, camera, max_error=0.2)
    image = tr.render(scene, camera, history=tr.RenderHistory(), budget_ms=1e6)
    assert image.history is not None
    second = tr.plan(scene, camera, history=image.history, max_error=0.2)
    assert first.error_interval is not None and second.error_interval is not None
    width = [high / low for low, high in (first.error_interval, second.error_interval)]
    assert width[1] < 0.8 * width[0], "what passes sensed makes predictions surer"


def test_a_bound_is_kept_on_the_safe_side() -> None:
    scene = anything(3)
    camera = scene.camera(width=64, height=48)
    history = tr.render(scene, camera, history=tr.RenderHistory(), budget_ms=1e6).history
    for bound in (0.3, 0.15, 0.08):
        plan = tr.plan(scene, camera, history=history, max_error=bound)
        assert plan.error_interval is not None
        error = plan.predicted_error or 1.0
        if plan.possible and error * (plan.error_interval[1] / error) ** UNSEEN_GUARD > bound:
            others = [tr.plan(scene, camera, history=history, max_error=bound / k) for k in (4, 16, 64)]
            surest = min((p.error_interval or (0.0, 1.0))[1] for p in others)
            assert surest > bound, "nothing is as sure: then what is half as sure"
        assert not plan.possible or (plan.predicted_error or 1.0) <= bound


def test_bounds_are_kept_by_more_where_less_is_known() -> None:
    """Of a measured scene by least, of another one's first picture by most."""
    expected = Expected(0.1, 0.2)
    found: list[float] = []
    for scene, pictures in ((tr.load("cornell_box"), 0), (anything(3), 2), (anything(3), 0)):
        history = replace(tr.RenderHistory(), pictures=pictures)
        camera = scene.camera(width=512, height=512)
        known = Knowledge.of(scene, camera, tr.RenderOptions(), history, load_curves())
        found.append(math.log(most_of(known, expected) / 0.1) / math.log(expected.interval[1] / 0.1))
    assert found == pytest.approx([GUARD, UNSEEN_GUARD, FIRST_GUARD]) and found == sorted(found)


def test_passes_sense_only_where_it_helps() -> None:
    scene, box = anything(5), tr.load("cornell_box")
    camera = scene.camera(width=48, height=48)
    assert load_curves().scenes.keys() >= {"cornell_box/96"}
    assert "senses" not in tr.render(scene, camera).timings_ms
    assert "senses" not in tr.render(box, width=400, height=400, budget_ms=1000).timings_ms
    assert tr.render(box, width=48, height=48, budget_ms=1000).timings_ms["senses"] > 0, "it was measured larger"
    assert tr.render(scene, camera, max_error=0.3).timings_ms["senses"] > 0


def test_errors_of_what_looks_from_few_pixels_grow_as_these_part() -> None:
    """Of ambient visibility, which looks from fewer; where errors are known, of rays that share blocks of pixels."""
    curves = replace(load_curves(), fine=Joint(), coarse=Joint())
    step, gbuffer = find_pass("ambient_visibility"), find_pass("gbuffer")

    def error(scene: tr.Scene, side: int, setting: str, supersample: float) -> float:
        options = tr.RenderOptions(supersample=supersample)
        known = Knowledge.of(scene, scene.camera(width=side, height=side), options, None, curves)
        assert known.unseen == (side < 512)
        return known.setting_error(gbuffer if setting == "1" else step, setting, options).error

    unseen, seen = anything(3), tr.load("cornell_box")
    whole = error(unseen, 64, "8 rays, 4 x 4", 1.0)
    assert 0.0 < whole < 0.5
    assert error(unseen, 64, "8 rays, 4 x 4", 0.25) == pytest.approx(2.0 * whole)
    assert error(unseen, 64, "8 rays, 4 x 4", 2.0) == pytest.approx(whole)
    assert error(unseen, 64, "off", 0.25) == error(unseen, 64, "off", 1.0)
    assert error(unseen, 64, "1", 0.25) == error(unseen, 64, "1", 1.0)
    assert error(seen, 512, "8 rays, 4 x 4", 0.25) == pytest.approx(2.0 * error(seen, 512, "8 rays, 4 x 4", 1.0))
    assert error(seen, 512, "1 x 12", 0.25) == error(seen, 512, "1 x 12", 1.0)


def test_hard_shadows_are_sensed_by_the_penumbrae_that_they_leave_out() -> None:
    """A picture without penumbrae would find that leaving them out changes nothing, and so would all that follow."""
    scene = tr.load("cornell_box")
    camera = scene.camera(width=96, height=96)
    found = {}
    for area in ("sampled", "hard"):
        options = tr.RenderOptions(reuse=None, area_shadows=area, fixed=("soft_shadow",))
        image = tr.render(scene, camera, options=options, history=tr.RenderHistory(), budget_ms=1e6)
        assert image.history is not None and image.history.pace is not None
        found[area] = image.history.pace.known
    soft, hard = (found[area][sense_of("soft_shadow")] for area in ("sampled", "hard"))
    assert soft > 0.02 and soft / 2.5 < hard < 2.5 * soft
    assert sense_of(closely("soft_shadow")) in found["sampled"]
    assert sense_of(closely("soft_shadow")) not in found["hard"], "zero, by what is not there"
