"""Cells of tables that several pages have."""

from __future__ import annotations

from collections.abc import Iterable


def share(flags: Iterable[bool], digits: int = 0) -> str:
    """Of those that hold, in percent; a dash where there are none."""
    found = list(flags)
    return f"{100 * sum(found) / len(found):.{digits}f}" if found else "–"
