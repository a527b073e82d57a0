"""The sampling study runs, writes its files, and says what it measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from torchrender.report.common.subject import subject_box
from torchrender.report.sampling import study as sampling
from torchrender.report.sampling.published import AVAILABLE, KINDS, TIMES
from torchrender.scene.procedural import build

pytest.importorskip("matplotlib")


def test_a_tiny_study_writes_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny = sampling.Effort(48, 3, 2, 2, 24, 2, (24, 48), 2, 1)
    monkeypatch.setattr(sampling.Effort, "quick", lambda: tiny)
    monkeypatch.setattr(sampling, "build", lambda name: build(name, triangles=3000))
    monkeypatch.setattr("sys.argv", ["sampling", "--quick", "--scenes", "nest", "city", "-o", str(tmp_path)])
    sampling.main()
    record = json.loads((tmp_path / "sampling.json").read_text())
    nest = record["scenes"]["nest"]
    assert record["machine"]["commit"]
    assert nest["triangles"] > 2500
    assert nest["ms"]["C"]["median"] > 0
    assert all(share == [0.0, 0.0] for share in nest["tables"]["pixel"]["C"]["hidden"])
    assert all(share[0] == 0 for share in nest["tables"]["pixel"]["N"]["redundant"])
    assert set(nest["resolution"]["pixel"]) == {"24", "48"}
    page = (tmp_path / "sampling.md").read_text()
    for heading in ("table 2 and 3", "table 4", "table 5", "table 6", "table 7", "Resolution study"):
        assert heading in page
    assert "nan" not in page.lower()
    assert "Triangles about as small as pixels" in page and nest["subpixel"]["median_triangle_pixels"] < 4
    monkeypatch.setattr("sys.argv", ["sampling", "--quick", "--scenes", "city", "-o", str(tmp_path)])
    sampling.main()
    again = json.loads((tmp_path / "sampling.json").read_text())
    assert again["scenes"]["nest"] == nest, "scenes that were not measured again stay"
    for picture in ("sampling-nest.png", "sampling-city.png", "sampling-resolution.png"):
        assert (tmp_path / picture).stat().st_size > 1000


@pytest.mark.parametrize("name", sampling.SCENES)
def test_viewpoints_form_an_equilateral_triangle_that_faces_the_subject(name: str) -> None:
    scene = build(name, triangles=3000)
    box = subject_box(scene)
    assert bool((box[0] >= scene.bounds[0]).all()) and bool((box[1] <= scene.bounds[1]).all())
    eyes = sampling.viewpoints(scene, 0.6, 16).eye
    diagonal, target, middle = float((box[1] - box[0]).norm()), box.mean(dim=0), eyes.mean(dim=0)
    sides = [float((eyes[i] - eyes[j]).norm()) for i, j in ((0, 1), (1, 2), (2, 0))]
    assert sides == pytest.approx([sampling.SIDE * diagonal] * 3)
    assert float((middle - target).norm()) == pytest.approx(0.6 * diagonal)
    for eye in eyes:
        assert float((eye - middle) @ (middle - target)) == pytest.approx(0.0, abs=1e-9 * diagonal**2)


def test_the_subject_leaves_out_the_ends() -> None:
    scene = build("grass", triangles=3000)
    geometry = scene.geometry
    centres = geometry.vertices[geometry.faces.long()].mean(dim=1)
    low, high = subject_box(scene)
    assert ((centres < low).double().mean(dim=0) - 0.05).abs().max() < 1e-2
    assert ((centres > high).double().mean(dim=0) - 0.05).abs().max() < 1e-2


def test_published_tables_are_complete() -> None:
    for tables in (KINDS, AVAILABLE):
        assert set(tables) == {"pixel", "visibility"}
        assert all(set(table) == set(sampling.SCENES) for table in tables.values())
    assert all(set(row) == {"C", "N", "P"} for row in TIMES.values())
