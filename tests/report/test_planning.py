"""The study of plans writes its page."""

from __future__ import annotations

import json
from pathlib import Path

from torchrender.report.planning.study import run


def test_the_page_has_a_row_for_every_table_and_scene(tmp_path: Path) -> None:
    files = run(tmp_path, quick=True)
    record = json.loads(files[0].read_text())
    assert [row["passes"] for row in record["made_up"]] == [8, 10] and len(record["scenes"]) == 2
    text = files[1].read_text()
    assert "| cornell_box | sequence |" in text and "| 10 |" in text
    assert all(0 < row["low_ms"] <= row["median_ms"] <= row["max_ms"] for row in record["made_up"] + record["scenes"])
