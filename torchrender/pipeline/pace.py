"""What the pictures of a sequence took so far, beside what was predicted: the next prediction learns from it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

LEARNING = 0.5
"""Weight of the newest picture in a ratio."""

FADING = 0.85
"""Power that a ratio takes with every picture which does not use its setting: one slow picture, as where kernels are
loaded for the first time, must not keep a setting out for good."""

LIMIT = 8.0
"""Largest correction of a prediction, up or down."""


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Ratios measured / predicted by pass and setting, and the settings that the last picture was made with."""

    ratios: Mapping[tuple[str, str], float] = field(default_factory=dict)
    choice: Mapping[str, str] = field(default_factory=dict)  # setting by pass
    known: Mapping[str, float] = field(default_factory=dict)  # quantities that the last pictures found out

    def ratio(self, name: str, setting: str) -> float:
        """Correction of a prediction: of this setting, else the mean of the pass's other settings, else 1."""
        own = self.ratios.get((name, setting))
        if own is not None:
            return own
        others = [value for (known, _), value in self.ratios.items() if known == name]
        return sum(others) / len(others) if others else 1.0

    def aged(self, used: Collection[tuple[str, str]]) -> Pace:
        """After another picture: ratios of settings that it did not use fade towards 1."""
        kept = {key: ratio if key in used else ratio**FADING for key, ratio in self.ratios.items()}
        return replace(self, ratios=kept)

    def learned(self, name: str, setting: str, measured_ms: float, raw_ms: float) -> Pace:
        """With what a pass took where the uncorrected prediction was ``raw_ms``; too short ones teach nothing."""
        if raw_ms < 0.1 or measured_ms <= 0:
            return self
        seen = min(max(measured_ms / raw_ms, 1 / LIMIT), LIMIT)
        old = self.ratios.get((name, setting))
        ratio = seen if old is None else (1 - LEARNING) * old + LEARNING * seen
        return replace(self, ratios={**self.ratios, (name, setting): ratio})
