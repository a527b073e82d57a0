"""Curves: what is read, what is refused, and what is ignored with a warning."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

import torchrender as tr
from torchrender.passes.senses import closely
from torchrender.pipeline.options import RenderOptions
from torchrender.planning import curves as module
from torchrender.planning.curves import (
    MEASURED_SPREAD,
    Curves,
    CurvesWarning,
    load_curves,
    parse_curves,
    scene_key,
    shipped_curves,
    user_file,
)
from torchrender.planning.foresight import COVERED, Expected
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load


def small() -> dict[str, Any]:
    record = {"flip": 0.2, "psnr": 20.0}
    return {
        "format": 4,
        "norm": 2.0,
        "weights": {"gbuffer": {"1": [1.0, 10.0, 5.0]}},
        "scenes": {
            "a/1": {"passes": {"gbuffer": {"1": record}}, "ratios": {"gbuffer": {"1": 2.0}}},
            "b/2": {"passes": {"gbuffer": {"1": {**record, "flip": 0.4}}}},
        },
    }


def test_times_are_weighted_sums_and_errors_means() -> None:
    curves = parse_curves(small(), "test")
    assert curves.time_ms("gbuffer", "1", (1.0, 0.5, 2.0)) == pytest.approx(16.0)
    assert curves.time_ms("gbuffer", "1", (1.0, 0.5, 2.0), "a/1") == pytest.approx(32.0)
    assert curves.time_ms("gbuffer", "2", (1.0, 0.5, 2.0)) is None
    assert curves.error("gbuffer", "1", "a/1").error == 0.2
    assert curves.error("gbuffer", "1", "unknown").error == pytest.approx(0.3)
    assert curves.together([Expected(0.3, 0.1), Expected(0.4, 0.1)]).error == pytest.approx(0.5)
    assert curves.together([]).error == 0.0
    more = parse_curves({**small(), "joint": {"fine": [1.5, 1.0, 0.7], "coarse": [0.8]}}, "test")
    unseen = more.together([Expected(0.2, 0.1)], unseen=RenderOptions())
    assert unseen.error == pytest.approx(0.2), "the factor is in what passes add"
    assert unseen.interval == pytest.approx((0.2 * math.exp(-unseen.spread), 0.2 * math.exp(0.7 * unseen.spread)))
    assert more.joint(RenderOptions(supersample=2.0)).factor == 1.5
    assert more.joint(RenderOptions(supersample=0.5)) == (0.8, COVERED, COVERED, 0.0)
    assert parse_curves({**small(), "joint": 1.2}, "test").coarse.factor == 1.2
    assert more.together([Expected(0.2, 0.1)]).error == pytest.approx(0.2), "scenes that were measured have their own"


def test_what_is_known_of_the_scene_itself_comes_before_what_is_sensed_there() -> None:
    """Its own record, then the line of what a probe found, then that of what was sensed, then the mean of others."""
    usual, found = ([math.log(least), 0.5, 0.0, math.log(least), 1.0, 0.2] for least in (0.1, 0.3))
    lines = {"gbuffer": {"1": usual}, closely("gbuffer"): {"1": found}}
    curves = parse_curves({**small(), "foresight": lines}, "test")
    assert curves.error("gbuffer", "1", "a/1", sensed=0.5, probed=0.5) == Expected(0.2, MEASURED_SPREAD)
    assert curves.error("gbuffer", "1", "unknown", sensed=0.5, probed=0.5).error == pytest.approx(0.15)
    assert curves.error("gbuffer", "1", "unknown", sensed=0.5).error == pytest.approx(0.05)
    assert curves.error("gbuffer", "1", "unknown").error == pytest.approx(0.1)
    only = parse_curves({**small(), "foresight": {"gbuffer": {"1": usual}}}, "test")
    assert only.error("gbuffer", "1", "unknown", sensed=0.5, probed=0.9).error == pytest.approx(0.05)


def test_errors_of_measured_scenes_hold_for_pictures_of_about_that_size() -> None:
    """Half as many pixels to twice as many, whatever the shape."""
    curves = parse_curves({**small(), "side": 64}, "test")
    for width, height, holds in ((64, 64, True), (64, 32, True), (32, 64, True), (128, 64, True), (16, 512, True),
                                 (64, 31, False), (129, 64, False), (32, 32, False), (128, 128, False)):  # fmt: skip
        camera = Cameras.look_at([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], width=width, height=height)
        assert curves.like_measured(camera) == holds, (width, height)


@pytest.mark.parametrize(
    "damage",
    [
        {"format": 1},
        {"joint": [9.0]},
        {"joint": 9.0},
        {"joint": {"fine": [1.0, 1.0, float("nan")]}},
        {"joint": {"coarse": [1.0, -1.0]}},
        {"joint": {"coarse": [1.0, 1.0, 1.0, -0.1]}},
        {"norm": 0.0},
        {"norm": float("nan")},
        {"weights": {"gbuffer": {"1": [float("nan")]}}},
        {"weights": {"gbuffer": {"1": [-1.0]}}},
        {"scenes": {"a": {"passes": {"gbuffer": {"1": {"flip": 2.0}}}}}},
        {"scenes": {"a": {"passes": {"gbuffer": {"1": {"flip": -0.1}}}}}},
        {"side": 0},
    ],
)
def test_other_versions_and_numbers_that_mean_nothing_are_refused(damage: dict[str, Any]) -> None:
    with pytest.raises(ValueError):
        parse_curves({**small(), **damage}, "test")


def test_a_users_file_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mine.json"
    monkeypatch.setenv("TORCHRENDER_CURVES", str(path))
    assert user_file() == path
    assert load_curves() is shipped_curves()
    path.write_text(json.dumps(small()))
    assert load_curves().source == str(path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"format": 4}',
        '{"format": 7, "weights": {}}',
        '{"format":4,"norm":2,"weights":[],"scenes":{}}',
    ],
)
def test_a_damaged_file_is_ignored_with_a_warning(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mine.json"
    path.write_text(text)
    monkeypatch.setenv("TORCHRENDER_CURVES", str(path))
    with pytest.warns(CurvesWarning, match=r"mine\.json: curves ignored, those of the package are used"):
        found = load_curves()
    assert found is shipped_curves()


def test_a_huge_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(small()))
    monkeypatch.setattr(module, "MAX_BYTES", 10)
    monkeypatch.setenv("TORCHRENDER_CURVES", str(path))
    with pytest.warns(CurvesWarning, match="larger than 10 bytes"):
        assert load_curves() is shipped_curves()


def test_the_cache_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TORCHRENDER_CURVES", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert user_file() == Path("/somewhere/torchrender/curves.json")


def test_a_scene_is_known_by_name_and_size() -> None:
    scene = load("cornell_box")
    assert scene_key(scene) == f"cornell_box/{scene.geometry.triangle_count}"
    assert isinstance(shipped_curves(), Curves)


def test_whole_pictures_of_a_scene_err_by_its_own_factor() -> None:
    """So do the errors that its passes add, and nothing in scenes that nobody measured."""
    box = load("cornell_box")
    curves = load_curves()
    record = {**curves.scenes["cornell_box/96"], "joint": 1.0}
    plain, twice = (replace(curves, scenes={"cornell_box/96": {**record, "joint": f}}) for f in (1.0, 1.5))
    options = RenderOptions(reuse=None, supersample=0.5)
    for side, factor in ((512, 1.5), (64, 1.0)):
        camera = box.camera(width=side, height=side)
        one, other = (tr.plan(box, camera, options=options, curves=c) for c in (plain, twice))
        assert one.predicted_error is not None and one.predicted_error > 0.005
        assert other.predicted_error == pytest.approx(factor * one.predicted_error)
        if factor > 1.0:
            untold = replace(curves, scenes={"cornell_box/96": {k: v for k, v in record.items() if k != "joint"}})
            less = tr.plan(box, camera, options=options, curves=untold)
            low, high = one.error_interval or (0.0, 1.0)
            wide, wider = less.error_interval or (0.0, 1.0)
            assert wider / wide > 1.05 * high / low, "less is known"
        ambient = (plan.row("gbuffer").predicted_error or 0.0 for plan in (one, other))
        assert factor * next(ambient) == pytest.approx(next(ambient))


@pytest.mark.parametrize("factor", [0.1, 5.0])
def test_factors_of_nonsense_are_refused(factor: float) -> None:
    data = json.loads((files("torchrender") / "data" / "curves.json").read_text())
    data["scenes"]["cornell_box/96"]["joint"] = factor
    with pytest.raises(ValueError, match="joint of cornell_box/96 must be in"):
        parse_curves(data, "here")
