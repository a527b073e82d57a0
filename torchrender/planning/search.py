"""The choice of settings for a budget or an error bound, over all passes of a picture at once.

Times, and errors to the power of a norm, add up but for a few bits (:mod:`torchrender.planning.problem`), so that
Pareto fronts can be folded pass by pass, one front for each state of the bits. Lagrange multipliers say beforehand how
little the rest of a partial choice can cost: what cannot win is dropped early, and the answer is that of an exhaustive
search.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from torchrender.passes.settings import Setting
from torchrender.pipeline.pace import TOLERANCE, Pace
from torchrender.planning.problem import VALID, Problem, problems
from torchrender.planning.question import Combination, Question

HEADROOM = 0.85
"""Share of a budget that predictions may fill before a sequence tells: pictures vary, and so does the machine."""

HEADROOMS = (0.75, 0.98)
"""Least and most of it."""

LOYALTY = 1.04
"""The last choice stays while nothing else is better by more than this factor."""

PRICES = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 19)])
"""Prices of one cost in the other, relative to their spreads, that bounds are taken from."""

ROUNDING = 1e-9
"""Relative difference below which two sums count as equal."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Settings by pass, and what is expected of them."""

    settings: Combination
    predicted_ms: float  # of the whole picture, what was spent included
    predicted_error: float
    possible: bool  # the wish can be met, by the predictions


@dataclass(frozen=True, eq=False)
class Found:
    """One combination."""

    problem: Problem
    names: Mapping[str, str]  # of its stages
    cost: tuple[float, float]  # time, error to the power of the norm


def choose(question: Question, budget_ms: float | None, max_error: float | None, spent_ms: float = 0.0) -> Choice:
    """The settings with the least error within the budget; without one, the quickest within the error bound.

    Where nothing meets the wish: the quickest for a budget, the most exact for an error bound.
    """
    norm, pool = question.knowledge.curves.norm, pool_of(question)
    time_limit = np.inf if budget_ms is None else headroom(question.knowledge.pace) * budget_ms - spent_ms
    error_limit = np.inf if max_error is None else max_error**norm
    found, possible = None, False
    if max_error is not None or budget_ms is None:
        # Both wishes: the quickest of those that meet both, else what the budget can give.
        found = best_of(pool, 0, error_limit)
        possible = found is not None and found.cost[0] <= time_limit * (1 + ROUNDING)
    if not possible and budget_ms is not None:
        found = best_of(pool, 1, time_limit)
        possible = found is not None and max_error is None
    if found is None:
        found = best_of(pool, 0 if budget_ms is not None else 1, np.inf)
        assert found is not None, "every problem has a combination"
    elif possible and (budget_ms is None or max_error is None):
        found = loyal(question, pool, found, (time_limit, error_limit), 1 if budget_ms is not None else 0)
    return choice_of(question, found, spent_ms, possible)


def choice_of(question: Question, found: Found, spent_ms: float, possible: bool) -> Choice:
    """A combination as what is chosen."""
    return Choice(
        settings=_combination(question, found),
        predicted_ms=found.cost[0] + spent_ms,
        predicted_error=max(found.cost[1], 0.0) ** (1.0 / question.knowledge.curves.norm),
        possible=possible,
    )


def fits(question: Question, budget_ms: float | None, choice: Choice) -> bool:
    """The choice is as quick as predictions within a budget have to be."""
    limit = np.inf if budget_ms is None else headroom(question.knowledge.pace) * budget_ms
    return choice.predicted_ms <= limit * (1 + ROUNDING)


def headroom(pace: Pace) -> float:
    """Share of a budget that predictions may fill, so that 19 of 20 pictures which miss them as those before did keep
    it within its tolerance."""
    over = pace.late
    return HEADROOM if over is None else min(max(TOLERANCE * math.exp(-over), HEADROOMS[0]), HEADROOMS[1])


def cost_of(question: Question, combination: Combination) -> tuple[float, float]:
    """Time, and error to the power of the norm, of one combination."""
    found = _at(pool_of(question), combination)
    assert found is not None, "of settings that are open"
    return found.cost


