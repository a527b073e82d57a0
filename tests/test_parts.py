"""The order in which processes take the tests loses none, keeps files together, and begins with the longest."""

from __future__ import annotations

from pathlib import Path

from parts import BROWSER, LONGEST, in_turn, missing, part_of

ROOT = Path(__file__).resolve().parent.parent
SHORT, FEW = "tests/a.py", "tests/b.py"
TESTS = [f"{FEW}::one", f"{SHORT}::one", f"{LONGEST[2]}::x[a::b]", f"{SHORT}::two", f"{BROWSER}/test_page.py::one",
         f"{BROWSER}/test_codec.py::one", f"{LONGEST[1]}::x", f"{SHORT}::three", f"{BROWSER}/test_page.py::two",
         f"{FEW}::two"]  # fmt: skip


def test_the_longest_come_first_then_those_with_many_tests() -> None:
    turn = in_turn(TESTS)
    assert sorted(turn) == list(range(len(TESTS)))
    assert list(dict.fromkeys(part_of(TESTS[place]) for place in turn)) == [*LONGEST[:3], SHORT, FEW]


def test_tests_of_a_part_stay_together_as_they_were() -> None:
    turn = in_turn(TESTS)
    for part in {part_of(test) for test in TESTS}:
        places = [n for n, place in enumerate(turn) if part_of(TESTS[place]) == part]
        assert places == list(range(places[0], places[0] + len(places)))
        own = [turn[n] for n in places]
        assert own == sorted(own)


def test_the_longest_are_there() -> None:
    assert not missing(ROOT) and len(set(LONGEST)) == len(LONGEST)
