"""Tabu search on costs that are given as numbers, so that every law of it can be checked."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError, OptionError
from torchrender.photo.style.adjacency import Smoothness
from torchrender.photo.style.cost import StyleCost
from torchrender.photo.style.options import SearchOptions
from torchrender.photo.style.search import exhaustive, greedy, random_choice, single_view, tabu_search
from torchrender.photo.style.statistics import ColorStatistics, StyleTables


def problem(seed: int, objects: int = 5, columns: int = 6, views: int = 6, smooth: float = 0.3) -> StyleCost:
    """Random tables: pixels of random colours."""
    rng = np.random.default_rng(seed)
    pairs = [(i, j) for i in range(objects) for j in range(views) if rng.random() < 0.8 or i == j % objects]
    count = rng.integers(50, 500, len(pairs)).astype(float)
    centre = (
        rng.normal(0, 25, (len(pairs), columns, 2)) + rng.normal(0, 25, (objects, columns, 2))[[i for i, _ in pairs]]
    )
    spread = 3.0
    sums = np.zeros((len(pairs), columns, 5))
    sums[..., :2] = count[:, None, None] * centre
    sums[..., 2:4] = count[:, None, None] * (centre**2 + spread**2)
    bins = np.arange(64)
    counts = rng.dirichlet(np.full(64, 0.05), (len(pairs), columns)) * count[:, None, None]
    tables = StyleTables(
        np.array([i for i, _ in pairs]), np.array([j for _, j in pairs]), count, sums, counts.astype(np.float32), bins,
        8, objects, views,
    )  # fmt: skip
    wanted = ColorStatistics(
        torch.from_numpy(rng.normal(0, 10, 2)), torch.from_numpy(rng.uniform(5, 20, 2)),
        torch.from_numpy(rng.dirichlet(np.full(64, 0.2))),
    )  # fmt: skip
    near = torch.ones(objects, objects).bool() & ~torch.eye(objects).bool()
    materials = torch.from_numpy(rng.random((objects, columns, 8)))
    return StyleCost(tables, wanted, Smoothness.of(materials, near, "laplacian"), smooth_weight=smooth / objects)


def constant(objects: int = 6, columns: int = 15) -> StyleCost:
    """Every choice costs the same."""
    tables = StyleTables(
        np.arange(objects), np.zeros(objects, dtype=np.int64), np.full(objects, 10.0),
        np.zeros((objects, columns, 5)), np.ones((objects, columns, 1), np.float32), np.array([5]), 8, objects, 1,
    )  # fmt: skip
    histogram = torch.zeros(64, dtype=torch.float64)
    histogram[9] = 1.0
    zero = torch.zeros(2, dtype=torch.float64)
    near = torch.zeros(objects, objects, dtype=torch.bool)
    smooth = Smoothness.of(torch.zeros(objects, columns, 8, dtype=torch.float64), near, "tv")
    return StyleCost(tables, ColorStatistics(zero, zero, histogram), smooth, smooth_weight=0.0)


def everything(cost: StyleCost) -> np.ndarray:
    return np.ones((cost.objects, cost.columns), dtype=bool)


def start_of(cost: StyleCost) -> np.ndarray:
    return np.zeros(cost.objects, dtype=np.int64)


def test_the_optimum_is_found_in_most_random_problems() -> None:
    hits, gaps = 0, []
    for seed in range(30):
        cost = problem(seed, objects=5, columns=6)
        found = tabu_search(cost, start_of(cost), everything(cost))
        truth = exhaustive(cost, everything(cost), start_of(cost))
        assert found.cost >= truth.cost - 1e-9
        hits += found.cost <= truth.cost + 1e-9
        gaps.append(found.cost / truth.cost - 1)
    assert hits >= 0.85 * 30, hits
    assert np.mean(gaps) < 0.01


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_laws_of_the_search(seed: int) -> None:
    cost = problem(seed, objects=4, columns=4)
    found = tabu_search(cost, start_of(cost), everything(cost), SearchOptions(stagnation=15))
    assert found.cost == min(found.history) == pytest.approx(cost.total(found.choice), abs=1e-9)
    assert found.cost <= greedy(cost, start_of(cost), everything(cost)).cost + 1e-9
    for before, after in itertools.pairwise(found.visited):
        assert sum(a != b for a, b in zip(before, after, strict=True)) == 1
    for k, choice in enumerate(found.visited):
        assert choice not in found.visited[max(0, k - 10) : k] or found.aspired[k]
    # No single swap of the result is better.
    assert cost.start(found.choice).neighbours().min() >= found.cost - 1e-9


def test_a_constant_cost_ends_after_exactly_fifty_moves() -> None:
    cost = constant()
    found = tabu_search(cost, start_of(cost), everything(cost))
    assert found.iterations == 50 and found.stopped == "stagnation"
    # Ties go to the lowest object and then to the lowest candidate.
    assert found.visited[1] == (1, 0, 0, 0, 0, 0) and found.visited[2] == (2, 0, 0, 0, 0, 0)
    assert tabu_search(cost, start_of(cost), everything(cost), SearchOptions(stagnation=10)).iterations == 10


def test_neighbours_differ_in_one_object_and_are_as_many_as_the_candidates_allow() -> None:
    cost = constant(3, 4)
    usable = np.array([[1, 1, 1, 0], [1, 0, 0, 0], [1, 0, 1, 1]], dtype=bool)
    found = tabu_search(cost, start_of(cost), usable, SearchOptions(tabu_length=50))
    seen = set(found.visited)
    assert all(usable[i, c] for choice in seen for i, c in enumerate(choice))
    first = {c for c in seen if sum(v != 0 for v in c) == 1}
    assert len(first) == usable.sum() - 3 == 4


def test_it_ends_when_every_neighbour_is_tabu_and_at_the_target() -> None:
    cost = constant(1, 3)
    found = tabu_search(cost, start_of(cost), everything(cost))
    assert found.stopped == "no move" and found.iterations == 2
    nothing = tabu_search(cost, start_of(cost), np.array([[True, False, False]]))
    assert nothing.iterations == 0 and nothing.stopped == "no move"
    assert tabu_search(cost, start_of(cost), everything(cost), SearchOptions(stop_at=5.0)).stopped == "target"


def test_same_problem_same_result_and_move_lists_work() -> None:
    cost = problem(5)
    first, second = (tabu_search(cost, start_of(cost), everything(cost)) for _ in range(2))
    assert first.visited == second.visited
    moves = tabu_search(cost, start_of(cost), everything(cost), SearchOptions(tabu="move"))
    assert moves.cost <= moves.history[0]
    for k in range(1, len(moves.visited)):
        # What was left within ten moves is not entered again, unless it is the best so far.
        pairs = zip(moves.visited[k - 1], moves.visited[k], strict=True)
        changed = next(i for i, (a, b) in enumerate(pairs) if a != b)
        left = {
            (i, moves.visited[j - 1][i])
            for j in range(max(1, k - 10), k)
            for i in range(5)
            if moves.visited[j - 1][i] != moves.visited[j][i]
        }
        assert (changed, moves.visited[k][changed]) not in left or moves.aspired[k]


def test_baselines() -> None:
    cost = problem(8)
    usable = everything(cost)
    usable[1, 3] = False
    assert single_view(usable, start_of(cost), 3).tolist() == [3, 0, 3, 3, 3]
    chosen = random_choice(usable, start_of(cost), 4)
    assert all(usable[i, c] for i, c in enumerate(chosen))
    assert random_choice(usable, start_of(cost), 4).tolist() == chosen.tolist()
    best = exhaustive(cost, usable, start_of(cost)).cost
    some = np.random.default_rng(0).integers(0, 6, (500, 5))
    some[:, 1] %= 3
    every = [cost.total(c) for c in some]
    assert best <= min(every) + 1e-12 and np.allclose(cost.totals(some), every)


def test_wrong_use() -> None:
    cost = problem(1)
    with pytest.raises(InputError, match="start"):
        tabu_search(cost, np.full(5, 6), everything(cost))
    with pytest.raises(InputError, match="at most"):
        exhaustive(problem(1, objects=9), np.ones((9, 6), dtype=bool), np.zeros(9, dtype=np.int64))
    for wrong in ({"tabu_length": 0}, {"stagnation": 5}, {"bins": 100}, {"tabu": "none"}, {"smooth_weight": 2.0}):
        with pytest.raises(OptionError, match=next(iter(wrong))):
            SearchOptions(**wrong)
