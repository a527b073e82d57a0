"""Tables and files of result pages, and the command line that studies share."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from torchrender.quality.pages import table, write_record, write_text
from torchrender.report.common.command import study_parser


def test_a_table_has_words_to_the_left_and_figures_to_the_right() -> None:
    assert table(["name", "ms"], [["a", "1.5"], ["b", "20"]]) == [
        "| name | ms |",
        "|---|---:|",
        "| a | 1.5 |",
        "| b | 20 |",
        "",
    ]


def test_texts_come_whole_or_line_by_line_and_records_read_back(tmp_path: Path) -> None:
    write_text(tmp_path / "a.md", ["one", "two"])
    write_text(tmp_path / "b.md", "one\ntwo\n")
    assert (tmp_path / "a.md").read_text() == (tmp_path / "b.md").read_text() == "one\ntwo\n"
    write_record(tmp_path / "a.json", {"ms": np.float32(1.5), "rows": [1, 2]})
    assert json.loads((tmp_path / "a.json").read_text()) == {"ms": 1.5, "rows": [1, 2]}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "a.md", "b.md"]


def test_studies_share_their_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    parser = study_parser("What it measures.\n\nMore.", quick="a few")
    assert parser.description == "What it measures."
    given = parser.parse_args([])
    assert not given.quick and given.output == Path("docs/results")
    given = parser.parse_args(["--quick", "-o", "elsewhere"])
    assert given.quick and given.output == Path("elsewhere")
    with pytest.raises(SystemExit):
        study_parser(None, output=Path("a.jpg")).parse_args(["--quick"])
    assert "--quick" in capsys.readouterr().err
