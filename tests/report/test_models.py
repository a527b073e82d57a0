"""The study of test models, small; and scenes handed to the path tracer mean the same there."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from PIL import Image

from torchrender.renderer import render
from torchrender.report.models.path_traced import path_traced
from torchrender.report.models.sheet import tile_of_twin, write_sheet
from torchrender.report.models.study import run, sky_of
from torchrender.report.models.twins import TWINS, Twin, seen


def test_a_small_study_writes_its_page_and_its_sheets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORCHRENDER_DATA", str(tmp_path / "nothing"))
    files = run(tmp_path, quick=True)
    record = json.loads(files[0].read_text())
    assert list(record["models"]) == ["UnlitTest"] and record["failed"] == []
    assert "| UnlitTest |" in files[1].read_text() and files[2].name == "models-twins.jpg"
    with Image.open(files[2]) as sheet:
        assert sheet.size[0] > 2 * 32


@pytest.mark.parametrize("twin", TWINS, ids=lambda twin: twin.name)
def test_twins_look_like_the_path_tracers(twin: Twin, tmp_path: Path) -> None:
    """Means of both pictures agree to what a single bounce of light lacks; where no light comes back, much closer."""
    pytest.importorskip("mitsuba")
    tile = tile_of_twin(twin, sky_of(tmp_path), side=24, samples=16)
    assert tile.traced is not None
    found, wanted = float(tile.found.float().mean()), float(tile.traced.float().mean())
    assert found == pytest.approx(wanted, rel=0.02 if twin.name == "UnlitTest" else 0.12)
    write_sheet(tmp_path / "sheet.jpg", [tile], columns=1)
    assert (tmp_path / "sheet.jpg").stat().st_size > 500


def test_the_board_of_textures_is_laid_alike(tmp_path: Path) -> None:
    """Block by block, as the path tracer knows no coarser levels: turned or shifted textures differ far more."""
    pytest.importorskip("mitsuba")
    (twin,) = (t for t in TWINS if t.name == "TextureTransformTest")
    scene = replace(twin.make(sky_of(tmp_path)), environment=None, ambient=torch.ones(3))
    scene = replace(scene, materials=tuple(replace(m, metallic=None, roughness=1.0) for m in scene.materials))
    camera = seen(twin, scene, 96)
    found, wanted = render(scene, camera).radiance[0], path_traced(scene, camera, 64)
    blocks = (found - wanted).reshape(16, 6, 16, 6, 3).mean(dim=(1, 3))
    assert float(blocks.abs().mean()) < 0.02 and float(blocks.abs().max()) < 0.15