class Pool:
    """Problems by number of pixels, made when they are asked for: most numbers cannot win, by the first pass alone."""

    def __init__(self, question: Question) -> None:
        self.question = question
        first = question.first
        self.least = {
            count.name: (question.time_ms(first, count, count, True), question.error(first, count, count))
            for count in question.counts
        }
        self._made: dict[str, list[_Bounds]] = {}

    def at(self, count: Setting) -> list[_Bounds]:
        """Problems of a number of pixels, with their bounds."""
        if count.name not in self._made:
            self._made[count.name] = [_Bounds(problem) for problem in problems(self.question, count)]
        return self._made[count.name]


def pool_of(question: Question) -> Pool:
    """Made once a question."""
    return question.once("pool", lambda: Pool(question))


def _at(pool: Pool, combination: Combination) -> Found | None:
    """None where no problem has it: a pass does other work than when it was chosen."""
    for bounds in pool.at(pool.question.count_of(combination)):
        problem = bounds.problem
        cost = problem.cost(combination)
        if cost is not None:
            names = problem.settled | {s.name: combination.get(s.name, s.rows[0].name) for s in problem.stages}
            return Found(problem, names, cost)
    return None


class _Bounds:
    """What the rest of a partial choice costs at least, stage by stage: by itself, and for every price together."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        widest = max((len(stage.rows) for stage in problem.stages), default=1)
        rows = [[stage.least(row) for row in stage.rows] for stage in problem.stages]
        costs = np.array([row + [row[0]] * (widest - len(row)) for row in rows]).reshape(len(rows), widest, 2)
        self.alone = _rests(costs.min(axis=1))
        self.least = self.alone[0] + np.array([problem.least_time, problem.base[1]])
        spread = np.ptp(costs, axis=1).max(axis=0, initial=0.0)
        spread[spread == 0.0] = 1.0
        # Of time in errors where errors are the aim, of errors in time where time is.
        self.prices = (PRICES * (spread[0] / spread[1]), PRICES * (spread[1] / spread[0]))
        self.priced = tuple(
            _rests((costs[:, :, axis, None] + costs[:, :, 1 - axis, None] * self.prices[axis]).min(axis=1))
            for axis in range(2)
        )

    def best_price(self, axis: int, limit: float) -> tuple[int, float]:
        """The price that gives the highest lower bound of the answer, and that bound."""
        base = (self.problem.least_time, self.problem.base[1])
        values = self.priced[axis][0] + base[axis] + self.prices[axis] * (base[1 - axis] - limit)
        best = int(values.argmax())
        return best, float(values[best])


def _rests(least: np.ndarray) -> np.ndarray:
    """(P+1,...) sums of rows (P,...) from each place on."""
    nothing = np.zeros((1, *least.shape[1:]))
    return np.concatenate([least[::-1].cumsum(axis=0)[::-1], nothing])


def best_of(pool: Pool, axis: int, limit: float) -> Found | None:
    """The least time (0) or error (1) with no more than ``limit`` of the other; None if there is nothing."""
    best: Found | None = None
    left = in_order(pool, axis)
    while left:
        left, best = looked(pool, axis, limit, left, best)
    return best


def in_order(pool: Pool, axis: int) -> tuple[Setting, ...]:
    """Numbers of pixels, the first one that with which most may be won."""
    return tuple(sorted(pool.question.counts, key=lambda count: pool.least[count.name][axis]))


def looked(
    pool: Pool, axis: int, limit: float, left: tuple[Setting, ...], best: Found | None
) -> tuple[tuple[Setting, ...], Found | None]:
    """After the next number of pixels with which something may be won: those that are left, and the best so far."""
    allowed = limit + abs(limit) * ROUNDING if np.isfinite(limit) else np.inf
    for place, count in enumerate(left):
        least = pool.least[count.name]
        if best is not None and least[axis] > best.cost[axis] * (1 + ROUNDING):
            break
        if least[1 - axis] <= allowed:
            for bounds in pool.at(count):
                best = _better(bounds, axis, limit, best)
            return left[place + 1 :], best
    return (), best


def _better(bounds: _Bounds, axis: int, limit: float, best: Found | None) -> Found | None:
    """The best of a problem and of what was known before."""
    beaten = np.inf if best is None else best.cost[axis] * (1 + ROUNDING)
    finite = bool(np.isfinite(limit))
    if bounds.least[axis] > beaten or (finite and bounds.least[1 - axis] > limit + abs(limit) * ROUNDING):
        return best
    place, lower = bounds.best_price(axis, limit) if finite else (0, float(bounds.least[axis]))
    return _fold(bounds, axis, limit, place, best) if lower <= beaten else best


Entry = tuple[float, float, int, tuple[int, ...]]
"""A partial choice: the cost that is the aim, the other one, bits, and places of the rows."""


def _fold(bounds: _Bounds, axis: int, limit: float, place: int, best: Found | None) -> Found | None:
    """The best of a problem and of what was known before.

    Pareto fronts, one for each state of the bits, are folded stage by stage. A partial choice is dropped if even the
    cheapest rest leaves it over the limit or, by the price, over the best choice known.
    """
    problem, other = bounds.problem, 1 - axis
    allowed = limit + abs(limit) * ROUNDING if np.isfinite(limit) else np.inf
    beaten = np.inf if best is None else best.cost[axis] * (1 + ROUNDING) + 1e-300
    price = float(bounds.prices[axis][place])
    saved = problem.least_time - problem.base[0]  # not yet taken off: what later stages may save
    slack = (saved, 0.0) if axis == 0 else (0.0, saved)
    front: list[Entry] = [(problem.base[axis], problem.base[other], problem.start, ())]
    for number, stage in enumerate(problem.stages):
        own_rest = float(bounds.alone[number + 1][axis]) + slack[0]
        other_rest = float(bounds.alone[number + 1][other]) + slack[1]
        both_rest = float(bounds.priced[axis][number + 1][place]) + slack[0] + price * slack[1]
        cap = beaten + price * allowed if price > 0 and np.isfinite(allowed) else np.inf
        grown: list[Entry] = []
        for aim, rest, bits, places in front:
            for row_number, row in enumerate(stage.rows):
                time, error, after = problem.step(stage, row, bits)
                a, b = (aim + time, rest + error) if axis == 0 else (aim + error, rest + time)
                if b + other_rest <= allowed and a + own_rest <= beaten and a + price * b + both_rest <= cap:
                    grown.append((a, b, after & problem.live[number], (*places, row_number)))
        front = _pareto(grown)
    # The limit counts again here: what might have been saved may not have been.
    good = [entry for entry in front if entry[1] <= allowed and not (problem.must_break and entry[2] & VALID)]
    if not good:
        return best
    aim, rest, _, places = min(good, key=lambda entry: (float(f"{entry[0]:.12g}"), entry[1]))
    chosen = {stage.name: stage.rows[row].name for stage, row in zip(problem.stages, places, strict=True)}
    made = Found(problem, problem.settled | chosen, (aim, rest) if axis == 0 else (rest, aim))
    return made if best is None or _order(made, axis) < _order(best, axis) else best


def _pareto(entries: list[Entry]) -> list[Entry]:
    """Of every state of the bits, those that no other beats in both costs."""
    entries.sort()
    lowest: dict[int, float] = {}
    kept = []
    for entry in entries:
        if entry[1] < lowest.get(entry[2], np.inf):
            lowest[entry[2]] = entry[1]
            kept.append(entry)
    return kept


def _order(found: Found, axis: int) -> tuple[float, float]:
    """Sort key: of equal ones the least of the other."""
    return float(f"{found.cost[axis]:.12g}"), found.cost[1 - axis]


def loyal(question: Question, pool: Pool, found: Found, limits: tuple[float, float], axis: int) -> Found:
    """The last picture's choice, if it is allowed and about as good."""
    last = question.knowledge.pace.choice
    if not all(last.get(name) in {s.name for s in open_} for name, open_ in question.open.items()):
        return found
    kept = _at(pool, last)
    if kept is None:
        return found
    norm = question.knowledge.curves.norm if axis else 1.0
    good = kept.cost[axis] <= LOYALTY**norm * found.cost[axis] + (1e-6**norm if axis else 0.0)
    allowed = kept.cost[0] <= limits[0] and kept.cost[1] <= limits[1]
    return kept if good and allowed else found


def _combination(question: Question, found: Found) -> dict[str, str]:
    """The settings; passes that do not run keep theirs."""
    combination = {}
    for step in question.knowledge.passes:
        open_ = [setting.name for setting in question.open.get(step.name, ())]
        if step is question.first and open_:
            combination[step.name] = found.problem.count.name
        elif open_:
            current = step.settings.current(question.options)
            usual = current if current in open_ else open_[0]
            combination[step.name] = found.names.get(step.name, usual)
    return combination
