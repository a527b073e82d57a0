"""What the pictures of a sequence took so far, beside what was predicted: the next prediction learns from it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.options import RenderOptions

LEARNING = 0.5
"""Weight of the newest picture in what is known of the machine's speed."""

RECENT = 3
"""Times of a setting that are kept. Their lower median is its ratio: one picture that something else held up moves it
only where nothing else is known, and two in a row do."""

FADING, SURELY = 0.85, 0.98
"""Powers that a ratio takes with every picture which does not use its setting, where one picture told it and where
several did: one slow picture, as where kernels are loaded for the first time, must not keep a setting out for good."""

UNTRIED = 1.25
"""Times by which a setting that no picture of a sequence ran counts longer, it may be that far off: where the one late
picture of ``MISSES`` has been."""

LIMIT = 8.0
"""Largest correction of a prediction, up or down."""

LEAST_RAW_MS = 0.1
"""Shorter predictions teach nothing."""


SPEED = "logarithm of times over what curves say: all passes together"
"""Quantity that a sequence learns: how fast this machine is today."""

SEARCHING = "milliseconds of searching"
"""Quantity that a sequence learns: what a picture pays for a search over all settings, and for sensing after it."""

FIRST_SEARCHING = 16.0
"""Before it is known."""

BESIDE = {name: f"milliseconds of {name}" for name in ("plan", "senses")}
"""Quantities that a picture tells the next one: what a budget pays beside the passes."""

FIRST_BESIDE = {"plan": 4.0, "senses": 16.0}
"""Milliseconds of them, at most, that pictures tell which load much for them: of the plan the first one."""

REPEATING, FIRST_REPEATING = "milliseconds of a plan that is repeated", 0.5
"""Quantity that a sequence learns: the plan of a picture that is made as the last one was; and before it is known."""

LOOKS = 4
"""Of so many pictures that stand by one choice the last one senses: what errors follow changes with the view."""

UNPRICED, LAST_UNPRICED = (f"milliseconds that no curve prices: {name}" for name in ("usual", "last"))
"""Quantities that a sequence learns: of passes that have nothing to do by their amounts, and between passes."""

FIRST_UNPRICED = 2.0
"""The most of it that a first picture after another one is believed."""

MOST_MISSED = 0.4
"""Logarithm of a time over what was foreseen: pictures later than that are late at any headroom, and say nothing about
how much of it the others need. It is also the most that one picture moves the speed by."""

TOLERANCE = 1.1
"""A budget counts as kept up to so many times its time."""

MISSES = 20
"""Pictures of a sequence whose misses are kept: one of them may be late, and 19 are to be in time."""

EXPECTED_MISSES = tuple(
    sorted((NormalDist(0.0, 0.08).inv_cdf((k + 0.5) / MISSES) for k in range(MISSES)), key=lambda off: -abs(off))
)
"""Stand-ins for misses of pictures that are still to come: the first picture replaces the farthest."""


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
    earlier: Search | None = None  # by which pictures stood before this one
    quicker: Search | None = None  # the same for much less time
    ahead: tuple[Buffer[Any], ...] = ()  # that last, made for pictures to come by the first that stands by it

    @property
    def tried(self) -> Search | None:
        """What to go back to from another one: this, where pictures stood by it, else what they stood by before."""
        return replace(self, earlier=None) if self.pictures and self.possible else self.earlier

    @property
    def quickly(self) -> list[Search]:
        """The same for less and less time."""
        return [] if self.quicker is None else [self.quicker, *self.quicker.quickly]

    def is_of(self, wishes: tuple[float | None, float | None], asked: RenderOptions) -> bool:
        """It was about the same."""
        return self.wishes == wishes and (asked is self.asked or alike(asked, self.asked))


def looks(stood: int) -> bool:
    """A picture senses: it is made by a new choice, or that many stood by its choice, with it."""
    return stood == 0 or stood % LOOKS == LOOKS - 1


