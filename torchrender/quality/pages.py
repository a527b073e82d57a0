"""Pages of results: their tables, and how they are written."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically


def text_writer(text: str) -> Callable[[Path], None]:
    """A writer of ``text`` for :func:`write_atomically`."""

    def write(path: Path) -> None:
        path.write_text(text)

    return write


def write_text(path: Path, text: str | Sequence[str]) -> None:
    """Write a text, given whole or line by line."""
    write_atomically(path, text_writer(text if isinstance(text, str) else "\n".join(text) + "\n"))


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write what was measured, as JSON."""
    write_text(path, json.dumps(record, indent=1, default=float) + "\n")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table, a blank one at the end; words in the first column, figures in the others."""
    rule = "|---|" + "---:|" * (len(head) - 1)
    return ["| " + " | ".join(head) + " |", rule, *("| " + " | ".join(row) + " |" for row in rows), ""]
