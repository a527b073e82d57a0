"""The study of test models, small; and scenes handed to the path tracer mean the same there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from torchrender.report.models.sheet import tile_of_twin, write_sheet
from torchrender.report.models.study import run, sky_of
from torchrender.report.models.twins import TWINS, Twin


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
