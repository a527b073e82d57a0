"""Tabu search for the choice of least cost, and simpler ways to choose that it is compared with."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from torchrender.checks import options_of
from torchrender.errors import InputError
from torchrender.photo.style.cost import Moves, StyleCost
from torchrender.photo.style.options import SearchOptions

BETTER = 1e-12
"""A cost must be lower by this to count as better: less is rounding."""
MAX_EXHAUSTIVE = 200_000


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best choice met, and the way there."""

    choice: np.ndarray  # (m,) int64
    cost: float
    history: tuple[float, ...]  # F of the start and after every move
    visited: tuple[tuple[int, ...], ...]  # the choices of the history
    aspired: tuple[bool, ...]  # whether a move was made although it was tabu
    stopped: str  # "target", "stagnation" or "no move"

    @property
    def iterations(self) -> int:
        """Moves made."""
        return len(self.history) - 1


def tabu_search(
    cost: StyleCost,
    start: np.ndarray,
    usable: np.ndarray,
    options: SearchOptions | None = None,
    progress: Callable[[int], None] | None = None,
) -> SearchResult:
    """Move to the best neighbour that is not tabu, even if it is worse, until nothing better comes.

    A neighbour gives one object another of its usable candidates (m,C). The list holds the last choices visited, or
    with ``tabu="move"`` the pairs of object and candidate left; a tabu neighbour is taken if it is the best met so
    far. Ties go to the lowest object, then the lowest candidate.

    Raises:
        InputError: the start names a candidate that does not exist.
    """
    options = options_of(options, SearchOptions)
    if len(start) != cost.objects or start.min() < 0 or start.max() >= cost.columns:
        raise InputError(f"start must name one of {cost.columns} candidates for each of {cost.objects} objects")
    moves = cost.start(start)
    best, best_cost = moves.choice.copy(), moves.total
    history, visited, aspired = [best_cost], [tuple(best.tolist())], [False]
    recent: deque[np.ndarray] = deque([best.copy()], maxlen=options.tabu_length)
    left: deque[tuple[int, int]] = deque(maxlen=options.tabu_length)
    stagnant, stopped = 0, "stagnation"
    while stagnant < options.stagnation:
        if best_cost <= options.stop_at:
            stopped = "target"
            break
        step = _best_move(moves, usable, best_cost, _tabu(moves.choice, recent, left, options.tabu, usable.shape))
        if step is None:
            stopped = "no move"
            break
        index, column, against = step
        left.append((index, int(moves.choice[index])))
        moves.move(index, column)
        recent.append(moves.choice.copy())
        history.append(moves.total)
        visited.append(tuple(moves.choice.tolist()))
        aspired.append(against)
        if moves.total < best_cost - BETTER:
            best, best_cost, stagnant = moves.choice.copy(), moves.total, 0
        else:
            stagnant += 1
        if progress is not None:
            progress(len(history) - 1)
    return SearchResult(best, best_cost, tuple(history), tuple(visited), tuple(aspired), stopped)


def _tabu(
    choice: np.ndarray,
    recent: deque[np.ndarray],
    left: deque[tuple[int, int]],
    kind: str,
    shape: tuple[int, ...],
) -> np.ndarray:
    """(m,C) bool: moves that lead to a listed choice, or that are listed themselves."""
    out = np.zeros(shape, dtype=bool)
    if kind == "move":
        for index, column in left:
            out[index, column] = True
        return out
    for old in recent:
        different = np.flatnonzero(old != choice)
        if len(different) == 1:
            out[different[0], old[different[0]]] = True
    return out


def _best_move(moves: Moves, usable: np.ndarray, best: float, tabu: np.ndarray) -> tuple[int, int, bool] | None:
    """Object and candidate of the best allowed move, and whether it was tabu; None if every move is forbidden."""
    costs = moves.neighbours()
    allowed = usable.copy()
    allowed[np.arange(len(usable)), moves.choice] = False
    allowed &= ~tabu | (costs < best - BETTER)
    if not allowed.any():
        return None
    flat = int(np.where(allowed, costs, np.inf).argmin())
    index, column = divmod(flat, usable.shape[1])
    return index, column, bool(tabu[index, column])


def greedy(cost: StyleCost, start: np.ndarray, usable: np.ndarray) -> SearchResult:
    """Steepest descent to the first local minimum."""
    moves = cost.start(start)
    history, visited = [moves.total], [tuple(moves.choice.tolist())]
    nothing = np.zeros(usable.shape, dtype=bool)
    while True:
        step = _best_move(moves, usable, np.inf, nothing)
        if step is None:
            break
        index, column, _ = step
        if not moves.neighbours()[index, column] < moves.total - BETTER:
            break
        moves.move(index, column)
        history.append(moves.total)
        visited.append(tuple(moves.choice.tolist()))
    none = (False,) * len(history)
    return SearchResult(moves.choice.copy(), moves.total, tuple(history), tuple(visited), none, "no move")


def exhaustive(cost: StyleCost, usable: np.ndarray, start: np.ndarray) -> SearchResult:
    """The best of all choices; objects without a usable candidate stay as they start.

    Raises:
        InputError: more than ``MAX_EXHAUSTIVE`` choices.
    """
    columns = [np.flatnonzero(row).tolist() or [int(start[i])] for i, row in enumerate(usable)]
    count = int(np.prod([float(len(c)) for c in columns]))
    if count > MAX_EXHAUSTIVE:
        raise InputError(f"an exhaustive search tries at most {MAX_EXHAUSTIVE} choices, there are {count}")
    choices = np.array(list(itertools.product(*columns)), dtype=np.int64)
    totals = np.concatenate([cost.totals(part) for part in np.array_split(choices, len(choices) // 256 + 1)])
    found = choices[int(totals.argmin())]
    total = cost.total(found)
    return SearchResult(found, total, (total,), (tuple(found.tolist()),), (False,), "no move")


def random_choice(usable: np.ndarray, start: np.ndarray, seed: int) -> np.ndarray:
    """(m,) one usable candidate of each object at random."""
    rng = np.random.default_rng(seed)
    return np.array(
        [rng.choice(np.flatnonzero(row)) if row.any() else start[i] for i, row in enumerate(usable)], dtype=np.int64
    )


def single_view(usable: np.ndarray, start: np.ndarray, column: int) -> np.ndarray:
    """(m,) candidate ``column`` for all that have it, the start elsewhere."""
    return np.where(usable[:, column], column, start)
