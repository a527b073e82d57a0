"""The pass table: every pass has what a plan, the curves and the stability report need of it."""

from __future__ import annotations

import ast
import dataclasses
from pathlib import Path

import pytest

import torchrender
from torchrender.errors import InputError
from torchrender.passes.contract import Pass
from torchrender.passes.outlook import Outlook
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import PASSES, find_pass
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.curves import shipped_curves
from torchrender.planning.graph import layers
from torchrender.scene.load import load

HOME = Path(torchrender.__file__).parent
SCENES = ("cornell_box", "grass", "washroom")
SIZES = {"grass": 3000, "washroom": 7000}

EVERY = pytest.mark.parametrize("step", PASSES, ids=lambda step: step.name)


@pytest.fixture(scope="module", params=SCENES)
def outlook(request: pytest.FixtureRequest) -> Outlook:
    scene = load(request.param, size=SIZES.get(request.param))
    return Outlook(
        scene=scene, cameras=scene.camera(width=32, height=32), options=RenderOptions(), history=RenderHistory(),
    )  # fmt: skip


@EVERY
def test_patterns_are_settings(step: Pass) -> None:
    assert set(step.patterns) <= set(step.settings.names)
    assert not step.patterns or step.coarsens > 0.0


def test_names_are_unique_and_buffers_have_makers() -> None:
    names = [step.name for step in PASSES]
    assert len(set(names)) == len(names)
    made = {buffer for step in PASSES for buffer in step.makes_all}
    assert len({buffer.name for buffer in made}) == len(made)
    for step in PASSES:
        assert {*step.needs, *step.uses} <= made, step.name
        assert not {*step.makes_all} & {*step.needs, *step.uses}, step.name


def test_a_pass_has_the_name_of_what_it_makes() -> None:
    """Where several make it, the last of them gives the name; the last pass makes the picture."""
    last = {step.makes: step for step in PASSES}
    for buffer, step in last.items():
        assert buffer.name == step.name or step is PASSES[-1], step.name


def test_there_is_one_file_per_pass_and_no_pass_without_one() -> None:
    files = {path.stem for path in (HOME / "passes").glob("*/*.py")} - {"__init__", "visibility"}
    files -= {
        "standing_light",
        "standing_maps",
        "probe",
        "hidden_light",
        "darkened",
        "air",
        "onward",
        "work",
    }  # what passes of light keep while something moves, and find out; what media do to light; how mirrors see mirrors;
    # what all mirrors cost
    assert files == {step.name for step in PASSES}


def test_no_pass_is_known_by_name_outside_its_file() -> None:
    """Renderer, planner, search and tuning compare no names: a pass is what its contract says."""
    names = {step.name for step in PASSES}
    for folder in ("pipeline", "planning", "tuning"):
        for path in (HOME / folder).rglob("*.py"):
            assert not names & _compared(path), path
    assert not names & _compared(HOME / "renderer.py")


def _compared(path: Path) -> set[str]:
    """Texts that a file compares something with, or looks up by."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        parts: list[ast.expr] = []
        if isinstance(node, ast.Compare):
            parts = [node.left, *node.comparators]
        elif isinstance(node, ast.Subscript):
            parts = [node.slice]
        for part in parts:
            found |= {n.value for n in ast.walk(part) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    return found


@EVERY
def test_a_pass_has_settings_with_a_reference_and_a_summary(step: Pass) -> None:
    assert step.summary and step.hard
    known = {field.name for field in dataclasses.fields(RenderOptions)}
    names = step.settings.names
    assert len(set(names)) == len(names)
    if not step.settings.is_choice:
        return
    for setting in (*step.settings.all, step.settings.reference):
        assert setting.changes, f"{step.name}: {setting.name} changes nothing"
        assert {path.partition(".")[0] for path in setting.changes} <= known
        assert setting.matches(setting.applied(RenderOptions()))
        assert step.settings.named(setting.name) == setting
    assert step.off is None or step.off in names


@EVERY
def test_settings_are_options_that_check_out(step: Pass) -> None:
    """A setting is applied without a check, so it must be one that passes it."""
    for setting in (*step.settings.all, step.settings.reference, step.settings.context):
        made = setting.applied(RenderOptions())
        again = RenderOptions(**{f.name: getattr(made, f.name) for f in dataclasses.fields(RenderOptions)})
        assert again == made


@EVERY
def test_work_is_a_fixed_number_of_finite_amounts(step: Pass, outlook: Outlook) -> None:
    made = [step.amounts(outlook.at(setting.applied(outlook.options))) for setting in step.settings.all]
    assert len({len(amounts) for amounts in made}) == 1
    assert all(0 <= value < float("inf") for amounts in made for value in amounts)


@EVERY
def test_more_pixels_are_no_less_work(step: Pass, outlook: Outlook) -> None:
    few = step.amounts(outlook.at(dataclasses.replace(outlook.options, supersample=1.0)))
    many = step.amounts(outlook.at(dataclasses.replace(outlook.options, supersample=2.0)))
    assert all(a <= b for a, b in zip(few, many, strict=True))


def test_every_pass_gives_a_reason_in_every_scene(outlook: Outlook) -> None:
    for step in PASSES:
        assert step.applies(outlook).reason


@EVERY
def test_whether_a_pass_applies_depends_on_settings_only_where_it_says_so(step: Pass, outlook: Outlook) -> None:
    """The search relies on it."""
    if step.by_settings:
        return
    usual = step.applies(outlook).runs
    for other in PASSES:
        for setting in other.settings.all:
            assert step.applies(outlook.at(setting.applied(outlook.options))).runs == usual, (other.name, setting.name)


@EVERY
def test_what_a_pass_asks_for_depends_on_its_own_settings_alone(step: Pass, outlook: Outlook) -> None:
    """The search relies on it, too."""
    usual = set(step.asked(outlook))
    for other in PASSES:
        if other is not step:
            for setting in other.settings.all:
                asked = set(step.asked(outlook.at(setting.applied(outlook.options))))
                # The first pass sets the number of pixels: who is asked for a guide then follows it.
                assert asked == usual or other is PASSES[0], (other.name, setting.name)


def test_layers_say_where_they_go() -> None:
    orders = [buffer.layer.order for buffer in layers(PASSES) if buffer.layer is not None]
    assert len(orders) >= 2 and len(set(orders)) == len(orders)


def test_every_pass_was_measured_for_the_shipped_curves(outlook: Outlook) -> None:
    curves = shipped_curves()
    for step in PASSES:
        # What is off does not run: nothing to measure but its error, which is none.
        timed = [s for s in step.settings.all if s.name != step.off]
        assert set(curves.weights[step.name]) == {s.name for s in timed}, step.name
        for setting in timed:
            assert len(curves.weights[step.name][setting.name]) == len(step.amounts(outlook))
            if step.settings.is_choice:
                assert any(curves.record(step.name, setting.name, scene) for scene in curves.scenes), setting
    assert set(curves.weights) == {step.name for step in PASSES}


def test_unknown_passes_and_settings_are_named() -> None:
    with pytest.raises(InputError, match="known passes: gbuffer, reflective_pixel"):
        find_pass("gbufer")
    with pytest.raises(InputError, match="known settings: hard, pcss"):
        find_pass("soft_shadow").settings.named("softer")


def test_options_at_no_setting_are_custom() -> None:
    found = find_pass("soft_shadow").settings
    assert found.current(RenderOptions()) == "pcss"
    assert found.current(found.named("8 x 8").applied(RenderOptions())) == "8 x 8"
    assert find_pass("gbuffer").settings.current(RenderOptions(supersample=1.3)) == CUSTOM
