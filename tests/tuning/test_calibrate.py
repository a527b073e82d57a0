"""Curves fitted to what pictures took."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from torchrender.passes.contract import Pass
from torchrender.pipeline.history import RenderHistory
from torchrender.planning.curves import load_curves, parse_curves, scene_key
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.scene.procedural.anything import anything
from torchrender.tuning import calibrate
from torchrender.tuning.calibrate import curves_from


def test_work_that_no_picture_had_keeps_its_price() -> None:
    """Shadows of images in place of triangles would else be free, and a first picture take nine seconds."""
    work = [(1.0, n, 0.0, 0.0) for n in (0.01, 0.1, 0.2, 0.5)]
    seen = {("occluders", "scene"): [("room", amounts, float(np.dot(amounts, (2.0, 300.0, 0, 0)))) for amounts in work]}
    usual = load_curves()
    known = replace(usual, weights={**usual.weights, "occluders": {"images": [9.0, 9.0, 70.0, 80.0]}})
    found = curves_from({}, seen, 1.0, known)["weights"]["occluders"]["images"]
    np.testing.assert_allclose(found, [2.0, 300.0, 70.0, 80.0], rtol=0.05)
    alone = curves_from({}, seen, 1.0)["weights"]["occluders"]["images"]
    np.testing.assert_allclose(alone, [2.0, 300.0, 0.0, 0.0], rtol=0.05)


def test_passes_and_scenes_that_no_picture_had_stay() -> None:
    """Of scenes that are not built in there are no pictures in a new calibration, nor of passes that only they run."""
    usual = load_curves()
    rows = [("room", (1.0, n, 0.0, 0.0), 2.0 + n) for n in (0.1, 0.5)]
    found = curves_from({"room": {}}, {("occluders", "scene"): rows}, 1.0, usual)
    assert found["weights"]["enhancement"] == usual.weights["enhancement"]
    assert set(found["scenes"]) == {*usual.scenes, "room"}
    assert set(curves_from({"room": {}}, {("occluders", "scene"): rows}, 1.0)["weights"]) == {"occluders"}


def test_scenes_that_are_new_change_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """The norm of all scenes once followed a single new one. Settings that nobody measured are, and no others."""
    usual, box = load_curves(), load("cornell_box")
    key = scene_key(box)
    passes = {name: dict(rows) for name, rows in usual.scenes[key]["passes"].items()}
    del passes["ambient_visibility"]["64 rays"], passes["direct_light"]
    known = replace(usual, scenes={key: {"passes": passes}})
    asked = []

    def alone(scene: Scene, camera: Cameras, step: Pass, history: RenderHistory) -> tuple[Any, RenderHistory]:
        del scene, camera
        asked.append(step.name)
        runs = step.name in ("ambient_visibility", "direct_light")
        return {s.name: {"flip": 0.25, "ms": 2.0} for s in step.settings.all if runs}, history

    monkeypatch.setattr(calibrate, "errors_alone", alone)
    monkeypatch.setattr(calibrate, "measure_pass", lambda *_: ({}, None))
    monkeypatch.setattr(calibrate, "times_of", lambda *_: {})
    monkeypatch.setattr(calibrate, "joint_errors", lambda *_: [([0.3, 0.4], 0.75), ([0.0], 0.1)])
    made = calibrate.calibrate([box], size=512, known=known, tell=lambda _: None)
    assert made["norm"] == usual.norm and parse_curves(made, "here").norm == usual.norm
    found = made["scenes"][key]
    assert found["joint"] == pytest.approx(0.75 / (0.3**usual.norm + 0.4**usual.norm) ** (1 / usual.norm), abs=1e-3)
    assert not {"gbuffer", "shadow_map", "soft_shadow", "resample"} & set(asked), "those are known"
    assert asked.count("direct_light") == asked.count("ambient_visibility") == 2, "in two views"
    assert found["passes"]["ambient_visibility"]["64 rays"] == {"flip": 0.25, "ms": 2.0}
    assert found["passes"]["gbuffer"] == passes["gbuffer"]
    again = replace(known, scenes={key: {"passes": found["passes"], "joint": 0.5}})
    assert calibrate.calibrate([box], known=again, tell=lambda _: None)["scenes"][key]["joint"] == 0.5


def test_a_new_scene_leaves_how_errors_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its few pictures alone would give an exponent of their own to all the others."""
    usual, told = load_curves(), list[str]()
    monkeypatch.setattr(calibrate, "errors_of", lambda *_: {})
    monkeypatch.setattr(calibrate, "times_of", lambda *_: {})
    monkeypatch.setattr(calibrate, "joint_errors", lambda *_: [([0.3, 0.4], 0.7)] * 9)
    found = calibrate.calibrate([anything(7)], size=16, known=usual, tell=told.append)
    assert found["norm"] == usual.norm
    assert any("errors measured" in line for line in told)
