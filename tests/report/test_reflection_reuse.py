"""The study of reflection reuse: its arithmetic, and that the command writes a page from what it measured."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest

from torchrender.report.reuse.page import intervals
from torchrender.report.reuse.study import QUICK, run


def test_intervals_between_key_frames() -> None:
    frames = [{"report": {"key_frame": k in (0, 3, 4)}} for k in range(9)]
    assert intervals(frames) == [3, 1, 5]
    assert sum(intervals(frames)) == len(frames)


def test_the_page_and_its_figures(tmp_path) -> None:
    record = run(replace(QUICK, size=48, frames=4), tmp_path)
    page = (tmp_path / "reflection-reuse.md").read_text()
    stored = json.loads((tmp_path / "reflection-reuse.json").read_text())
    frames = stored["walks"]["washroom walk1"]["frames"]
    assert len(frames) == 4 and frames[0]["report"]["key_frame"] and frames[0]["error"] == 0.0
    followed = [f for f in frames if "baselines" in f]
    assert followed
    own = sum(f["error"] for f in followed) / len(followed)
    painted = sum(f["baselines"]["depth"]["error"] for f in followed) / len(followed)
    assert own < 1.0 and painted > 3 * own
    row = next(line for line in page.splitlines() if line.startswith("| washroom walk1") and f"{painted:.2f}" in line)
    assert f"{own:.2f}" in row
    assert all("popping" in f for f in frames[1:])
    whole = stored["walks"]["washroom walk1"]["whole"]
    assert len(whole) == 5 and "## Whole walks at 32²" in page
    assert [k for k, f in enumerate(whole) if "trace_ms" in f] == [1, 4] and whole[0]["traced_share"] == 1.0
    assert record["walks"].keys() == stored["walks"].keys()
    for link in re.findall(r"\]\(([^)]+)\)", page):
        assert (tmp_path / link).stat().st_size > 500


def test_published_numbers_agree_with_the_specification() -> None:
    from torchrender.report.reuse.page import PUBLISHED_22, PUBLISHED_23

    for values in PUBLISHED_23.values():
        assert sum(v for k, v in values.items() if k != "total") == pytest.approx(values["total"], abs=0.3)
    assert len(PUBLISHED_22) == 4
