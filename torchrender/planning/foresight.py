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
    slope: float = 0.0  # power of the picture's pixels per rendered one and side, by which the median grows

    def at(self, supersample: float) -> Joint:
        """Of pictures with so many rendered pixels per pixel and side."""
        return self._replace(factor=self.factor * supersample**-self.slope, slope=0.0) if self.slope else self


class Whole(NamedTuple):
    """A whole picture: its error, and what its passes add up to."""

    error: float
    told: Expected
    supersample: float = 1.0
    scene: int | None = None  # that others show, too; None: no other does


def parse_joint(told: Any) -> Joint:
    """From JSON: factor, tails and slope, or the first of them.

    Raises:
        ValueError: numbers out of range.
    """
    joint = Joint(*(float(value) for value in (told if isinstance(told, list) else [told])))
    if not 0.25 <= joint.factor <= 4.0:
        raise ValueError(f"joint: factor must be in [0.25, 4], got {joint.factor}")
    if not (0.0 < joint.below <= 10.0 and 0.0 < joint.above <= 10.0):
        raise ValueError(f"joint: tails must be in (0, 10], got {joint.below} and {joint.above}")
    if not 0.0 <= joint.slope <= 1.0:
        raise ValueError(f"joint: slope must be in [0, 1], got {joint.slope}")
    return joint


def joint_of_pictures(pictures: Sequence[Whole]) -> Joint:
    """Of pictures with what their passes added up to; fewer than ten say nothing about tails.

    Of pictures whose scenes were not fitted to, the tails hold nine of ten of those to come (split conformal); where
    several show one scene, nine of ten of each scene by those of the others.
    """
    if not pictures:
        return Joint()
    median, slope = _median(pictures)
    if len(pictures) < 10:
        return Joint(math.exp(median), slope=slope)
    outside = max(int((1.0 - TO_HOLD) / 2.0 * (len(pictures) + 1)), 1)  # on either side, of these and the next one
    scenes = {one.scene for one in pictures if one.scene is not None}
    while outside > 1 and scenes and _held(pictures, scenes, outside) < TO_HOLD:
        outside -= 1
    below, above = _tails(pictures, (median, slope), outside)
    return Joint(math.exp(median), below, above, slope)


def _ratios(pictures: Sequence[Whole], slope: float) -> np.ndarray:
    """Logarithms (N,) of errors over what is expected of them, but for the median."""
    told = [math.log(max(one.error, LEAST) / max(one.told.error, LEAST)) for one in pictures]
    return np.array(told) + slope * np.log([one.supersample for one in pictures])


def _median(pictures: Sequence[Whole]) -> tuple[float, float]:
    """The median logarithm, and the slope over that of pixels per rendered one."""
    finer, slope = -np.log([one.supersample for one in pictures]), 0.0
    if np.ptp(finer) > 0.1:
        slope = min(max(float(np.polyfit(finer, _ratios(pictures, 0.0), 1)[0]), 0.0), 1.0)
    return float(np.median(_ratios(pictures, slope))), slope


def _tails(pictures: Sequence[Whole], line: tuple[float, float], outside: int) -> tuple[float, float]:
    """Standard deviations down and up beyond which so many pictures lie, that number included."""
    spreads = np.array([one.told.spread for one in pictures])
    off = np.sort((_ratios(pictures, line[1]) - line[0]) / spreads)
    return max(-float(off[outside - 1]), LEAST_TAIL), max(float(off[-outside]), LEAST_TAIL)


def _held(pictures: Sequence[Whole], scenes: Iterable[int], outside: int) -> float:
    """Share of the pictures that lie within the tails of those of other scenes."""
    held = []
    for scene in scenes:
        own = [one for one in pictures if one.scene == scene]
        others = [one for one in pictures if one.scene != scene]
        line = _median(others)
        below, above = _tails(others, line, outside)
        off = (_ratios(own, line[1]) - line[0]) / np.array([one.told.spread for one in own])
        held += ((-below <= off) & (off <= above)).tolist()
    return float(np.mean(held))


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
