"""Every effect on every hard case: finite, bounded, repeatable, alike in both precisions, and true to a law.

Effects and cases are records in ``torchrender/report``; ``python -m torchrender.report.stability`` writes what was
measured to a page.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import torchrender.report.stability.study as stability
from torchrender.effects.shadows.shadow_map import ShadowOptions, light_visibility
from torchrender.passes.hard import HardEffect, Law, Outputs, bounds_error, difference, same
from torchrender.passes.table import PASSES
from torchrender.report.common.parts import Parts
from torchrender.report.stability.cases import BASE, BY_NAME, CASES, Case
from torchrender.report.stability.numerics import NUMERICS, HardFunction
from torchrender.report.stability.page import page
from torchrender.report.stability.study import EFFECTS, Finding, examine, faults, pairs, run
from torchrender.shade import shade

PACKAGE = Path(stability.__file__).resolve().parents[2]
PAIRS = list(pairs())


@pytest.mark.parametrize(("effect", "case"), PAIRS, ids=[f"{effect.name}-{case.name}" for effect, case in PAIRS])
def test_the_effect_is_stable(effect, case) -> None:
    assert not examine(effect, case).faults


@pytest.mark.parametrize("function", NUMERICS, ids=lambda f: f.name)
@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**31))
def test_numerical_functions_agree_in_both_precisions(function: HardFunction, seed: int) -> None:
    short, long = function.results(200, seed)
    assert (short.dtype, long.dtype) == (torch.float32, torch.float64)
    assert bool(torch.isfinite(short).all() and torch.isfinite(long).all())
    assert function.difference(200, seed) <= function.limit


# ----------------------------------------------------------- nothing is left out


def test_every_effect_has_a_record() -> None:
    known = {module for effect in EFFECTS for module in effect.modules}
    left = without_record(PACKAGE, known)
    assert not left, f"no record of the stability suite is about {left}, nor does one that has a record import it"
    assert all((PACKAGE / f"{module.replace('.', '/')}.py").is_file() for module in known)


def without_record(package: Path, known: set[str]) -> list[str]:
    """Modules of effects, however deep, that no record is about and that are no part of one that has a record."""
    there = {".".join(p.relative_to(package).with_suffix("").parts): p for p in (package / "effects").rglob("*.py")}
    there = {name: path for name, path in there.items() if not name.endswith("__init__")}
    covered, waiting = set(), [name for name in there if name in known]
    while waiting:
        name = waiting.pop()
        if name not in covered:
            covered.add(name)
            used = re.findall(r"torchrender\.(effects\.[\w.]+)", there[name].read_text())
            waiting += [one for one in used if one in there]
    return sorted(set(there) - covered)


def test_nested_effects_are_not_overlooked(tmp_path: Path) -> None:
    folder = tmp_path / "effects" / "mist"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "thick.py").write_text("from torchrender.effects.mist.parts import x\n")
    (folder / "parts.py").write_text("x = 1\n")
    assert without_record(tmp_path, set()) == ["effects.mist.parts", "effects.mist.thick"]
    assert without_record(tmp_path, {"effects.mist.thick"}) == []
    assert without_record(tmp_path, {"effects.mist.parts"}) == ["effects.mist.thick"]


def test_every_pass_has_a_record() -> None:
    for step in PASSES:
        assert step.name in [record.name for record in step.hard], step.name


def test_names_are_unique_and_twins_exist() -> None:
    assert len(BY_NAME) == len(CASES) and len({effect.name for effect in EFFECTS}) == len(EFFECTS)
    assert all(case.twin in (None, BASE) for case in CASES)


def test_cases_that_differ_in_view_or_light_have_vertices_that_float32_keeps() -> None:
    """So they are not examined once more with rounded ones."""
    usual = BY_NAME[BASE].subject().scene.geometry.vertices
    assert torch.equal(usual, usual.float().double())
    for case in CASES:
        if case.about != "scene":
            assert torch.equal(case.subject().scene.geometry.vertices, usual), case.name


def test_every_effect_is_asked_about_most_of_its_cases() -> None:
    """A record whose cases are all skipped would examine nothing."""
    for effect in EFFECTS:
        own = [case for e, case in PAIRS if e is effect]
        used = [case for case in own if stability.why_not(effect, case) is None]
        assert len(used) >= 0.6 * len(own), effect.name


# ------------------------------------------------------------ the suite can fail


def effect_of(run, *, law: float = 0.0, bounds=(0.0, 1.0)) -> HardEffect:
    return HardEffect(
        name="value",
        modules=(),
        run=run,
        bounds=lambda _: {"value": bounds},
        law=Law(text="none", deviation=lambda *_: law, limit=0.01),
    )


def test_faults_are_found() -> None:
    case = BY_NAME["tiny"]
    calls: list[int] = []

    def changing(_: Case) -> Outputs:
        calls.append(1)
        return {"value": torch.full((4,), 0.1 * len(calls))}

    def by_scale(subject: Case) -> Outputs:
        return {"value": torch.full((4,), min(subject.scene.diagonal, 1.0))}

    def by_type(subject: Case) -> Outputs:
        return {"value": torch.full((4,), float(subject.scene.meshes[0].vertices.dtype == torch.float32))}

    def fixed(value: float):
        return lambda _: {"value": torch.full((4,), value)}

    assert not examine(effect_of(fixed(0.5), law=0.005), replace(case, twin=None)).faults
    for name, effect, word in (
        ("NaN", effect_of(fixed(float("nan"))), "outside"),
        ("infinite", effect_of(fixed(float("inf"))), "outside"),
        ("negative", effect_of(fixed(-0.1)), "outside"),
        ("law", effect_of(fixed(0.5), law=0.02), "law"),
        ("law NaN", effect_of(fixed(0.5), law=float("nan")), "law"),
        ("changing", effect_of(changing), "run again"),
        ("absolute length", effect_of(by_scale), "twin"),
        ("type", effect_of(by_type), "stored in"),
    ):
        found = examine(effect, case).faults
        assert any(word in fault for fault in found), name


def test_measures_of_difference() -> None:
    first = {"a": torch.tensor([1.0, 2.0, float("inf"), 0.0]), "b": torch.tensor([1, 2])}
    assert difference(first, first) == 0.0 and same(first, first)
    other = {"a": torch.tensor([1.0, 2.1, float("inf"), 1e-6]), "b": torch.tensor([1, 2])}
    assert difference(first, other) == 0.25 and not same(first, other)
    other = {"a": torch.tensor([1.0, 2.0, 5.0, 0.0]), "b": torch.tensor([3, 4])}
    assert difference(first, other) == 1.0
    assert difference(first, {"a": first["a"][:2], "b": first["b"]}) == 1.0
    assert bounds_error({"depth": torch.tensor([0.5, float("inf")])}, {"depth": (0.0, float("inf"))}) is None
    wrong = bounds_error({"depth": torch.tensor([0.5, -1.0])}, {"depth": (0.0, float("inf"))})
    assert wrong is not None and "1 of 2" in wrong


def test_the_page_shows_faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = tuple(e for e in EFFECTS if e.name in ("gbuffer", "direct_light"))
    monkeypatch.setattr(stability, "EFFECTS", chosen)
    files, faulty = run(tmp_path, True, Parts())
    assert faulty == 0 and [file.name for file in files] == ["stability.json", "stability.md"]
    record = json.loads((tmp_path / "stability.json").read_text())
    text = (tmp_path / "stability.md").read_text()
    assert "0 with one" in text and "| studio |" in text and record["numerics"]
    bad = Finding(effect="gbuffer", case=BASE, law=0.5)
    record["findings"][0] = {**vars(bad), "faults": faults(bad, EFFECTS[0])}
    assert "1 with one" in page(record) and "**gbuffer, studio**: law: 0.5" in page(record)


# ------------------------------------------------------- what the suite has found


def test_contact_shadows_stay_in_place_far_from_the_origin() -> None:
    """Positions are float64: no bias for float32 coordinates may lift the shadow of the block off its own foot."""
    near, far = (BY_NAME[name].subject() for name in (BASE, "far away"))
    options = ShadowOptions(size=256, filter="pcf", filter_radius=1)
    for first, second in zip(near.scene.lights, far.scene.lights, strict=True):
        found = light_visibility(near.scene, first, near.gbuffer, options)
        moved = light_visibility(far.scene, second, far.gbuffer, options)
        assert float((found - moved).abs().max()) < 1e-5
        assert 0.02 < float((found[near.gbuffer.covered] == 0).double().mean()) < 0.9


def test_a_backdrop_far_away_does_not_blur_the_light_near_the_eye() -> None:
    """Shading counts positions from the eye: float32 steps at the backdrop's distance are larger than the scene."""
    subject = BY_NAME[BASE].subject()
    far = torch.tensor([[-1e9, -1e9, -1e9], [1e9, -1e9, -1e9], [0.0, 1e9, -1e9]], dtype=torch.float64)
    backdrop = replace(subject.scene.meshes[0], vertices=far, faces=torch.tensor([[0, 1, 2]]), uv=None, normals=None)
    scene = replace(subject.scene, meshes=(*subject.scene.meshes, backdrop))
    wide = Case(scene=scene, cameras=subject.cameras)
    kept = subject.gbuffer.covered
    # The light that a point sends no nearer than a share of the scene's diagonal: leave it out.
    lights = (subject.scene.lights[0],)
    images = [shade(replace(s.scene, lights=lights), s.gbuffer)[kept] for s in (subject, wide)]
    torch.testing.assert_close(*images, rtol=1e-4, atol=1e-5)
