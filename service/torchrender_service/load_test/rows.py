"""What the load test finds: one row a figure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure beside its goal."""

    what: str
    goal: str
    measured: str
    met: bool | None  # None: no goal, or measured elsewhere
    before: str = ""  # what it was once
    details: dict[str, Any] = field(default_factory=dict)

    @property
    def mark(self) -> str:
        """Whether it is met, in a table."""
        return "" if self.met is None else "met" if self.met else "**missed**"

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "what": self.what,
            "goal": self.goal,
            "measured": self.measured,
            **({"before": self.before} if self.before else {}),
            "met": None if self.met is None else bool(self.met),
            **self.details,
        }


def table_of(rows: list[Row]) -> list[str]:
    """Lines of a table, with a column for what it was once, where something is known about that."""
    if any(row.before for row in rows):
        head = ["| what | once | goal | measured | |", "|---|---|---|---|---|"]
        return head + [f"| {r.what} | {r.before} | {r.goal} | {r.measured} | {r.mark} |" for r in rows]
    head = ["| what | goal | measured | |", "|---|---|---|---|"]
    return head + [f"| {r.what} | {r.goal} | {r.measured} | {r.mark} |" for r in rows]


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How long everything is measured."""

    quick: bool = False
    soak_s: float = 600.0

    @property
    def seconds(self) -> float:
        """Of one walk."""
        return 2.0 if self.quick else 10.0

    @property
    def sessions(self) -> int:
        """At a time, in the soak."""
        return 6 if self.quick else 50

    @property
    def scene(self) -> str:
        """What is walked through."""
        return "cornell_box" if self.quick else "living_room"

    @property
    def size(self) -> tuple[int, int]:
        """Of the view."""
        return (160, 90) if self.quick else (640, 360)
