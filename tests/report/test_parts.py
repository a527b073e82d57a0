"""Studies in pieces."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from torchrender.report.common.parts import Parts, Unfinished


def test_what_was_measured_is_taken_over_and_what_was_not_is_named(tmp_path: Path) -> None:
    file = tmp_path / "folder" / "kept.json"
    first = Parts(file)
    assert first.measured("a", lambda: {"x": (1, 2)}) == {"x": [1, 2]}
    late = Parts(file, seconds=-1.0)
    assert late.measured("a", lambda: pytest.fail("measured twice")) == {"x": [1, 2]}
    with pytest.raises(Unfinished, match="1 parts are measured and kept, b and"):
        late.measured("b", dict)
    later = Parts(file)
    assert later.measured("b", lambda: 3) == 3
    later.done()
    assert not file.exists()


def test_another_commit_takes_nothing_over(tmp_path: Path) -> None:
    file = tmp_path / "kept.json"
    Parts(file).measured("a", lambda: 1)
    told = json.loads(file.read_text())
    file.write_text(json.dumps(told | {"commit": "0000000"}))
    assert Parts(file).measured("a", lambda: 2) == 2


def test_without_a_file_all_is_measured() -> None:
    assert Parts().measured("a", lambda: 1) == 1 and Parts().measured("a", lambda: 2) == 2