def alike(first: Any, second: Any) -> bool:
    """Options are equal; colours may be tensors, of which only the same one is."""
    mine, other = dict(vars(first)), dict(vars(second))
    return mine.pop("background") is other.pop("background") and mine == other


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Ratios measured / predicted by pass and setting, and the settings that the last picture was made with."""

    ratios: Mapping[tuple[str, str], float] = field(default_factory=dict)
    recent: Mapping[tuple[str, str], tuple[float, ...]] = field(default_factory=dict)  # that ratios were made of
    misses: tuple[float, ...] = ()  # logarithms of pictures' times over what was foreseen, the newest last
    wary: int = 0  # pictures to come that try nothing which may make them late
    choice: Mapping[str, str] = field(default_factory=dict)  # setting by pass
    known: Mapping[str, float] = field(default_factory=dict)  # quantities that the last pictures found out
    search: Search | None = field(default=None, compare=False)  # that the last picture was made by
    hunt: object = field(default=None, compare=False)  # another one that has begun (:mod:`torchrender.planning.ahead`)
    repeated: object = field(default=None, compare=False)  # plans for one like it (planning.repeated)

    def beside(self, looking: bool, repeats: bool = False) -> dict[str, float]:
        """Milliseconds, by name, that a picture which makes no search is expected to pay beside its passes; of sensing
        if it is ``looking``, and of the plan less where it ``repeats`` the last one's."""
        found = {name: self.known.get(known, 0.0) for name, known in BESIDE.items() if looking or name != "senses"}
        return found | {"plan": self.known.get(REPEATING, FIRST_REPEATING)} if repeats else found

    @property
    def looks_next(self) -> bool:
        """A picture senses that stands by the last choice, too."""
        return self.search is None or looks(self.search.pictures + 1)

    @property
    def search_ms(self) -> float:
        """What a search is expected to take, with the sensing after it, beyond what a picture without one pays."""
        usual = sum(self.beside(self.looks_next).values())
        return max(0.0, self.known.get(SEARCHING, FIRST_SEARCHING) - usual)

    @property
    def speed(self) -> float:
        """Ratio of all passes together, of those that no picture ran as of the others."""
        return math.exp(self.known.get(SPEED, 0.0))

    @property
    def late(self) -> float | None:
        """How far one of ``MISSES`` pictures misses its time, as a logarithm; None before any is known."""
        if not self.misses:
            return None
        return sorted((*self.misses, *EXPECTED_MISSES[len(self.misses) :]))[-2]

    def missed(self, measured_ms: float, foreseen_ms: float) -> Pace:
        """After a picture that took so long, beside what its choice was made by."""
        if foreseen_ms <= 0.0 or measured_ms <= 0.0:
            return self
        off = math.log(measured_ms / foreseen_ms)
        if off > MOST_MISSED:
            return self
        return replace(self, misses=(*self.misses, off)[-MISSES:])

    def warned(self, measured_ms: float, budget_ms: float | None) -> Pace:
        """After a picture that took so long of a budget: one that was late is one of ``MISSES``."""
        late = budget_ms is not None and measured_ms > TOLERANCE * budget_ms
        return replace(self, wary=MISSES if late else max(self.wary - 1, 0))

    def doubt(self, name: str, setting: str, own: float = 1.0) -> float:
        """Times by which a prediction is taken to be longer where a budget has to be kept: after a late picture, and
        before any tells how far predictions are missed.

        Args:
            own: the same, before a picture ran the setting, for this pass in any case.
        """
        if not (self.wary or self.ratios) or (name, setting) in self.ratios:
            return 1.0
        return max(own if self.ratios else 1.0, UNTRIED if self.wary or not self.misses else 1.0)

    def ratio(self, name: str, setting: str) -> float:
        """Correction of a prediction: of this setting, else the mean of the pass's others, else that of all passes.

        Where the others were quicker than all passes together, half of that: a small map drawn in no time says little
        about a large one.
        """
        own = self.ratios.get((name, setting))
        if own is not None:
            return own
        others = [value for (known, _), value in self.ratios.items() if known == name]
        if not others:
            return self.speed
        mean = sum(others) / len(others)
        return max(mean, math.sqrt(mean * self.speed))

    def aged(self, used: Collection[tuple[str, str]]) -> Pace:
        """After another picture: ratios of settings that it did not use fade towards that of all passes."""
        speed, kept = self.speed, dict(self.ratios)
        for key, ratio in self.ratios.items():
            if key not in used:
                kept[key] = speed * (ratio / speed) ** (SURELY if len(self.recent.get(key, ())) > 1 else FADING)
        return replace(self, ratios=kept)

    def hurried(self, measured_ms: float, raw_ms: float) -> dict[str, float]:
        """What is known of the speed after a picture whose passes took so long, by curves ``raw_ms``."""
        if raw_ms < LEAST_RAW_MS or measured_ms <= 0.0:
            return {}
        seen = math.log(min(max(measured_ms / raw_ms, 1 / LIMIT), LIMIT))
        old = self.known.get(SPEED)
        return {SPEED: seen if old is None else old + LEARNING * min(max(seen - old, -MOST_MISSED), MOST_MISSED)}

    def learned_all(self, times: Mapping[tuple[str, str], tuple[float, float]]) -> Pace:
        """With what the passes of a picture took, by pass and setting, each beside its uncorrected prediction.

        Where those that ran before took longer than they did then, all together, something else held the picture up:
        what ran for the first time counts as that much quicker, for nothing else is known of it.
        """
        before = [(ms, raw * self.ratios[key]) for key, (ms, raw) in times.items() if key in self.ratios]
        took, told = sum(ms for ms, _ in before), sum(foreseen for _, foreseen in before)
        held_up = max(took / told, 1.0) if told > LEAST_RAW_MS else 1.0
        pace = self
        for (name, setting), (ms, raw) in times.items():
            pace = pace.learned(name, setting, ms if (name, setting) in self.ratios else ms / held_up, raw)
        return pace

    def learned(self, name: str, setting: str, measured_ms: float, raw_ms: float) -> Pace:
        """With what a pass took where the uncorrected prediction was ``raw_ms``; too short ones teach nothing."""
        if raw_ms < LEAST_RAW_MS or measured_ms <= 0:
            return self
        seen = min(max(measured_ms / raw_ms, 1 / LIMIT), LIMIT)
        times = (*self.recent.get((name, setting), ()), seen)[-RECENT:]
        ratio = sorted(times)[(len(times) - 1) // 2]
        return replace(
            self,
            ratios={**self.ratios, (name, setting): ratio},
            recent={**self.recent, (name, setting): times},
        )
