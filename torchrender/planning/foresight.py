"""What errors are expected where nobody measured them: of a scene that calibration never saw.

A setting's error is, on a logarithmic scale, a line over what the pass *senses* in a picture of the scene (how much
detail there is, how much of the light is hidden, ...), fitted to built-in and random scenes; before a first picture it
is their mean. Either comes with a spread, so that a bound can be kept on the safe side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

LEAST, LEAST_SENSED = 3e-4, 1e-4
"""Errors, and what is sensed, below this count as this: nobody sees it, and logarithms of zero mean nothing."""

TO_HOLD = 0.9
"""Share of pictures that intervals hold."""

COVERED = 1.645
"""Standard deviations either way that hold as many."""

LEAST_TAIL = 0.5
"""Pictures that happen to lie closer than this many standard deviations are luck."""


class Expected(NamedTuple):
    """An error, and the standard deviation of its natural logarithm."""

    error: float
    spread: float
    below: float = COVERED  # standard deviations down
    above: float = COVERED  # and up that hold nine of ten

    @property
    def interval(self) -> tuple[float, float]:
        """Holds nine of ten."""
        least, most = self.error * math.exp(-self.below * self.spread), self.error * math.exp(self.above * self.spread)
        return least, min(most, 1.0)


class Joint(NamedTuple):
    """How errors of whole pictures of scenes that nobody measured lie about what their passes add up to."""

    factor: float = 1.0  # their median,
    below: float = COVERED  # and how far nine of ten lie from that,
    above: float = COVERED  # in standard deviations of the prediction


def parse_joint(told: Any) -> Joint:
    """From JSON: factor and tails, or the factor alone.

    Raises:
        ValueError: numbers out of range.
    """
    joint = Joint(*(float(value) for value in (told if isinstance(told, list) else [told])))
    if not 0.25 <= joint.factor <= 4.0:
        raise ValueError(f"joint: factor must be in [0.25, 4], got {joint.factor}")
    if not (0.0 < joint.below <= 10.0 and 0.0 < joint.above <= 10.0):
        raise ValueError(f"joint: tails must be in (0, 10], got {joint.below} and {joint.above}")
    return joint


def joint_of_pictures(pictures: Sequence[tuple[float, Expected]]) -> Joint:
    """Of errors of pictures, each with what its passes added up to; fewer than ten say nothing about tails.

    Of pictures whose scenes were not fitted to, the tails hold nine of ten of those to come (split conformal).
    """
    if not pictures:
        return Joint()
    ratios = np.array([math.log(max(error, LEAST) / max(told.error, LEAST)) for error, told in pictures])
    middle = float(np.median(ratios))
    if len(pictures) < 10:
        return Joint(math.exp(middle))
    off = np.sort((ratios - middle) / np.array([told.spread for _, told in pictures]))
    outside = max(int((1.0 - TO_HOLD) / 2.0 * (len(off) + 1)), 1)  # on either side, of these and the next one
    return Joint(math.exp(middle), max(-float(off[outside - 1]), LEAST_TAIL), max(float(off[-outside]), LEAST_TAIL))


@dataclass(frozen=True)
class Line:
    """Logarithm of an error over that of what is sensed."""

    usual: float  # logarithm of the mean error of all scenes,
    spread: float  # and standard deviation of the logarithms: before anything is sensed
    at: float  # mean logarithm of what is sensed,
    mean: float  # and of the errors
    slope: float
    left: float  # standard deviation about the line

    def expected(self, sensed: float | None) -> Expected:
        """The error where the pass senses so much; None: it is not known."""
        if sensed is None:
            return Expected(math.exp(self.usual), self.spread)
        value = self.mean + self.slope * (math.log(max(sensed, LEAST_SENSED)) - self.at)
        return Expected(min(math.exp(value), 1.0), self.left)

    def to_list(self) -> list[float]:
        """For JSON."""
        return [float(f"{value:.4g}") for value in (self.usual, self.spread, self.at, self.mean, self.slope, self.left)]


def fitted(errors: Sequence[float], sensed: Sequence[float]) -> Line:
    """The line through pairs of errors and what was sensed, with the mean for who has sensed nothing.

    Slopes are held in [0, 1.5]: more to be seen never means less error. Spreads are those of pairs left out one by one.
    """
    known = np.maximum(np.asarray(errors, float), LEAST)
    logs, usual = np.log(known), float(np.log(known.mean()))
    at = np.log(np.maximum(np.asarray(sensed, float), LEAST_SENSED))
    centred = at - at.mean()
    square = float((centred**2).sum())
    slope = min(max(float((centred * (logs - logs.mean())).sum()) / square, 0.0), 1.5) if square > 1e-9 else 0.0
    count = len(logs)
    middle = float(at.mean()), float(logs.mean())
    if count < 4:
        return Line(usual, 1.0, *middle, slope, 1.0)
    # Of pairs that the fit did not see: its residuals over what the fit leaves free.
    free = (1.0 - 1.0 / count - centred**2 / max(square, 1e-9)).clip(0.05)
    left = (logs - logs.mean() - slope * centred) / free
    spread = (logs - usual) * count / (count - 1)
    return Line(usual, float(np.sqrt(np.mean(spread**2))), *middle, slope, float(np.sqrt(np.mean(left**2))))


def together(expected: Iterable[Expected], norm: float, joint: float) -> Expected:
    """The error of a picture whose passes have these, independent of each other.

    Args:
        norm: exponent with which they add up.
        joint: spread of that sum itself.
    """
    parts = [part for part in expected if part.error > 0.0]
    powers = np.array([part.error for part in parts]) ** norm
    total = float(powers.sum())
    if total <= 0.0:
        return Expected(0.0, joint)
    shares = powers / total
    square = float(np.sum((shares * np.array([part.spread for part in parts])) ** 2))
    return Expected(total ** (1.0 / norm), math.sqrt(square + joint**2))


def parse_lines(data: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Line]]:
    """Lines by pass and setting.

    Raises:
        ValueError: numbers that are not finite, or negative spreads.
    """
    found: dict[str, dict[str, Line]] = {}
    for name, settings in data.items():
        for setting, values in settings.items():
            line = Line(*(float(value) for value in values))
            if not all(math.isfinite(value) for value in line.to_list()):
                raise ValueError(f"foresight of {name}, {setting} must be finite")
            if min(line.spread, line.left, line.slope) < 0:
                raise ValueError(f"foresight of {name}, {setting}: spreads and slopes must not be negative")
            found.setdefault(name, {})[setting] = line
    return found
