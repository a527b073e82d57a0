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
