"""Pages of results: how they are written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path


def text_writer(text: str) -> Callable[[Path], None]:
    """A writer of ``text`` for :func:`write_atomically`."""

    def write(path: Path) -> None:
        path.write_text(text)

    return write
