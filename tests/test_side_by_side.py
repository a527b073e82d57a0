"""Checks that run side by side: all of them run, and each failure is one of the whole."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

import side_by_side
from parts import BROWSER


def python(code: str) -> side_by_side.Command:
    return (sys.executable, "-S", "-c", code)


FINE, BAD = python("print('well')"), python("print('bad'); raise SystemExit(3)")


@pytest.mark.parametrize(
    ("shown", "beside", "code"),
    [(FINE, [FINE, FINE], 0), (BAD, [FINE], 1), (FINE, [BAD, FINE], 1), (FINE, [FINE, BAD], 1), (FINE, [], 0)],
)
def test_one_that_fails_fails_the_whole_and_holds_up_no_other(shown, beside, code, capfd) -> None:
    assert side_by_side.run(shown, beside) == code
    said = [line for line in capfd.readouterr().out.splitlines() if line in ("well", "bad")]
    assert sorted(said) == sorted("bad" if command == BAD else "well" for command in (shown, *beside))


def test_a_command_that_cannot_start_fails_the_whole(capfd) -> None:
    assert side_by_side.run(FINE, [("/no/such/program",)]) == 1
    assert "No such file" in capfd.readouterr().out


def test_they_run_at_once(tmp_path) -> None:
    """Each waits for the file that the other writes."""
    meet = (
        "import pathlib, time, sys; own, other = map(pathlib.Path, sys.argv[1:]); own.touch()\n"
        "while not other.exists(): time.sleep(0.01)"
    )
    one, two = str(tmp_path / "one"), str(tmp_path / "two")
    assert side_by_side.run((*python(meet), one, two), [(*python(meet), two, one)]) == 0


def test_none_outlives_an_interruption(monkeypatch) -> None:
    started: list[subprocess.Popen[str]] = []
    popen = subprocess.Popen

    def noted(*given, **named):
        started.append(popen(*given, **named))
        return started[-1]

    def interrupted(*_, **__):
        end = time.monotonic() + 30.0
        while not started and time.monotonic() < end:
            time.sleep(0.01)
        raise KeyboardInterrupt

    monkeypatch.setattr(side_by_side.subprocess, "Popen", noted)
    monkeypatch.setattr(side_by_side.subprocess, "call", interrupted)
    with pytest.raises(KeyboardInterrupt):
        side_by_side.run(FINE, [python("import time; time.sleep(60)")])
    assert started[0].wait(10) != 0


def test_every_test_is_in_one_of_the_two_runs() -> None:
    assert side_by_side.BESIDE[-1][-1] == BROWSER and f"--ignore={BROWSER}" in side_by_side.SHOWN
