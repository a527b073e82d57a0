"""What the pictures of a sequence took so far, beside what was predicted: the next prediction learns from it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from torchrender.pipeline.options import RenderOptions

LEARNING = 0.5
"""Weight of the newest picture in a ratio."""

SLOWLY = 0.25
"""The same of a whole picture, in how far predictions are missed."""

FADING = 0.85
"""Power that a ratio takes with every picture which does not use its setting: one slow picture, as where kernels are
loaded for the first time, must not keep a setting out for good."""

LIMIT = 8.0
"""Largest correction of a prediction, up or down."""

LEAST_RAW_MS = 0.1
"""Shorter predictions teach nothing."""


MISSED, UNSURE, LATE = (f"logarithm of times over what was foreseen: {name}" for name in ("mean", "spread", "most"))
"""Quantities that a sequence learns about whole pictures."""

SPEED = "logarithm of times over what curves say: all passes together"
"""Quantity that a sequence learns: how fast this machine is today."""

SEARCHING = "milliseconds of searching"
"""Quantity that a sequence learns: what a picture pays for a search over all settings, and for sensing after it."""

FIRST_SEARCHING = 16.0
"""Before it is known."""

FIRST_UNSURE = 0.06
"""Before the first of them is known: times lie that far off, up or down."""

BESIDE = {name: f"milliseconds of {name}" for name in ("plan", "senses")}
"""Quantities that a picture tells the next one: what a budget pays beside the passes."""

MOST_MISSED = 0.4
"""What one picture counts for."""


def missed(known: Mapping[str, float], measured_ms: float, foreseen_ms: float) -> dict[str, float]:
    """What a sequence knows of how pictures miss their times, after another one."""
    if foreseen_ms <= 0.0 or measured_ms <= 0.0:
        return {}
    off = min(max(math.log(measured_ms / foreseen_ms), -MOST_MISSED), MOST_MISSED)
    before = known.get(MISSED, 0.0)
    mean = before + SLOWLY * (off - before)
    spread = (1.0 - SLOWLY) * known.get(UNSURE, FIRST_UNSURE) + SLOWLY * abs(off - before)
    return {MISSED: mean, UNSURE: spread, LATE: mean + 2.0 * spread}


@dataclass(frozen=True, eq=False, kw_only=True)
class Search:
    """What a search over all settings came to: the rest of the picture, and the next ones, stand by it for a while."""

    wishes: tuple[float | None, float | None]  # budget, error bound
    asked: RenderOptions  # before anything was chosen
    settings: Mapping[str, str]  # chosen, by pass
    possible: bool
    changes: tuple[str, ...]  # in words
    cost: tuple[float, float, float]  # expected milliseconds of what was to run, error, and most of it
    pictures: int = 0  # that stood by it
    later: Search | None = None  # the same for pictures that need not pay for a search

    def is_of(self, wishes: tuple[float | None, float | None], asked: RenderOptions) -> bool:
        """It was about the same."""
        return self.wishes == wishes and (asked is self.asked or _alike(asked, self.asked))


def _alike(first: Any, second: Any) -> bool:
    """Options are equal; colours may be tensors, of which only the same one is."""
    mine, other = dict(vars(first)), dict(vars(second))
    return mine.pop("background") is other.pop("background") and mine == other


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Ratios measured / predicted by pass and setting, and the settings that the last picture was made with."""

    ratios: Mapping[tuple[str, str], float] = field(default_factory=dict)
    choice: Mapping[str, str] = field(default_factory=dict)  # setting by pass
    known: Mapping[str, float] = field(default_factory=dict)  # quantities that the last pictures found out
    search: Search | None = field(default=None, compare=False)  # that the last picture was made by

    @property
    def search_ms(self) -> float:
        """What a search is expected to take, with the sensing after it, beyond what a picture without one pays."""
        usual = sum(self.known.get(name, 0.0) for name in BESIDE.values())
        return max(0.0, self.known.get(SEARCHING, FIRST_SEARCHING) - usual)

    @property
    def speed(self) -> float:
        """Ratio of all passes together, of those that no picture ran as of the others."""
        return math.exp(self.known.get(SPEED, 0.0))

    def ratio(self, name: str, setting: str) -> float:
        """Correction of a prediction: of this setting, else the mean of the pass's others, else that of all passes."""
        own = self.ratios.get((name, setting))
        if own is not None:
            return own
        others = [value for (known, _), value in self.ratios.items() if known == name]
        return sum(others) / len(others) if others else self.speed

    def aged(self, used: Collection[tuple[str, str]]) -> Pace:
        """After another picture: ratios of settings that it did not use fade towards that of all passes."""
        speed = self.speed
        kept = {k: ratio if k in used else speed * (ratio / speed) ** FADING for k, ratio in self.ratios.items()}
        return replace(self, ratios=kept)

    def hurried(self, measured_ms: float, raw_ms: float) -> dict[str, float]:
        """What is known of the speed after a picture whose passes took so long, by curves ``raw_ms``."""
        if raw_ms < LEAST_RAW_MS or measured_ms <= 0.0:
            return {}
        seen = math.log(min(max(measured_ms / raw_ms, 1 / LIMIT), LIMIT))
        old = self.known.get(SPEED)
        return {SPEED: seen if old is None else old + LEARNING * (seen - old)}

    def learned(self, name: str, setting: str, measured_ms: float, raw_ms: float) -> Pace:
        """With what a pass took where the uncorrected prediction was ``raw_ms``; too short ones teach nothing."""
        if raw_ms < LEAST_RAW_MS or measured_ms <= 0:
            return self
        seen = min(max(measured_ms / raw_ms, 1 / LIMIT), LIMIT)
        old = self.ratios.get((name, setting))
        ratio = seen if old is None else (1 - LEARNING) * old + LEARNING * seen
        return replace(self, ratios={**self.ratios, (name, setting): ratio})
