"""Curves of systems that are no pass: settings against error and time beside the scene drawn by another way."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchrender.cli.main import main
from torchrender.scene.environment import Environment
from torchrender.scene.load import load
from torchrender.scene.procedural import SCENES
from torchrender.tuning.measure import Measured
from torchrender.tuning.systems.environment import glossy, light_of_pixels, small_sky
from torchrender.tuning.systems.system import System, Trial, measure_system
from torchrender.tuning.systems.table import SYSTEMS
from torchrender.tuning.tradeoff import SUMMARIES, SceneCurves, label_places, plot, subjects_named, table
from torchrender.tuning.tradeoff_page import earlier_curves, write_page

BY_NAME = {system.name: system for system in SYSTEMS}


def curve(scene: str, system: str, size: int = 48) -> dict[str, Measured]:
    found, shown = measure_system(load(scene), size, BY_NAME[system])
    assert shown is None
    assert all(0.0 < m.flip <= 1.0 and m.ms > 0.0 and m.repeats for m in found.values())
    return found


def test_a_system_is_measured_beside_its_reference() -> None:
    made, white = [], torch.ones(1, 8, 8, 3)

    def trial(scene: object, size: int) -> Trial:
        del scene

        def make(level: float) -> float:
            made.append(level)
            return level

        return Trial(
            settings={"half": lambda: make(0.5), "all": lambda: make(1.0)},
            picture=lambda level: level * white[:, :size, :size],
            reference=lambda: white,
            own=lambda level: 1.0 - level,
        )

    system = System(name="grey", summary="", reference="white", own="missing", trial=trial)
    found, shown = measure_system(load("cornell_box"), 8, system, pictures=True)
    assert made == [0.5] * 3 + [1.0] * 3
    assert found["all"].flip == 0.0 and found["half"].flip > 0.1
    assert found["half"].own == 0.5 and found["half"].relative_mse == pytest.approx(0.25 / 1.01, rel=1e-3)
    assert shown is not None and float(shown.min()) > 0.0
    nothing = replace(system, trial=lambda *_: None)
    assert measure_system(load("cornell_box"), 8, nothing) == ({}, None)


def test_more_cells_are_closer() -> None:
    found = list(curve("cornell_box", "voxels").values())
    assert found[0].flip > found[1].flip > found[-1].flip


def test_three_images_miss_less_than_one() -> None:
    found = curve("nest", "depth_sampling", 64)
    missing = {name: measured.own for name, measured in found.items()}
    assert missing["one image"] > missing["conventional"] > 0.0
    assert 0.0 < missing["non-redundant"] < missing["one image"]


@pytest.mark.parametrize("system", ["reconstruction", "reprojection"])
def test_quads_with_offset_images_are_closer_than_a_grid(system: str) -> None:
    found = curve("cornell_box", system, 64)
    assert found["hybrid, offset images"].flip < found["grid"].flip
    assert found["hybrid, offset images"].own < 0.02


def test_more_points_are_closer_and_squares_are_the_coarsest() -> None:
    found = curve("cornell_box", "points", 64)
    assert found["50 k points"].relative_mse > 1.3 * found["adaptive"].relative_mse
    assert found["squares"].flip > found["reconstruction"].flip


def test_light_of_pixels_is_the_light_of_the_map() -> None:
    picture = torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(2))
    sky = small_sky(Environment(radiance=picture, intensity=2.0, rotation_deg=30.0))
    normals = torch.nn.functional.normalize(torch.randn(40, 3, generator=torch.Generator().manual_seed(3)), dim=-1)
    total = torch.zeros(40, 3)
    for light in light_of_pixels(sky):
        total += light.irradiance * (normals @ -light.direction).clamp_min(0.0)[:, None]
    wanted = Environment(radiance=picture, intensity=2.0, rotation_deg=30.0).irradiance(normals)
    torch.testing.assert_close(total, wanted, rtol=0.01, atol=0.0)


def test_surfaces_of_every_built_in_scene_become_glossy() -> None:
    """Phong materials, too, whose own numbers metallic-roughness does not take."""
    for name in SCENES:
        before = load(name).materials
        for old, new in zip(before, glossy(before), strict=True):
            assert old.unlit or new.metallic is not None
            assert torch.equal(old.diffuse, new.diffuse)


def test_maps_of_an_environment_are_closer_than_even_light() -> None:
    found = curve("panes", "environment_light")
    assert found["even"].psnr + 3.0 < found["maps of 256"].psnr
    assert found["maps of 256"].psnr > 35.0
    assert measure_system(load("cornell_box"), 16, BY_NAME["environment_light"]) == ({}, None)


def test_every_name_stands_for_one_curve() -> None:
    assert len(SUMMARIES) == len(set(SUMMARIES)) and {s.name for s in SYSTEMS} <= set(SUMMARIES)
    assert all(subjects_named(name)[0].name == name for name in SUMMARIES)
    assert set(subjects_named(None)) >= set(SYSTEMS)


def test_curves_of_others_stay_in_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["tradeoff", "cornell_box", "--side", "32", "-o", str(tmp_path), "--pass"]
    assert main([*words, "direct_light"]) == 0
    first = earlier_curves(tmp_path / "tradeoff.html", 32)["cornell_box/96"].passes["direct_light"]
    assert main([*words, "voxels"]) == 0
    page = earlier_curves(tmp_path / "tradeoff.html", 32)["cornell_box/96"]
    assert list(page.passes) == ["direct_light", "voxels"] and page.passes["direct_light"] == first
    assert page.passes["voxels"]["picture"].startswith("data:image/webp")
    record = json.loads((tmp_path / "tradeoff-cornell_box.json").read_text())
    assert set(record["passes"]) == {"direct_light", "voxels"} and "picture" not in record["passes"]["voxels"]
    capsys.readouterr()
    assert main(["tradeoff", "cornell_box", "--side", "64", "-o", str(tmp_path), "--pass", "voxels"]) == 2
    assert "--side" in capsys.readouterr().err
    (tmp_path / "tradeoff.html").write_text("something else")
    assert main([*words, "voxels"]) == 2
    assert "not a page of curves" in capsys.readouterr().err


def _curves(settings: dict[str, tuple[float, float]], commit: str = "abc1234") -> SceneCurves:
    values = {
        name: {"ms": ms, "flip": flip, "psnr": 30.0, "relative_mse": 0.1, "own": None, "spread_ms": 0.1,
               "first_ms": ms, "runs": 2, "repeats": True, "picture": "", "difference": ""}
        for name, (ms, flip) in settings.items()
    }  # fmt: skip
    passes = {"reflections": {"reference": "rays", "own_measure": None, "frontier": [], "settings": values,
                              "commit": commit, "date": "2026-01-01", "picture": ""}}  # fmt: skip
    return SceneCurves("somewhere/1", 64, passes)


def test_what_is_kept_is_said(tmp_path: Path) -> None:
    curves = _curves({"quick": (1.0, 0.2), "exact": (9.0, 0.0)})
    assert "Kept from commit abc1234, 2026-01-01: reflections." in table(curves)
    write_page(tmp_path / "tradeoff.html", [curves])
    assert earlier_curves(tmp_path / "tradeoff.html", 64)["somewhere/1"].passes == curves.passes
    now = SceneCurves("somewhere/1", 64, {"voxels": {"new": True}})
    assert list(now.beside({**curves.passes, "gone": {}}).passes) == ["reflections", "voxels"]


def test_names_in_a_plot_cover_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = pytest.importorskip("matplotlib.figure")
    drawn = []
    monkeypatch.setattr(figure.Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    close = {f"a rather long name {k}": (10.0 + 0.2 * k, 0.1 + 0.001 * (k % 3)) for k in range(7)}
    plot(tmp_path / "plot.png", _curves({**close, "far": (400.0, 0.0)}))
    (axes,) = drawn[0].axes
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) == 8
    for number, box in enumerate(boxes):
        assert not box.count_overlaps(boxes[:number]), "names overlap"
        points = axes.transData.transform([line.get_xydata()[0] for line in axes.lines if len(line.get_xydata()) == 1])
        assert len(points) == 8
        assert not any(box.contains(x, y) for x, y in points), "a name lies on a point"
    offsets = list(label_places(50.0, 10.0))
    assert offsets[0][0] > 0.0 and len(offsets) == len(set(offsets))
