"""The study of many views and moving objects writes its page."""

from __future__ import annotations

import json
from pathlib import Path

from torchrender.report.dataset.study import run


def test_the_page_tells_rates_memory_and_how_far_moved_pictures_are(tmp_path: Path) -> None:
    files = run(tmp_path, quick=True)
    record = json.loads(files[0].read_text())
    (row,) = record["views"]
    assert row["same"] and row["all"]["rate"] > 0 and row["depth"]["rate"] > 0
    (moving,) = record["moving"]
    assert moving["moving"] < moving["triangles"] and moving["mean_error"] < 0.5 and moving["visible"] < 0.02
    text = files[1].read_text()
    assert "| nest |" in text and "shadow_map" in text and "**no**" not in text
