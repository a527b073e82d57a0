"""The study of shading writes its page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from torchrender.report.shading.mitsuba import beside_mitsuba
from torchrender.report.shading.study import run


def test_the_page_has_a_row_for_every_scene_and_its_pictures_agree(tmp_path: Path) -> None:
    files = run(tmp_path, quick=True)
    record = json.loads(files[0].read_text())
    assert [row["scene"] for row in record["direct_light"]] == ["cornell_box"]
    assert all(row["differ"] == 0 for row in record["direct_light"])
    assert all(0.99 < row["least"] <= row["most"] <= 1.0 + 1e-5 for row in record["furnace"])
    small = [row for row in record["mitsuba"].get("rows", ()) if row["light"] != "area"]  # that one is noisy
    assert all(row["psnr"] > 30.0 and abs(row["ratio"] - 1.0) < 0.03 for row in small)
    text = files[1].read_text()
    assert "| cornell_box | 128 |" in text and "| 0.4 |" in text


@pytest.mark.parametrize("ball", ["rough conductor, 0.2", "rough conductor, 0.4"])
def test_metals_show_a_rectangle_as_mitsuba_does(ball: str) -> None:
    """Within 3 % and 35 dB; one bounce between microfacets, as there."""
    pytest.importorskip("mitsuba")
    (row,) = (row for row in beside_mitsuba(None, 64, (ball,))["rows"] if row["light"] == "area")
    assert row["once"]["ratio"] == pytest.approx(1.0, abs=0.03) and row["once"]["psnr"] > 35.0
