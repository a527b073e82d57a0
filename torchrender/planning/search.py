"""The choice of settings for a budget or an error bound, over all passes of a picture at once.

Inside a mode (:mod:`torchrender.planning.question`) times and errors add up, so that Pareto fronts can be folded pass
by pass. Lagrange multipliers say beforehand which modes cannot hold the answer, and in the others which partial choices
cannot: what is left to fold is small, and the answer is that of an exhaustive search.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from torchrender.passes.settings import Setting
from torchrender.planning.question import Combination, Mode, Question

HEADROOM = 0.85
"""Share of a budget that predictions may fill: pictures vary, and so does the machine."""

LOYALTY = 1.1
"""The last choice stays while nothing else is better by more than this factor."""

MULTIPLIERS = 24
"""Prices of time in errors, or of errors in time, that bounds are taken from."""

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
class Part:
    """A mode at one number of pixels: independent settings of P passes, whose costs add up."""

    count: Setting
    mode: Mode
    base: tuple[float, float]  # time and error of what is settled
    names: tuple[str, ...]  # of the P passes
    settings: tuple[tuple[str, ...], ...]
    costs: tuple[np.ndarray, ...]  # of each pass (S,2): times, and errors to the power of the norm
    leasts: tuple[float, float]  # sums of times and errors that no choice is below

    def least(self, axis: int) -> float:
        """The least sum of times (0) or errors (1)."""
        return self.leasts[axis]


@dataclass(frozen=True, eq=False)
class Found:
    """One combination."""

    part: Part
    places: tuple[int, ...]
    cost: tuple[float, float]


def choose(question: Question, budget_ms: float | None, max_error: float | None, spent_ms: float = 0.0) -> Choice:
    """The settings with the least error within the budget; without one, the quickest within the error bound.

    Where nothing meets the wish: the quickest for a budget, the most exact for an error bound.
    """
    norm = question.knowledge.curves.norm
    parts = [_part(question, mode, count) for mode in question.modes() for count in question.counts]
    time_limit = np.inf if budget_ms is None else HEADROOM * budget_ms - spent_ms
    error_limit = np.inf if max_error is None else max_error**norm
    found, possible = None, False
    if max_error is not None or budget_ms is None:
        # Both wishes: the quickest of those that meet both, else what the budget can give.
        found = _best(parts, 0, error_limit)
        possible = found is not None and found.cost[0] <= time_limit * (1 + ROUNDING)
    if not possible and budget_ms is not None:
        found = _best(parts, 1, time_limit)
        possible = found is not None and max_error is None
    if found is None:
        found = _cheapest(parts, 0 if budget_ms is not None else 1)
    elif possible and (budget_ms is None or max_error is None):
        found = _loyal(question, found, (time_limit, error_limit), 1 if budget_ms is not None else 0)
    time, error = found.cost
    return Choice(
        settings=_combination(question, found),
        predicted_ms=time + spent_ms,
        predicted_error=max(error, 0.0) ** (1.0 / norm),
        possible=possible,
    )


def cost_of(question: Question, combination: Combination) -> tuple[float, float]:
    """Time, and error to the power of the norm, of one combination."""
    count = next(c for c in question.counts if c.name == combination.get(question.knowledge.passes[0].name, c.name))
    mode = question.mode_of(combination)
    time, error = 0.0, 0.0
    for step in mode.running:
        setting = combination.get(step.name, mode.classes[step.name].settings[0])
        time += question.time_ms(step, setting, count, step.name in mode.fresh)
        error += question.error(step, setting, count) if step.name in mode.seen else 0.0
    return time, error


def _part(question: Question, mode: Mode, count: Setting) -> Part:
    first = question.knowledge.passes[0].name
    base, leasts, names, settings, costs = [0.0, 0.0], [0.0, 0.0], [], [], []
    for step in mode.running:
        own = (count.name,) if step.name == first else mode.classes[step.name].settings
        fresh, seen = step.name in mode.fresh, step.name in mode.seen
        rows = [(question.time_ms(step, s, count, fresh), question.error(step, s, count) if seen else 0.0) for s in own]
        leasts = [leasts[k] + min(row[k] for row in rows) for k in range(2)]
        if len(rows) == 1:
            base[0], base[1] = base[0] + rows[0][0], base[1] + rows[0][1]
        else:
            names.append(step.name)
            settings.append(own)
            costs.append(np.array(rows))
    pair = (base[0], base[1]), (leasts[0], leasts[1])
    return Part(count, mode, pair[0], tuple(names), tuple(settings), tuple(costs), pair[1])


def _best(parts: list[Part], axis: int, limit: float) -> Found | None:
    """The least time (0) or error (1) with no more than ``limit`` of the other; None if there is nothing."""
    other = 1 - axis
    open_ = [part for part in parts if part.least(other) <= limit * (1 + ROUNDING)]
    if not open_:
        return None
    best: Found | None = None
    for part in sorted(open_, key=lambda part: part.least(axis)):
        if best is not None and part.least(axis) > best.cost[axis] * (1 + ROUNDING):
            break
        bound, price, found = _bound(part, axis, limit)
        best = _better(best, found, axis)
        if best is None or bound <= best.cost[axis] * (1 + ROUNDING):
            best = _better(best, _fold(part, axis, limit, price, best), axis)
    return best


def _better(first: Found | None, second: Found | None, axis: int) -> Found | None:
    if first is None or second is None:
        return second if first is None else first
    return second if _order(second, axis) < _order(first, axis) else first


def _order(found: Found, axis: int) -> tuple[float, float]:
    """Sort key: of equal ones the least of the other."""
    return float(f"{found.cost[axis]:.12g}"), found.cost[1 - axis]


def _bound(part: Part, axis: int, limit: float) -> tuple[float, float, Found | None]:
    """A lower bound of the answer, the price of the other cost that gives it, and the best choice met on the way."""
    other = 1 - axis
    if not part.costs:
        return part.base[axis], 0.0, Found(part, (), part.base)
    if not np.isfinite(limit):
        quickest = _at(part, tuple(int(np.lexsort((cost[:, other], cost[:, axis]))[0]) for cost in part.costs))
        return quickest.cost[axis], 0.0, quickest
    spread = [np.ptp(cost, axis=0) for cost in part.costs]
    large = max(float(s[axis]) for s in spread) or 1.0
    small = max(float(s[other]) for s in spread) or 1.0
    prices = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, MULTIPLIERS) * large / small])
    bound = np.full(len(prices), part.base[axis]) + prices * (part.base[other] - limit)
    places = np.zeros((len(prices), len(part.costs)), int)
    sums = np.full((len(prices), 2), part.base)
    for number, cost in enumerate(part.costs):
        priced = cost[:, axis][None] + prices[:, None] * cost[:, other][None]
        places[:, number] = priced.argmin(axis=1)
        bound += priced[np.arange(len(prices)), places[:, number]]
        sums += cost[places[:, number]]
    best = int(bound.argmax())
    fits = sums[:, other] <= limit * (1 + ROUNDING)
    found = None
    if fits.any():
        rows = np.where(fits, sums[:, axis], np.inf)
        found = _at(part, tuple(int(n) for n in places[int(rows.argmin())]))
    return float(bound[best]), float(prices[best]), found


def _at(part: Part, places: tuple[int, ...]) -> Found:
    total = np.array(part.base)
    for cost, place in zip(part.costs, places, strict=True):
        total = total + cost[place]
    return Found(part, places, (float(total[0]), float(total[1])))


def _fold(part: Part, axis: int, limit: float, price: float, best: Found | None) -> Found | None:
    """The best choice of a part, by Pareto fronts folded pass by pass; None if none is better than ``best``.

    A partial choice is dropped if another one is no worse in both costs, or if even the cheapest rest leaves it over
    the limit or, by the price, over the best choice known.
    """
    other = 1 - axis
    slack = 1 + ROUNDING
    allowed = limit * slack
    beaten = np.inf if best is None else best.cost[axis] * slack + 1e-300
    rest_other = _rest([float(cost[:, other].min()) for cost in part.costs])
    rest_own = _rest([float(cost[:, axis].min()) for cost in part.costs])
    rest_both = _rest([float((cost[:, axis] + price * cost[:, other]).min()) for cost in part.costs])
    cap = beaten + price * allowed if price > 0 else np.inf
    front: list[tuple[float, float, tuple[int, ...]]] = [(part.base[axis], part.base[other], ())]
    for number, cost in enumerate(part.costs):
        rows = [(float(row[axis]), float(row[other])) for row in cost]
        grown = []
        for own, foreign, places in front:
            for place, (a, b) in enumerate(rows):
                mine, theirs = own + a, foreign + b
                if (
                    theirs + rest_other[number] <= allowed
                    and mine + rest_own[number] <= beaten
                    and mine + price * theirs + rest_both[number] <= cap
                ):
                    grown.append((mine, theirs, (*places, place)))
        grown.sort(key=lambda entry: entry[:2])
        front, lowest = [], np.inf
        for entry in grown:
            if entry[1] < lowest:
                front.append(entry)
                lowest = entry[1]
    return _at(part, front[0][2]) if front else None


def _rest(least: list[float]) -> list[float]:
    """Sums of what comes after each place."""
    sums, total = [], 0.0
    for value in reversed(least):
        sums.append(total)
        total += value
    return sums[::-1]


def _cheapest(parts: list[Part], axis: int) -> Found:
    """The least of one cost, and of equal ones the least of the other."""
    found = [_bound(part, axis, np.inf)[2] for part in parts]
    return min((one for one in found if one is not None), key=lambda one: _order(one, axis))


def _loyal(question: Question, found: Found, limits: tuple[float, float], axis: int) -> Found:
    """The last picture's choice, if it is allowed and about as good."""
    last: Mapping[str, str] = question.knowledge.pace.choice
    if not all(last.get(name) in {s.name for s in open_} for name, open_ in question.open.items()):
        return found
    cost = cost_of(question, {name: last[name] for name in question.open})
    factor = LOYALTY ** (question.knowledge.curves.norm if axis else 1.0)
    good = cost[axis] <= factor * found.cost[axis] + (1e-6**question.knowledge.curves.norm if axis else 0.0)
    if not good or cost[0] > limits[0] or cost[1] > limits[1]:
        return found
    mode = question.mode_of(last)
    count = next(c for c in question.counts if c.name == last.get(question.knowledge.passes[0].name, c.name))
    part = _part(question, mode, count)
    places = tuple(names.index(last[name]) for name, names in zip(part.names, part.settings, strict=True))
    return _at(part, places)


def _combination(question: Question, found: Found) -> dict[str, str]:
    """The settings; passes that do not run keep theirs where the mode lets them."""
    part = found.part
    chosen = {name: names[place] for name, names, place in zip(part.names, part.settings, found.places, strict=True)}
    combination = {}
    for step in question.knowledge.passes:
        open_ = [setting.name for setting in question.open.get(step.name, ())]
        if not open_:
            continue
        alike = part.mode.classes.get(step.name)
        names = open_ if alike is None else [name for name in open_ if name in alike.settings]
        current = step.settings.current(question.options)
        usual = current if current in names else names[0]
        combination[step.name] = (
            part.count.name if step is question.knowledge.passes[0] else chosen.get(step.name, usual)
        )
    return combination
