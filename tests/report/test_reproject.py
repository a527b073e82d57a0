"""The reprojection report: a tiny run from end to end."""

from __future__ import annotations

import json
from pathlib import Path

from torchrender.images.files import read_image
from torchrender.report.reproject.study import SCENES, run


def test_a_tiny_run_writes_its_page(tmp_path: Path) -> None:
    run(tmp_path, 48, 1, triangles=10_000)
    record = json.loads((tmp_path / "reproject.json").read_text())
    assert len(record["scenes"]) == 2 * len(SCENES)
    for found in record["scenes"].values():
        assert 0.3 < found["filled"] <= 1.0
        assert all(row["median"] > 0 for row in found["ms"].values())
        hybrid, grid = (found["quality"][key] for key in ("hybrid, offset images", "grid"))
        assert 0.8 < hybrid["valid"] <= 1.0 and hybrid["valid"] >= grid["valid"] - 0.02
    page = (tmp_path / "reproject.md").read_text()
    assert "plain torch grid" in page and "nan" not in page
    assert read_image(tmp_path / "reproject.png").shape == (4 * 48, 5 * 48, 3)
