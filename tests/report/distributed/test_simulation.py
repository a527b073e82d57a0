"""The simulation against what is known by formula, and its placement by counting."""

from __future__ import annotations

from collections import Counter

import pytest

from torchrender.errors import OptionError
from torchrender.report.distributed.ring import BOUND, Ring

simpy = pytest.importorskip("simpy")

from torchrender.report.distributed.simulation import Cluster, Load, capacity, simulate  # noqa: E402


def test_one_session_waits_for_nobody() -> None:
    served = simulate(Cluster(render_s=0.1, spread=0.0, carry_s=0.02), Load(sessions=1, period_s=1.0, seconds=100.0))
    assert served.keyframes_per_s == pytest.approx(1.0, rel=0.02)
    assert served.latency_s == pytest.approx(0.12) and served.latency_p95_s == pytest.approx(0.12)
    assert served.cores_busy == pytest.approx(0.12 / 2, rel=0.03) and served.waiting_s == pytest.approx(0.0)


def test_a_renderer_that_is_always_busy_makes_what_its_time_allows() -> None:
    served = simulate(Cluster(cores=1, renderers=1, render_s=0.05, spread=0.3), Load(sessions=40, seconds=60.0))
    assert served.keyframes_per_s == pytest.approx(20.0, rel=0.05)
    assert served.cores_busy == pytest.approx(1.0, rel=0.01)


def test_carrying_takes_cores_from_rendering() -> None:
    load = Load(sessions=60, seconds=60.0)
    served = simulate(Cluster(cores=2, renderers=2, render_s=0.08, spread=0.0, carry_s=0.02), load)
    assert served.keyframes_per_s == pytest.approx(2 / 0.1, rel=0.05)
    more = simulate(Cluster(cores=4, renderers=2, render_s=0.08, spread=0.0, carry_s=0.02), load)
    assert more.keyframes_per_s == pytest.approx(2 / 0.08, rel=0.05), "renderers have cores of their own"


def test_views_that_are_told_take_cores_without_a_keyframe() -> None:
    load = Load(sessions=8, period_s=1 / 30, seconds=30.0)
    served = simulate(Cluster(cores=2, renderers=2, render_s=0.08, spread=0.0, tell_s=0.004), load)
    assert served.keyframes_per_s == pytest.approx((2 - 8 * 30 * 0.004) / 0.08, rel=0.05)
    one = simulate(Cluster(render_s=0.1, spread=0.0, tell_s=0.02), Load(sessions=1, period_s=1.0, seconds=100.0))
    assert one.cores_busy == pytest.approx(0.12 / 2, rel=0.03)


def test_what_is_always_done_takes_its_share() -> None:
    load = Load(sessions=40, seconds=60.0)
    served = simulate(Cluster(cores=1, renderers=1, render_s=0.05, spread=0.0, always_s=0.25), load)
    assert served.keyframes_per_s == pytest.approx(0.75 * 20.0, rel=0.05)


def test_waiting_is_that_of_a_queue_with_random_arrivals() -> None:
    """Many sessions with long periods arrive as Poisson's do: M/D/1, a wait of ``rho s / (2 (1 - rho))``."""
    cluster = Cluster(cores=1, renderers=1, render_s=0.1, spread=0.0)
    waits = [
        simulate(cluster, Load(sessions=700, period_s=100.0, seconds=400.0, settle_s=100.0, seed=seed)).waiting_s
        for seed in range(4)
    ]
    assert sum(waits) / 4 == pytest.approx(0.7 * 0.1 / (2 * 0.3), rel=0.25)


def test_a_ring_keeps_scenes_warm_where_fewest_does_not() -> None:
    cluster = Cluster(machines=4, render_s=0.02, load_s=0.5, scenes_kept=4)
    cold = {
        placing: simulate(cluster, Load(sessions=60, scenes=24, placing=placing, seconds=20.0)).cold  # type: ignore[arg-type]
        for placing in ("fewest", "ring")
    }
    assert cold["ring"] < 0.5 * cold["fewest"]


def test_capacity_grows_with_machines() -> None:
    one, four = (
        capacity(Cluster(machines=m, render_s=0.1), 1.0, lambda s: s.latency_p95_s < 0.5, most=128) for m in (1, 4)
    )
    assert 8 <= one <= 20 and four >= 3 * one


def test_a_ring_moves_few_scenes_and_bounds_what_each_has() -> None:
    scenes = [f"scene {k}" for k in range(400)]
    small, large = Ring(8), Ring(9)
    before = [small.place(s, [0] * 8) for s in scenes]
    after = [large.place(s, [0] * 9) for s in scenes]
    moved = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    assert 0 < len(moved) < 2 * 400 / 9 and {b for _, b in moved} == {8}
    sessions = [0] * 8
    for _ in range(160):
        sessions[small.place("the one that all want", sessions)] += 1
    assert max(sessions) <= BOUND * 160 / 8 + 1 and min(sessions) == 0 and sum(sessions) == 160
    assert len(Counter(before)) == 8
    for wrong in (0, -1):
        with pytest.raises(OptionError, match="count"):
            Ring(wrong)


def test_wrong_numbers_are_named() -> None:
    for make, message in (
        (lambda: Cluster(machines=0), "machines"),
        (lambda: Cluster(render_s=0.0), "render_s"),
        (lambda: Load(sessions=0), "sessions"),
        (lambda: Load(sessions=1, placing="nearest"), "placing"),  # type: ignore[arg-type]
    ):
        with pytest.raises(OptionError, match=message):
            make()
