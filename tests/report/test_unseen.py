"""The study of unseen scenes, small."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from torchrender.report.common.parts import Parts
from torchrender.report.unseen.page import bounds, budgets, predictions
from torchrender.report.unseen.study import QUICK, StudyOptions, run, scenes
from torchrender.tuning.unseen import HELD_OUT, SEEDS


def test_a_small_study_writes_its_page(tmp_path: Path) -> None:
    files = run(QUICK, tmp_path, Parts())
    record = json.loads(files[0].read_text())
    assert {r["kind"] for r in record["records"]} == {"budget", "bound", "rung", "bound alone"}
    assert all(0.0 <= r["error"] <= 1.0 and r["predicted"] is not None for r in record["records"])
    text = files[1].read_text()
    assert "random 0" in text and "## Error bounds" in text and "nan" not in text


def test_what_is_missing_is_said_and_seeds_are_others(capsys: pytest.CaptureFixture[str]) -> None:
    found = list(scenes(StudyOptions(random=1, files=("no/such.glb",))))
    assert [name for name, _ in found] == ["random 0"] and "no/such.glb" in capsys.readouterr().err
    assert int(found[0][1].name.split()[1]) not in {*SEEDS, *HELD_OUT}
    assert not {*SEEDS} & {*HELD_OUT}, "intervals are those of scenes that no line was fitted to"


def row(
    kind: str, wish: float, error: float, predicted: float, late: float, possible: bool = True
) -> dict[str, object]:
    return {
        "scene": "a", "kind": kind, "wish": wish, "error": error, "predicted": predicted,
        "interval": (predicted / 2, predicted * 2), "possible": possible, "late_ms": [late, late],
    }  # fmt: skip


def test_tables_say_what_records_hold() -> None:
    rows = [
        row("bound", 0.1, 0.09, 0.06, 30.0),
        row("rung", 0.05, 0.04, 0.04, 60.0),
        row("bound", 0.02, 0.03, 0.01, 50.0, possible=False),
        row("budget", 40.0, 0.2, 0.05, 50.0),
    ]
    assert "| all | 4 | 2.25 | 50 | 50 | 50 |" in predictions(rows)
    table = bounds(rows)
    assert any(line.startswith("| 0.1, in a sequence | 1 | 100 | 100 | 0.90 | 1.00 | 100 |") for line in table)
    assert any(line.startswith("| 0.02, in a sequence | 1 | 0 | 100 | 1.50 | – |") for line in table)
    assert "| 40 | 2 | 0 | 0 | 50 |" in budgets(rows, 1.1)
