"""A plan: which passes make a picture, which do not and why, with what settings, and what that is expected to cost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from torchrender.brief import html_table
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Search
from torchrender.planning.foresight import Expected


@dataclass(frozen=True, kw_only=True)
class PlanRow:
    """One pass of a plan."""

    name: str
    runs: bool
    reason: str
    setting: str  # of its knob; "custom" where the options are at none of them
    predicted_ms: float | None = None
    expected_error: Expected | None = None  # mean FLIP against the pass's reference, also of one that was left out
    measured_ms: float | None = None
    amounts: tuple[float, ...] | None = None  # of work, once the pass ran; None where predictions do not cover it
    lasts: bool = False  # what it makes is kept by pictures that follow, as long as the scene stands still

    @property
    def predicted_error(self) -> float | None:
        """Mean FLIP against the pass's reference; None where its setting was never measured."""
        return None if self.expected_error is None else self.expected_error.error


SLOW = 1.5
"""Times the prediction from which on it is asked why a picture took so long."""
BUSY = 0.3
"""Share of waiting for a processor from which on others are to blame: own threads wait less for each other."""
KEPT_MS = 0.05
"""From on which time that later pictures save is told."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The passes in the order in which they run, then those that do not.

    ``str(plan)`` is a table for readers. Predictions come from measured curves and hold as far as the scene is like
    those that were measured; see ``torchrender calibrate``.
    """

    rows: tuple[PlanRow, ...]
    options: RenderOptions
    budget_ms: float | None = None
    max_error: float | None = None
    possible: bool = True  # the wishes can be met, by the predictions
    statement: str = ""
    predicted_error: float | None = None  # mean FLIP of the whole picture; None where a setting was never measured
    error_interval: tuple[float, float] | None = None  # within which it is in nine of ten pictures, at least
    measured_ms: float | None = None
    note: str = ""  # why it took far longer than predicted, where that is known
    changes: tuple[str, ...] = ()  # settings that a budget or a bound chose instead of those asked for, in words
    search: Search | None = field(default=None, repr=False, compare=False)  # that chose these settings
    ahead: tuple[Buffer[Any], ...] = field(default=(), repr=False, compare=False)  # made for pictures to come

    @property
    def running(self) -> tuple[PlanRow, ...]:
        """Rows of the passes that run, in order."""
        return tuple(row for row in self.rows if row.runs)

    @property
    def predicted_ms(self) -> float | None:
        """Time of this picture, all passes; None where one was never measured."""
        return _sum([row.predicted_ms for row in self.running])

    @property
    def following_ms(self) -> float | None:
        """Time of the pictures that follow in a sequence: without what this one makes and they keep."""
        return _sum([row.predicted_ms for row in self.running if not row.lasts])

    def row(self, name: str) -> PlanRow:
        """The row of a pass.

        Raises:
            KeyError: there is none of that name.
        """
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(name)

    def measured(
        self,
        times_ms: Mapping[str, float],
        amounts: Mapping[str, tuple[float, ...]],
        total_ms: float,
        *,
        waited: float = 0.0,
    ) -> Plan:
        """The plan with what its passes took, for how much work, and with which share of waiting for a processor."""
        rows: list[PlanRow] = []
        for row in self.rows:
            done = replace(row, measured_ms=times_ms.get(row.name), amounts=amounts.get(row.name))
            if done.measured_ms is not None and not row.runs:  # a plan made later in the picture has no use for it
                reason = f"it ran before this was known: {row.reason}"
                done = replace(done, runs=True, reason=reason, predicted_ms=row.predicted_ms or 0.0)
            rows.append(done)
        return replace(self, rows=tuple(rows), measured_ms=total_ms, note=self._busy(total_ms, waited))

    def _busy(self, total_ms: float, waited: float) -> str:
        slow = self.predicted_ms is not None and total_ms > SLOW * self.predicted_ms
        if not slow or waited < BUSY:
            return ""
        told = f"it took {total_ms / max(self.predicted_ms or 0.0, 0.1):.1f} times as long as predicted"
        return f"{told}: the machine is busy, {100 * waited:.0f} % of the time went by waiting for a processor"

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "rows": [
                {
                    "pass": row.name,
                    "runs": row.runs,
                    "reason": row.reason,
                    "settings": row.setting,
                    "predicted_ms": _rounded(row.predicted_ms, 2),
                    "predicted_error": _rounded(row.predicted_error, 5),
                    "measured_ms": _rounded(row.measured_ms, 2),
                }
                for row in self.rows
            ],
            "budget_ms": self.budget_ms,
            "max_error": self.max_error,
            "possible": self.possible,
            "statement": self.statement,
            "note": self.note,
            "changes": list(self.changes),
            "predicted_ms": _rounded(self.predicted_ms, 2),
            "following_ms": _rounded(self.following_ms, 2),
            "measured_ms": _rounded(self.measured_ms, 2),
            "predicted_error": _rounded(self.predicted_error, 5),
            "error_interval": None if self.error_interval is None else [_rounded(e, 5) for e in self.error_interval],
        }

    def _repr_html_(self) -> str:
        """In notebooks: what runs, then what does not and why."""
        rows = [
            [row.name, row.setting if row.runs else "–", _ms(row.predicted_ms), _ms(row.measured_ms), row.reason]
            for row in self.rows
        ]
        rows += [[name, "", *texts] for name, *texts in self._totals()]
        rows += [["", "", "", "", text] for text in (*self.changes, self.statement, self.note) if text]
        return html_table(("pass", "setting", "predicted", "took", "why"), rows)

    def __str__(self) -> str:
        cells = [("pass", "setting", "predicted", "took", "why")]
        for row in self.rows:
            setting = row.setting if row.runs else "-"
            cells.append((row.name, setting, _ms(row.predicted_ms), _ms(row.measured_ms), row.reason))
        totals = [(name, "", *texts) for name, *texts in self._totals()]
        widths = [max(len(line[column]) for line in (*cells, *totals)) for column in range(4)]
        lines = []
        marks = (" ", *("+" if row.runs else "." for row in self.rows), *(" " for _ in totals))
        for number, (mark, line) in enumerate(zip(marks, (*cells, *totals), strict=True)):
            text = f"{mark} {line[0]:<{widths[0]}}  {line[1]:<{widths[1]}}  {line[2]:>{widths[2]}}"
            lines.append(f"{text}  {line[3]:>{widths[3]}}  {line[4]}".rstrip())
            if number == 0:
                lines.append("-" * max(len(lines[0]), 60))
        return "\n".join([*lines, *self.changes, *(text for text in (self.statement, self.note) if text)])

    def _totals(self) -> list[tuple[str, str, str, str]]:
        """This picture, and each that follows where that is something else: name, predicted, took, what was wished."""
        found = [("in all", _ms(self.predicted_ms), _ms(self.measured_ms), self._wishes())]
        kept = [row.name for row in self.running if row.lasts and (row.predicted_ms or 0.0) >= KEPT_MS]
        if kept and self.following_ms is not None:
            found[0] = ("in all, first picture", *found[0][1:])
            told = f"keeps {', '.join(kept)} while the scene stands still"
            found.append(("in all, each that follows", _ms(self.following_ms), "", told))
        return found

    def _wishes(self) -> str:
        parts = []
        if self.predicted_error is not None and self.error_interval is not None:
            low, high = self.error_interval
            parts.append(f"error about {self.predicted_error:.4f}, {low:.4f} to {high:.4f} (mean FLIP)")
        if self.budget_ms is not None:
            parts.append(f"budget {self.budget_ms:g} ms")
        if self.max_error is not None:
            parts.append(f"error bound {self.max_error:g}")
        return ", ".join(parts)


def _sum(times: list[float | None]) -> float | None:
    return None if any(t is None for t in times) else sum(t for t in times if t is not None)


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.1f} ms"


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)
