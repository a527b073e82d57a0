"""The choice of settings for a budget or an error bound, over all passes of a picture at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from torchrender.passes.load import Load
from torchrender.passes.table import Pass
from torchrender.pipeline.pace import Pace
from torchrender.planning.curves import Curves

HEADROOM = 0.85
"""Share of a budget that predictions may fill: pictures vary, and so does the machine."""

LOYALTY = 1.1
"""The last choice stays while nothing else is better by more than this factor."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Settings by pass, and what is expected of them."""

    settings: Mapping[str, str]
    predicted_ms: float  # of the whole picture, what was spent included
    predicted_error: float
    possible: bool  # the wish can be met, by the predictions


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is to decide. The first pass sets the number of pixels: ``loads`` has an entry for each setting of it."""

    passes: Sequence[Pass]  # that apply, the first with ``loads`` by its settings
    settings: Mapping[str, Sequence[str]]  # open ones by pass; one that is decided has a single entry
    loads: Mapping[str, Load]
    curves: Curves
    scene: str | None
    pace: Pace
    reusable: Mapping[str, str] | None  # settings that reuse needs to stay as they are; None: nothing to reuse yet


def choose(question: Question, budget_ms: float | None, max_error: float | None, spent_ms: float = 0.0) -> Choice:
    """The settings with the least error within the budget; without one, the quickest within the error bound.

    Where nothing meets the wish: the quickest for a budget, the most exact for an error bound.
    """
    names = [p.name for p in question.passes]
    open_ = [list(question.settings[name]) for name in names]
    times, errors = _tables(question, names, open_)
    norm = question.curves.norm
    error = errors ** (1.0 / norm)
    kept = _index(open_, names, question.pace.choice)
    if budget_ms is not None:
        allowed = times + spent_ms <= HEADROOM * budget_ms
        possible = bool(allowed.any())
        if possible and max_error is not None:
            good = allowed & (error <= max_error)
            # Both wishes: the quickest of those that meet both, else what the budget can give.
            best = _least(np.where(good, times, np.inf)) if good.any() else _best_within(allowed, error, times)
            possible = bool(good.any())
        elif possible:
            best = _best_within(allowed, error, times)
            if kept is not None and allowed[kept] and error[kept] <= LOYALTY * error[best] + 1e-6:
                best = kept
        else:
            best = _least(times)
    else:
        good = error <= (np.inf if max_error is None else max_error)
        possible = bool(good.any())
        best = _least(np.where(good, times, np.inf)) if possible else _best_within(times < np.inf, error, times)
        if possible and kept is not None and good[kept] and times[kept] <= LOYALTY * times[best]:
            best = kept
    chosen = {name: names_[i] for name, names_, i in zip(names, open_, best, strict=True)}
    return Choice(
        settings=chosen,
        predicted_ms=float(times[best]) + spent_ms,
        predicted_error=float(error[best]),
        possible=possible,
    )


def predicted_ms(question: Question, step: Pass, setting: str, load: Load) -> float | None:
    """Time of one pass at one setting; None if it was never measured."""
    amounts = step.work(load, step.knob.setting(setting))
    usual = question.curves.time_ms(step.name, setting, amounts, question.scene)
    return None if usual is None else usual * question.pace.ratio(step.name, setting)


def _tables(question: Question, names: Sequence[str], open_: Sequence[Sequence[str]]) -> tuple[np.ndarray, np.ndarray]:
    """Times, and errors to the power of the norm, of every combination: an axis per pass."""
    shape = tuple(len(settings) for settings in open_)
    times, errors = np.zeros(shape), np.zeros(shape)
    norm = question.curves.norm
    reuse_axis = names.index("reflection_reuse") if "reflection_reuse" in names else None
    for axis, step in enumerate(question.passes):
        table = np.zeros((shape[0], shape[axis]))
        for row, first in enumerate(open_[0]):
            for column, setting in enumerate(open_[axis]):
                table[row, column] = predicted_ms(question, step, setting, question.loads[first]) or 0.0
        cost = _spread(table, axis, len(shape)) if axis else _along(table.diagonal(), 0, len(shape))
        mistakes = np.array([setting_error(question, step, s) ** norm for s in open_[axis]])
        shown = _along(mistakes, axis, len(shape))
        errors = errors + (shown * ~_hidden(step, names, open_) if step.hidden_by else shown)
        if step.name == "reflections" and reuse_axis is not None:
            cost = np.broadcast_to(cost, shape) * ~_reused(question, names, open_)
        elif axis == reuse_axis:
            cost = np.broadcast_to(cost, shape) * _reused(question, names, open_)
        times = times + cost
    return times, errors


def _along(values: np.ndarray, axis: int, dimensions: int) -> np.ndarray:
    """Values of one pass's settings along its axis of all combinations."""
    return values.reshape(*[1] * axis, -1, *[1] * (dimensions - axis - 1))


def _spread(table: np.ndarray, axis: int, dimensions: int) -> np.ndarray:
    """A table (first pass, this pass) along the axes of all combinations."""
    shape = [1] * dimensions
    shape[0], shape[axis] = table.shape
    return table.reshape(shape)


def _hidden(step: Pass, names: Sequence[str], open_: Sequence[Sequence[str]]) -> np.ndarray:
    """Combinations in which the pass's settings do not show."""
    mask = np.ones([len(s) for s in open_], bool)
    for axis, name in enumerate(names):
        if name in step.hidden_by:
            hides = np.array([s in step.hidden_by[name] for s in open_[axis]])
            mask = mask & _along(hides, axis, len(open_))
    return mask


def _reused(question: Question, names: Sequence[str], open_: Sequence[Sequence[str]]) -> np.ndarray:
    """Combinations whose reflections come out of the key frame: as it was made, and reuse not off."""
    mask = np.full([len(s) for s in open_], question.reusable is not None)
    for axis, name in enumerate(names):
        if name == "reflection_reuse":
            fits = np.array([s != "off" for s in open_[axis]])
        elif question.reusable is not None and name in question.reusable:
            fits = np.array([s == question.reusable[name] for s in open_[axis]])
        else:
            continue
        mask = mask & _along(fits, axis, len(open_))
    return mask


def setting_error(question: Question, step: Pass, setting: str) -> float:
    """Error of a setting; where settings are compared in a context of their own, beyond the best of them."""
    found = question.curves.error(step.name, setting, question.scene)
    if not step.knob.context.changes:
        return found
    best = min(question.curves.error(step.name, s, question.scene) for s in step.knob.names)
    return max(found - best, 0.0)


def _index(open_: Sequence[Sequence[str]], names: Sequence[str], choice: Mapping[str, str]) -> tuple[int, ...] | None:
    """Place of the last choice among the combinations; None if it is not there."""
    if not all(choice.get(name) in settings for name, settings in zip(names, open_, strict=True)):
        return None
    return tuple(list(settings).index(choice[name]) for name, settings in zip(names, open_, strict=True))


def _least(values: np.ndarray) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(int(values.argmin()), values.shape))


def _best_within(allowed: np.ndarray, error: np.ndarray, times: np.ndarray) -> tuple[int, ...]:
    """The allowed combination with the least error, and of equal ones the quickest."""
    least = np.where(allowed, error, np.inf).min()
    return _least(np.where(allowed & (error <= least * (1 + 1e-9) + 1e-12), times, np.inf))
