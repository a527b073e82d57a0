"""Compiling side by side: all that was asked for is there afterwards, whatever stops or fails on the way."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from torchrender.kernels import claims, keys, warm_up
from torchrender.kernels.pruning import OLD_S
from torchrender.kernels.signatures import Use, recorded
from torchrender.kernels.store import UNFINISHED

ROOT = Path(__file__).resolve().parents[2]
PATH = os.pathsep.join([str(ROOT), str(ROOT / "service")])


def quick(count: int) -> list[Use]:
    """The kernels that take the least to compile; those that call Embree need it loaded first."""
    plain = [use for use in recorded() if not use.kernel.startswith(("rays.", "shadows.light_refine"))]
    return sorted(plain, key=lambda use: use.seconds)[:count]


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
    old = left / f"tiles-1.code.abc{UNFINISHED}"
    old.write_text("half")
    os.utime(old, (time.time() - 2 * OLD_S,) * 2)
    environment = {**os.environ, "PYTHONPATH": PATH, "NUMBA_CACHE_DIR": str(empty)}
    process = subprocess.Popen(
        [sys.executable, "-m", "torchrender", "warm-up", "--for", "points"],
        env=environment, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True,
        # Jobs in the background of a shell ignore Ctrl-C, and what they start does, too.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stderr is not None
    with process.stderr as told:
        assert "0 of" in told.readline()
        time.sleep(1.0)
        os.killpg(process.pid, signal.SIGINT)
        rest = told.read()  # ends when the processes that compile have ended, too
    assert process.wait() == 130 and "interrupted" in rest and "Traceback" not in rest
    assert not old.exists() and not list(empty.rglob(f"*{UNFINISHED}"))


def test_modules_go_to_one_process_and_the_longest_comes_first() -> None:
    made = warm_up.Compilation(processes=0)
    made.add([Use("a.x", "[]", 1.0, ()), Use("a.y", "[]", 5.0, ()), Use("b.z", "[]", 3.0, ())])
    first = made._next(None)
    assert first.kernel == "a.y"
    second = made._next(None)
    assert second.kernel == "b.z"
    assert made._next(first.module).kernel == "a.x"
    made.add([Use("c.x", "[]", 9.0, ()), Use("b.u", "[]", 0.1, ())])
    made._threads = 1  # nobody else would work
    waiting = threading.Thread(target=made.wait_for, args=("b.u",), daemon=True)
    waiting.start()
    while not made._urgent:
        time.sleep(0.01)
    assert made._next(first.module).kernel == "b.u", "somebody waits for it"
    made.stop()
    assert made._next(None) is None
    assert warm_up.expected_seconds(quick(2)) > 0 and 1 <= warm_up.process_count() <= warm_up.MAX_PROCESSES


@pytest.mark.usefixtures("empty")
def test_more_may_be_added_and_one_kernel_waited_for() -> None:
    """What is there twice is compiled once; who waits for a kernel that nobody compiles is told so."""
    told: list[tuple[int, int]] = []
    one, two = quick(2)
    work = warm_up.Compilation(lambda done, total: told.append((done, total)), processes=1)
    try:
        work.add([one])
        assert work.wait_for(one.kernel) and not work.wait_for("no.kernel")
        work.add([one, two])
        assert work.wait() == warm_up.Outcome(2, ())
    finally:
        work.stop()
    assert told[0] == (0, 1) and told[-1] == (2, 2)
    assert not warm_up.missing() or not {one, two}.intersection(warm_up.missing())


def test_somebody_who_no_longer_listens_stops_nothing(empty) -> None:
    def broken(*_: int) -> None:
        raise BrokenPipeError

    assert warm_up.warm_up(quick(1), broken).compiled == 1 and list(empty.rglob("*.code"))


CODE = (
    "import json, sys; from torchrender.kernels.signatures import recorded\n"
    "from torchrender.kernels.warm_up import warm_up\n"
    "uses = sorted(recorded(), key=lambda use: use.seconds)[: int(sys.argv[1])]\n"
    "made = warm_up(uses, processes=1); print(json.dumps([made.compiled, made.failed]))"
)


def whole_warm_up(folder: Path, count: int, *, inside: str = "", code: str = CODE) -> subprocess.Popen[str]:
    """Another process that warms up; ``inside`` a shell with a file system of its own, after a command."""
    words = [sys.executable, "-c", code, str(count)]
    if inside:
        words = ["unshare", "--mount", "sh", "-c", f'{inside} && exec "$0" "$@"', *words]
    environment = {**os.environ, "PYTHONPATH": PATH, "NUMBA_CACHE_DIR": str(folder)}
    return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(process: subprocess.Popen[str]) -> tuple[list[object], str]:
    """What it says, on both ways."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return json.loads(out.splitlines()[-1]), err


def test_two_whole_warm_ups_at_once_share_the_work(empty) -> None:
    """Both return when all is there, and nothing was compiled twice."""
    count = 6
    (first, _), (second, _) = [ended(one) for one in [whole_warm_up(empty, count) for _ in range(2)]]
    assert first[1] == second[1] == []
    assert first[0] + second[0] == count
    assert not list(empty.rglob("*.claim")) and not list(empty.rglob(f"*{UNFINISHED}"))


needs_mounts = pytest.mark.skipif(
    not shutil.which("unshare") or subprocess.run(["unshare", "--mount", "true"], check=False).returncode != 0,
    reason="a file system of one's own needs rights",
)


@needs_mounts
def test_without_shared_memory(empty) -> None:
    """Nothing can be put there: the processes need pipes alone."""
    code = "import os; assert not os.access('/dev/shm', os.W_OK) or os.statvfs('/dev/shm').f_flag & os.ST_RDONLY; "
    process = whole_warm_up(empty, 1, inside="mount -t tmpfs -o ro none /dev/shm", code=code + CODE)
    assert ended(process)[0] == [1, []]


@needs_mounts
def test_a_disk_that_is_full_says_so_and_keeps_nothing_by_halves(empty) -> None:
    """A disk of 8 kB holds no kernel: each is compiled, cannot be kept, and is named with the reason."""
    empty.mkdir()
    left = f"[str(p) for p in pathlib.Path({str(empty)!r}).rglob('*.part')]"
    code = "import pathlib; " + CODE.replace("made.failed]", f"made.failed, {left}]")
    process = whole_warm_up(empty, 2, inside=f"mount -t tmpfs -o size=8k none '{empty}'", code=code)
    (compiled, failed, left), err = ended(process)
    assert compiled == 0 and len(failed) == 2 and left == []
    assert all("cannot be kept in" in one for one in failed) and "No space left on device" in err


def test_a_warm_up_that_was_killed_leaves_nothing_in_the_way(empty) -> None:
    """Not by Ctrl-C but at once, with all its processes: their claims hold nobody up, and the rest is compiled."""
    count = 4
    process = whole_warm_up(empty, count)
    end = time.monotonic() + 120.0
    while not list(empty.rglob("*.claim")) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    begun = list(empty.rglob("*.claim"))
    assert begun
    for claim in begun:
        os.kill(int(claim.read_text().split()[1]), signal.SIGKILL)
    process.kill()
    process.communicate()
    begin = time.monotonic()
    uses = quick(count)
    assert warm_up.warm_up(uses).failed == () and not set(uses).intersection(warm_up.missing())
    assert time.monotonic() - begin < claims.LONGEST_S / 2
