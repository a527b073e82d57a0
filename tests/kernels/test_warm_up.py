"""Compiling side by side: all that was asked for is there afterwards, whatever stops or fails on the way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from torchrender.kernels import keys, warm_up
from torchrender.kernels.signatures import Use, recorded

ROOT = Path(__file__).resolve().parents[2]
PATH = os.pathsep.join([str(ROOT), str(ROOT / "service")])


def quick(count: int) -> list[Use]:
    """The kernels that take the least to compile."""
    return sorted(recorded(), key=lambda use: use.seconds)[:count]


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """A cache folder with a space in its name, and nothing in it."""
    folder = tmp_path / "a cache"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    for cached in (keys.cache_folder, keys.read_folders):
        cached.cache_clear()
    yield folder
    for cached in (keys.cache_folder, keys.read_folders):
        cached.cache_clear()


def test_nothing_is_compiled_after_a_warm_up(empty) -> None:
    uses = quick(4)
    told: list[tuple[int, int]] = []
    outcome = warm_up.warm_up(uses, lambda done, total: told.append((done, total)))
    assert outcome == warm_up.Outcome(4, ()) and told[0] == (0, 4) and told[-1] == (4, 4) and told == sorted(told)
    code = (
        "import json, sys; from numba.core import event\n"
        "class L(event.Listener):\n    n = 0\n    def on_start(self, e): L.n += 1\n    def on_end(self, e): pass\n"
        "event.register('numba:compile', L())\n"
        "from torchrender.kernels.signatures import Use, kernel_of, types_of\n"
        "from torchrender.kernels.warm_up import missing\n"
        "uses = [Use(k, t, 0.0, ()) for k, t in json.loads(sys.argv[1])]\n"
        "for use in uses: kernel_of(use).compile(types_of(use))\n"
        "print(L.n, sum((u.kernel, u.arguments) in {(m.kernel, m.arguments) for m in missing()} for u in uses))"
    )
    words = json.dumps([(use.kernel, use.arguments) for use in uses])
    environment = {**os.environ, "PYTHONPATH": PATH}
    said = subprocess.run(
        [sys.executable, "-c", code, words], env=environment, capture_output=True, text=True, check=True
    )
    assert said.stdout.split() == ["0", "0"]
    assert empty.is_dir()


@pytest.mark.usefixtures("empty")
def test_a_kernel_that_cannot_be_compiled_is_named_and_stops_no_other() -> None:
    wrong = Use(quick(1)[0].kernel, json.dumps([]), 9.0, ())
    outcome = warm_up.warm_up([wrong, *quick(1)])
    assert outcome.compiled == 1 and len(outcome.failed) == 1 and wrong.kernel in outcome.failed[0]


def test_what_cannot_be_kept_is_said(empty) -> None:
    """A file where the folder should be fails as a full disk does."""
    empty.write_text("")
    outcome = warm_up.warm_up(quick(1))
    assert outcome.compiled == 0 and "cannot be kept in" in outcome.failed[0]


@pytest.mark.usefixtures("empty")
def test_without_processes_this_one_compiles(monkeypatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("no processes here")

    monkeypatch.setattr(warm_up.subprocess, "Popen", refuse)
    assert warm_up.warm_up(quick(1)).failed == ()


def test_no_work_starts_no_process(monkeypatch) -> None:
    monkeypatch.setattr(warm_up.subprocess, "Popen", None)
    told = []
    assert warm_up.warm_up([], lambda *progress: told.append(progress)) == warm_up.Outcome(0, ())
    assert told == [(0, 0)]


def test_an_interrupted_warm_up_leaves_no_process_and_goes_on(empty, tmp_path) -> None:
    """As by Ctrl-C: what is there stays, unfinished files of old are removed, and the rest is compiled later."""
    left = empty / "raster"
    left.mkdir(parents=True)
    old = left / f"tiles-1.code.abc{warm_up.UNFINISHED}"
    old.write_text("half")
    os.utime(old, (time.time() - 2 * warm_up.OLD_S,) * 2)
    environment = {**os.environ, "PYTHONPATH": PATH, "NUMBA_CACHE_DIR": str(empty)}
    process = subprocess.Popen(
        [sys.executable, "-m", "torchrender.cli", "warm-up", "--for", "points"],
        env=environment, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True,
    )  # fmt: skip
    assert process.stderr is not None
    with process.stderr as told:
        assert "0 of" in told.readline()
        time.sleep(1.0)
        os.killpg(process.pid, signal.SIGINT)
        rest = told.read()  # ends when the processes that compile have ended, too
    assert process.wait() == 130 and "interrupted" in rest and "Traceback" not in rest
    assert not old.exists() and not list(empty.rglob(f"*{warm_up.UNFINISHED}"))


def test_modules_go_to_one_process_and_the_longest_comes_first() -> None:
    made = warm_up._Work([Use("a.x", "[]", 1.0, ()), Use("a.y", "[]", 5.0, ()), Use("b.z", "[]", 3.0, ())], None)
    module, first = made._next(None)
    other, second = made._next(None)
    assert (module, first.kernel, other, second.kernel) == ("a", "a.y", "b", "b.z")
    assert made._next(module)[1].kernel == "a.x" and made._next(module)[1] is None
    assert warm_up.expected_seconds(quick(2)) > 0 and 1 <= warm_up.process_count() <= warm_up.MAX_PROCESSES
