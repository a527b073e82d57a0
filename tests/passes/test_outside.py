"""A pass that is added from outside, by the recipe of CONTRIBUTING to the letter: planned, run, priced, shown."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
import torch

import torchrender as tr
from torchrender.passes.contract import Pass
from torchrender.passes.hard import bounds_error
from torchrender.passes.table import PASSES
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.curves import ENVIRONMENT, load_curves, scene_key, shipped_curves
from torchrender.report.stability.cases import CASES
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene

CONTRIBUTING = Path(__file__).resolve().parents[2] / "CONTRIBUTING.md"


@pytest.fixture(scope="module")
def recipe() -> Iterator[dict[str, ModuleType]]:
    """The modules of the recipe, by name."""
    blocks = re.findall(r"```python\n# (torchrender/[\w/]+)\.py\n(.*?)```", CONTRIBUTING.read_text(), re.DOTALL)
    made = {}
    for path, code in blocks:
        name = path.replace("/", ".")
        module = made[name] = sys.modules[name] = ModuleType(name)
        exec(compile(code, f"{path}.py", "exec"), module.__dict__)
    yield made
    for name in made:
        del sys.modules[name]


@pytest.fixture(scope="module")
def haze(recipe: dict[str, ModuleType]) -> Pass:
    return recipe["torchrender.passes.picture.haze"].PASS


@pytest.fixture(scope="module")
def thick(recipe: dict[str, ModuleType], haze: Pass) -> RenderOptions:
    wish = recipe["torchrender.effects.haze"].HazeOptions(density=0.4, steps=64)
    return RenderOptions(passes=(*PASSES, haze), effects={"haze": wish})


@pytest.fixture(scope="module")
def scene() -> Scene:
    return replace(load("cornell_box"), ambient=torch.tensor([0.2, 0.3, 0.4]))


def view(scene: Scene, size: int = 48) -> Cameras:
    return scene.camera(width=size, height=size)


def test_the_recipe_has_an_effect_and_a_pass(recipe: dict[str, ModuleType]) -> None:
    assert list(recipe) == ["torchrender.effects.haze", "torchrender.passes.picture.haze"]


def test_it_is_planned_and_explained(scene: Scene, thick: RenderOptions, haze: Pass) -> None:
    plan = tr.plan(scene, view(scene), options=thick)
    row = plan.row("haze")
    assert row.runs and row.reason == "a density of 0.4" and row.setting == "64"
    names = [row.name for row in plan.running]
    assert names.index("gbuffer") < names.index("haze") < names.index("composite")
    assert "haze" in str(plan)
    unasked = tr.plan(scene, view(scene), options=RenderOptions(passes=(*PASSES, haze)))
    assert unasked.row("haze").reason == "no haze was asked for"


def test_it_is_run_and_blended(scene: Scene, thick: RenderOptions) -> None:
    image = tr.render(scene, view(scene), options=replace(thick, buffers=("haze",)))
    clear = tr.render(scene, view(scene))
    share = image.buffers["haze"][..., None]
    assert 0.0 < float(share.min()) < 0.7
    torch.testing.assert_close(image.radiance, torch.lerp(scene.ambient.expand(1, 48, 48, 3), clear.radiance, share))
    assert image.timings_ms["haze"] > 0


def test_without_a_wish_nothing_changes(scene: Scene, haze: Pass) -> None:
    image = tr.render(scene, view(scene), options=RenderOptions(passes=(*PASSES, haze)))
    assert torch.equal(image.radiance, tr.render(scene, view(scene)).radiance)


def test_it_is_priced_and_its_setting_is_chosen(
    scene: Scene, thick: RenderOptions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = shipped_curves()
    key = scene_key(scene)
    costs = {"4": [1.0, 0.0], "16": [10.0, 0.0], "64": [1000.0, 0.0]}
    errors = {"4": {"flip": 0.2}, "16": {"flip": 0.1}, "64": {"flip": 0.0}}
    scenes = {name: dict(one) for name, one in shipped.scenes.items()}
    scenes[key] = {**scenes[key], "passes": {**scenes[key]["passes"], "haze": errors}}
    data = {"format": 4, "norm": shipped.norm, "weights": {**shipped.weights, "haze": costs}, "scenes": scenes}
    file = tmp_path / "curves.json"
    file.write_text(json.dumps(data))
    monkeypatch.setenv(ENVIRONMENT, str(file))
    assert load_curves().time_ms("haze", "16", (1.0, 1.0)) == 10.0
    assert tr.plan(scene, view(scene), options=thick).row("haze").predicted_ms == 1000.0
    cheap = tr.plan(scene, view(scene), options=thick, budget_ms=200.0)
    assert cheap.possible and cheap.row("haze").setting in ("4", "16")
    assert cheap.options.effects["haze"].density == 0.4, "a setting changes nothing but what it is about"
    exact = tr.plan(scene, view(scene), options=thick, max_error=0.01)
    assert exact.row("haze").setting == "64"


def test_it_has_a_hard_case_record(haze: Pass) -> None:
    record = haze.hard[0]
    for case in CASES[:6]:
        subject = case.subject()
        found = record.run(subject)
        assert bounds_error(found, record.bounds(subject)) is None
        assert record.law.deviation(subject, found) <= record.law.limit


def test_it_shows_in_the_extra_layers_of_a_stream(scene: Scene, thick: RenderOptions) -> None:
    """Samples that are not the eye's are made by the same plan."""
    from torchrender_service.renderers.streaming.layers import cameras_around, extra_layers

    camera = view(scene)
    layers = []
    for options in (thick, RenderOptions()):
        image = tr.render(scene, camera, options=options, history=RenderHistory())
        assert image.history is not None and image.plan is not None
        around = cameras_around(camera, image.visibility.depth[0], 2)
        layers.append(extra_layers(scene, image.visibility, around, image.plan.options, image.history))
    hazy, clear = layers[0][0], layers[1][0]
    seen = hazy.known & torch.isfinite(hazy.depth)
    assert int(seen.sum()) > 20 and torch.equal(hazy.known, clear.known)
    share = torch.exp(-0.4 * hazy.depth[seen])[:, None]
    wanted = torch.lerp(scene.ambient.expand(len(share), 3), clear.radiance[seen], share)
    assert float((hazy.radiance[seen] - wanted).abs().max()) < 0.03
    assert float((hazy.radiance[seen] - clear.radiance[seen]).abs().max()) > 0.02


def test_what_is_no_buffer_of_its_kind_is_refused(scene: Scene, thick: RenderOptions, haze: Pass) -> None:
    wrong = replace(haze, run=lambda _: "fog")
    with pytest.raises(tr.TorchRenderError, match="haze must be Tensor, got str"):
        tr.render(scene, view(scene, 8), options=replace(thick, passes=(*PASSES, wrong)))
    with pytest.raises(tr.TorchRenderError, match="no pass 'mist'"):
        tr.render(scene, view(scene, 8), options=RenderOptions(effects={"mist": 1}))
