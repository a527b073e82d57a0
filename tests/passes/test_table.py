"""The pass table: every pass has what a plan, the curves and the stability report need of it."""

from __future__ import annotations

import dataclasses

import pytest

from torchrender.errors import InputError
from torchrender.passes.load import Load
from torchrender.passes.table import PASSES, Pass, find_pass
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.curves import shipped_curves
from torchrender.planning.knowledge import Knowledge
from torchrender.planning.planner import verdicts
from torchrender.scene.load import load
from torchrender.tuning.measure import OWN

LOAD = Load(
    picture=0.25, pixels=0.5, triangles=0.1, views=6, map_size=None, point_lights=1, area_lights=1, reflective=0.1,
    caster=False, occluders=False, shader=False,
)  # fmt: skip


def test_names_are_unique_and_buffers_have_makers() -> None:
    names = [step.name for step in PASSES]
    assert len(set(names)) == len(names)
    made = {step.makes for step in PASSES}
    for step in PASSES:
        assert {*step.needs, *step.uses} <= made, step.name
        assert step.makes not in (*step.needs, *step.uses), step.name


@pytest.mark.parametrize("step", PASSES, ids=lambda step: step.name)
def test_a_pass_has_a_knob_with_a_reference_a_summary_and_reasons(step: Pass) -> None:
    assert len(step.knob.settings) > 1 or step.name == "gbuffer"
    assert step.summary and step.knob.name
    known = {field.name for field in dataclasses.fields(RenderOptions)}
    for setting in (*step.knob.settings, step.knob.reference):
        assert setting.changes, f"{step.name}: {setting.name} changes nothing"
        assert {path.partition(".")[0] for path in setting.changes} <= known
        assert setting.matches(setting.applied(RenderOptions()))
        assert step.knob.setting(setting.name) == setting
    names = [s.name for s in step.knob.settings]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("step", PASSES, ids=lambda step: step.name)
def test_work_is_a_fixed_number_of_finite_amounts(step: Pass) -> None:
    lengths = {len(step.work(LOAD, setting)) for setting in step.knob.settings}
    assert len(lengths) == 1
    more = dataclasses.replace(LOAD, pixels=1.0, picture=1.0, triangles=1.0, reflective=0.5, views=12)
    for setting in step.knob.settings:
        less, greater = step.work(LOAD, setting), step.work(more, setting)
        assert all(0 <= a <= b < float("inf") for a, b in zip(less, greater, strict=True))


def test_every_pass_gives_a_reason_in_every_scene() -> None:
    for name in ("cornell_box", "grass", "washroom"):
        scene = load(name, size=None if name == "cornell_box" else 7000)
        camera = scene.camera(width=32, height=32)
        known = Knowledge(scene=scene, cameras=camera, past=RenderHistory(), curves=shipped_curves())
        found = verdicts(PASSES, known.outlook(RenderOptions()))
        assert set(found) == {step.name for step in PASSES}
        assert all(verdict.reason for verdict in found.values())


def test_every_pass_was_measured_for_the_shipped_curves() -> None:
    curves = shipped_curves()
    for step in PASSES:
        # Reuse that is off does not run: nothing to measure but its error, which is none.
        timed = [s for s in step.knob.settings if s.name != "off"]
        assert set(curves.weights[step.name]) == {s.name for s in timed}, step.name
        for setting in timed:
            assert len(curves.weights[step.name][setting.name]) == len(step.work(LOAD, setting))
            assert any(curves.record(step.name, setting.name, scene) for scene in curves.scenes), (step.name, setting)
    assert set(OWN) <= {step.name for step in PASSES}


def test_unknown_passes_and_settings_are_named() -> None:
    with pytest.raises(InputError, match="known passes: gbuffer, shadow_map"):
        find_pass("gbufer")
    with pytest.raises(InputError, match="known settings: hard, pcss"):
        find_pass("soft_shadow").knob.setting("softer")


def test_options_at_no_setting_are_custom() -> None:
    knob = find_pass("soft_shadow").knob
    assert knob.current(RenderOptions()) == "pcss"
    assert knob.current(knob.setting("8 x 8").applied(RenderOptions())) == "8 x 8"
    assert find_pass("gbuffer").knob.current(RenderOptions(supersample=1.3)) == "custom"


def test_runs_take_a_frame_alone() -> None:
    """A pass is added by one record: its function gets everything from the frame."""
    for step in PASSES:
        assert list(step.run.__annotations__) == ["frame", "return"], step.name
        assert step.run.__annotations__["frame"] in ("Frame", Frame)
