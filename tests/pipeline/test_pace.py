"""What a sequence learns from the times of its pictures: one late picture says little, two say something."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import (
    BESIDE,
    EXPECTED_MISSES,
    FADING,
    LOOKS,
    MISSES,
    MOST_MISSED,
    SEARCHING,
    SPEED,
    TOLERANCE,
    UNTRIED,
    Pace,
    Search,
)


def learned(*times_ms: float) -> Pace:
    """After pictures in which a pass took so long where 10 ms were foreseen."""
    pace = Pace()
    for ms in times_ms:
        pace = pace.learned("pass", "way", ms, 10.0)
    return pace


@pytest.mark.parametrize("times, ratio", [
    ((30.0,), 3.0), ((30.0, 10.0), 1.0), ((10.0, 30.0), 1.0), ((10.0, 30.0, 10.0), 1.0), ((10.0, 30.0, 30.0), 3.0),
    ((11.0, 10.0, 12.0, 10.5), 1.05), ((30.0, 30.0, 10.0, 10.0), 1.0),
])  # fmt: skip
def test_a_ratio_is_the_lower_median_of_the_last_three(times: tuple[float, ...], ratio: float) -> None:
    assert learned(*times).ratio("pass", "way") == pytest.approx(ratio)


def test_what_several_pictures_told_fades_slowly() -> None:
    once, often = learned(30.0).aged(()), learned(30.0, 30.0).aged(())
    assert once.ratio("pass", "way") == pytest.approx(3.0**FADING)
    assert once.ratio("pass", "way") < often.ratio("pass", "way") < 3.0
    assert learned(30.0).aged({("pass", "way")}).ratio("pass", "way") == 3.0


def test_one_late_picture_moves_the_speed_by_little() -> None:
    known = Pace(known=Pace().hurried(10.0, 10.0))
    assert known.hurried(80.0, 10.0)[SPEED] == pytest.approx(0.5 * MOST_MISSED)
    assert known.hurried(12.0, 10.0)[SPEED] == pytest.approx(0.5 * math.log(1.2))


def test_one_of_twenty_pictures_may_be_late() -> None:
    pace = Pace()
    assert pace.late is None
    for _ in range(MISSES):
        pace = pace.missed(100.0, 100.0)
    assert pace.late == 0.0 and len(pace.misses) == MISSES
    assert pace.missed(130.0, 100.0).late == 0.0
    assert pace.missed(130.0, 100.0).missed(120.0, 100.0).late == pytest.approx(math.log(1.2))


def test_before_pictures_tell_it_is_expected_that_they_miss() -> None:
    """The farthest stand-ins go first: a few pictures in time are enough to trust predictions."""
    ranks = [abs(off) for off in EXPECTED_MISSES]
    assert ranks == sorted(ranks, reverse=True) and sum(EXPECTED_MISSES) == pytest.approx(0.0)
    late, pace = [], Pace()
    for _ in range(5):
        pace = pace.missed(100.0, 100.0)
        late.append(pace.late or 0.0)
    assert late == sorted(late, reverse=True) and late[0] > math.log(TOLERANCE) > late[2]


def test_after_a_late_picture_nothing_is_tried_that_may_be_late_again() -> None:
    pace = learned(10.0).missed(100.0, 100.0)
    assert pace.warned(109.0, 100.0).doubt("pass", "other") == 1.0
    late = pace.warned(111.0, 100.0)
    assert late.doubt("pass", "other") == UNTRIED and late.doubt("pass", "way") == 1.0
    for _ in range(MISSES):
        assert late.wary
        late = late.warned(50.0, 100.0)
    assert late.doubt("pass", "other") == 1.0
    assert pace.warned(1e9, None).wary == 0


def test_what_ran_first_in_a_picture_that_was_held_up_is_not_blamed() -> None:
    before = learned(10.0, 10.0)
    slow = before.learned_all({("pass", "way"): (20.0, 10.0), ("other", "way"): (40.0, 10.0)})
    assert slow.ratio("other", "way") == pytest.approx(2.0) and slow.ratio("pass", "way") == pytest.approx(1.0)
    quick = before.learned_all({("pass", "way"): (5.0, 10.0), ("other", "way"): (40.0, 10.0)})
    assert quick.ratio("other", "way") == pytest.approx(4.0)
    assert Pace().learned_all({("other", "way"): (40.0, 10.0)}).ratio("other", "way") == pytest.approx(4.0)


def test_sensing_is_paid_by_pictures_that_look() -> None:
    """By those with a search, and one of several that stand by a choice: others may fill its time."""
    known = {BESIDE["plan"]: 3.0, BESIDE["senses"]: 14.0, SEARCHING: 50.0}
    search = Search(
        wishes=(60.0, None), asked=RenderOptions(), settings={}, possible=True, changes=(), cost=(1.0, 0.1, 0.2)
    )
    assert Pace(known=known).looks_next
    for stood in range(2 * LOOKS):
        pace = Pace(known=known, search=replace(search, pictures=stood))
        assert pace.looks_next == (stood + 1 in (LOOKS - 1, 2 * LOOKS - 1))
        assert sum(pace.beside(pace.looks_next).values()) == (17.0 if pace.looks_next else 3.0)
        assert pace.search_ms + sum(pace.beside(pace.looks_next).values()) == 50.0


def test_what_is_untried_is_half_as_quick_as_others_of_its_pass() -> None:
    """And all as slow: a small map drawn in no time says little about a large one."""
    known = {SPEED: math.log(2.0)}
    assert Pace(ratios={("map", "256"): 0.5}, known=known).ratio("map", "2048") == pytest.approx(1.0)
    assert Pace(ratios={("map", "256"): 5.0}, known=known).ratio("map", "2048") == pytest.approx(5.0)
    assert Pace(known=known).ratio("map", "2048") == pytest.approx(2.0)


def test_before_any_picture_tells_what_is_missed_untried_settings_count_longer() -> None:
    known = Pace(ratios={("pass", "way"): 1.0})
    assert known.doubt("pass", "way") == 1.0 and known.doubt("pass", "other") == UNTRIED
    assert known.missed(100.0, 100.0).doubt("pass", "other") == 1.0
    assert Pace().doubt("pass", "other", 3.0) == 1.0, "of a first picture all are untried"
    assert known.missed(100.0, 100.0).doubt("pass", "other", 3.0) == 3.0 and known.doubt("pass", "way", 3.0) == 1.0
