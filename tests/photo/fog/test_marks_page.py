"""The page of marks lists the keys that the reader takes, no more and no less, and its example can be read."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from torchrender.photo.fog.marks.file import MANY, ONE, parse_marks

PAGE = Path(__file__).resolve().parents[3] / "docs" / "fog-marks.md"


def test_every_key_stands_on_the_page() -> None:
    parts = re.split(r"^## ", PAGE.read_text(), flags=re.MULTILINE)[1:]
    listed = {}
    for part in parts:
        name = re.match(r"`\[+(\w+)\]+`", part).group(1)
        rows = re.findall(r"^\| (`.*?) \|", part, flags=re.MULTILINE)
        listed[name] = {key for row in rows for key in re.findall(r"`(\w+)`", row)}
    known = {name: {f.name for f in fields(kind)} for name, kind in {**ONE, **MANY}.items()}
    assert listed == {**known, "photo": {"width", "height"}}


def test_the_example_is_read() -> None:
    example = re.search(r"```toml\n(.*?)```", PAGE.read_text(), flags=re.DOTALL).group(1)
    marks = parse_marks(example.encode(), "page.toml")
    assert marks.indoor and len(marks.lights) == len(marks.windows) == len(marks.cuboids) == len(marks.lamps) == 1
