"""Both sides of a kernel, what is kept of them, and what happens where nothing can be kept."""

from __future__ import annotations

import gc
import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

KERNELS = """
import numpy as np
from numba import prange
from torchrender.kernels.compile import kernel

@kernel(inline=True)
def square(x):
    return x * x

@kernel()
def helper(values, place):
    if place < 0:
        raise ValueError("place must not be negative")
    return square(values[place])

@kernel()
def total(values, first):
    found = 0.0
    for k in range(first, len(values)):
        found += helper(values, k)
    return found

@kernel(parallel=True)
def each(values):
    out = np.zeros(len(values))
    for k in prange(len(values)):
        out[k] = helper(values, np.int64(k)) + square(1.0)
    return out

@kernel()
def ends(values):
    return helper(values, 0) + helper(values, 1) + helper(values, 4)

@kernel()
def room(size):
    return np.zeros(size)
"""
LATE = """
from numba.extending import overload
from torchrender.kernels.compile import kernel

def twice(x):
    return 2 * x

@overload(twice)
def compiled_twice(x):
    return lambda x: 2 * x

@kernel()
def four_times(x):
    return twice(twice(x))
"""


def run(folder: Path, code: str, **environment: str) -> dict[str, object]:
    """What a process prints last, with kernels from ``folder`` and its cache there, too."""
    (folder / "own.py").write_text(KERNELS) if not (folder / "own.py").exists() else None
    count = (
        "import json, sys; from numba.core import event\n"
        "class L(event.Listener):\n"
        "    n = 0\n"
        "    def on_start(self, e): L.n += 1\n"
        "    def on_end(self, e): pass\n"
        "event.register('numba:compile', L())\n"
        "import numpy as np; import own; v = np.arange(5.0)\n"
    )
    path = os.pathsep.join([str(folder), str(ROOT)])
    given = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(folder / "a cache"), **environment}
    given = {k: v for k, v in given.items() if v}
    done = subprocess.run(
        [sys.executable, "-c", count + code], env=given, capture_output=True, text=True, check=False, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return {**json.loads(done.stdout.splitlines()[-1]), "stderr": done.stderr}


SUM = "print(json.dumps({'sum': own.total(v, 0), 'n': L.n}))"


@pytest.mark.parametrize("plain", ["", "1"])
def test_kernels_call_kernels_and_python_calls_each_of_them(tmp_path, plain) -> None:
    """In any order, with errors that go through helpers, in a folder with a space in its name; then from disk."""
    code = (
        "r = [own.total(v, 0), own.square(3.0), own.helper(v, 2), own.each(v).tolist()]\n"
        "for wrong in (lambda: own.helper(v, -1), lambda: own.total(v, -1)):\n"
        "    try: wrong()\n"
        "    except ValueError as e: r.append(str(e))\n"
        "print(json.dumps({'r': r, 'n': L.n}))"
    )
    error = "place must not be negative"
    expected = [30.0, 9.0, 4.0, [1.0, 2.0, 5.0, 10.0, 17.0], error, error]
    first = run(tmp_path, code, TORCHRENDER_PLAIN_COMPILER=plain)
    again = run(tmp_path, code, TORCHRENDER_PLAIN_COMPILER=plain)
    for made in (first, again):
        assert made["r"] == expected
    assert first["n"] > 4 and again["n"] == 0


def test_constants_share_the_code_of_a_helper(tmp_path) -> None:
    made = run(tmp_path, "print(json.dumps({'sum': own.ends(v), 'n': L.n}))")
    assert made["sum"] == 0.0 + 1.0 + 16.0
    assert made["n"] == 3  # ends, helper, square


@pytest.mark.parametrize("plain", ["", "1"])
def test_what_kernels_call_of_numba_is_linked_and_still_raises(tmp_path, plain) -> None:
    code = (
        "from numba.core.codegen import JITCodeLibrary\n"
        "made, finish = [], JITCodeLibrary._finalize_specific\n"
        "JITCodeLibrary._finalize_specific = lambda self: (made.append(self.name), finish(self))[1]\n"
        "r = own.room(3).tolist()\n"
        "try: own.room(-1)\n"
        "except ValueError as e: told = str(e)\n"
        "of_numba = any('impl' in name for name in made)\n"
        "import numba; here = numba.njit(lambda n: np.zeros(n))(2).tolist()\n"
        "print(json.dumps({'r': r, 'told': told, 'room': any('room' in n for n in made), 'of_numba': of_numba,"
        " 'here': here}))"
    )
    first = run(tmp_path, code, TORCHRENDER_PLAIN_COMPILER=plain)
    again = run(tmp_path, code, TORCHRENDER_PLAIN_COMPILER=plain)
    assert first["room"] and first["of_numba"] == (plain == "1")
    for made in (first, again):
        assert made["r"] == [0.0, 0.0, 0.0] and made["here"] == [0.0, 0.0] and "negative" in str(made["told"])


def test_what_is_declared_after_the_first_kernel_is_found(tmp_path) -> None:
    (tmp_path / "late.py").write_text(LATE)
    assert run(tmp_path, "own.square(3.0); import late; print(json.dumps({'x': late.four_times(1.0)}))")["x"] == 4.0


def test_nobody_is_told_of_each_call_of_the_compiler(tmp_path) -> None:
    code = (
        "told = []\n"
        "class Locks(event.Listener):\n"
        "    def on_start(self, e): told.append(1)\n"
        "    def on_end(self, e): pass\n"
        "event.register('numba:llvm_lock', Locks())\n"
        "print(json.dumps({'x': own.square(3.0), 'told': len(told)}))"
    )
    assert run(tmp_path, code)["told"] == 0
    assert run(tmp_path, code, TORCHRENDER_PLAIN_COMPILER="1", NUMBA_CACHE_DIR=str(tmp_path / "other"))["told"] > 100


def test_an_edit_of_a_kernel_is_seen(tmp_path) -> None:
    assert run(tmp_path, SUM)["sum"] == 30.0
    (tmp_path / "own.py").write_text(KERNELS.replace("return x * x", "return x + 0 * x"))
    assert run(tmp_path, SUM)["sum"] == 10.0


def test_two_cold_processes_at_once_keep_the_right_code(tmp_path) -> None:
    """They compile the same function for different types; each file holds what its name says."""
    (tmp_path / "own.py").write_text(KERNELS)
    calls = {"float64": "own.total(v, 0)", "float32": "own.total(v.astype(np.float32), 1)"}
    given = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}", "NUMBA_CACHE_DIR": str(tmp_path / "c")}
    begin = "import numpy as np, own; v = np.arange(5.0); "
    both = [subprocess.Popen([sys.executable, "-c", begin + c], env=given, cwd=tmp_path) for c in calls.values()]
    assert [one.wait() for one in both] == [0, 0]
    code = f"print(json.dumps({{'r': [{', '.join(calls.values())}], 'n': L.n}}))"
    assert run(tmp_path, code, NUMBA_CACHE_DIR=str(tmp_path / "c")) == {"r": [30.0, 30.0], "n": 0, "stderr": ""}


def test_a_disk_that_cannot_be_written_costs_time_but_no_result(tmp_path) -> None:
    """A file stands where a folder should be: as a full or a read-only disk, it fails when code is to be kept."""
    (tmp_path / "wall").write_text("")
    made = run(tmp_path, SUM, NUMBA_CACHE_DIR=str(tmp_path / "wall"))
    assert made["sum"] == 30.0
    assert made["stderr"].count("cannot be kept") == 1, "said once, not for each kernel"


def test_damaged_files_are_compiled_again(tmp_path) -> None:
    run(tmp_path, SUM)
    files = sorted((tmp_path / "a cache").rglob("*.code"))
    assert len(files) >= 3
    for number, file in enumerate(files):
        file.write_bytes((b"", b"no code", file.read_bytes()[:100])[number % 3])
    assert run(tmp_path, SUM)["sum"] == 30.0
    assert run(tmp_path, SUM)["n"] == 0


def test_another_processor_gets_its_own_code(tmp_path) -> None:
    """A home that several machines share: code for one is not run on the other."""
    assert run(tmp_path, SUM)["n"] > 0
    other = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "+sse2"}
    made = run(tmp_path, SUM, **other)
    assert made["sum"] == 30.0 and made["n"] > 0
    assert run(tmp_path, SUM)["n"] == run(tmp_path, SUM, **other)["n"] == 0


@pytest.mark.parametrize("before", [True, False])
def test_no_garbage_is_collected_while_a_kernel_is_compiled(before, monkeypatch) -> None:
    """Afterwards it is as before, also where compiling fails and where helpers are compiled meanwhile."""
    from numba.core.registry import CPUDispatcher

    from torchrender.kernels.points.tree import levels_of

    found = []

    def compile_(_, sig):
        found.append(gc.isenabled())
        if sig == "outer":
            levels_of.compile("inner")
            found.append(gc.isenabled())
        if sig == "wrong":
            raise ValueError(sig)

    monkeypatch.setattr(CPUDispatcher, "compile", compile_)
    was = gc.isenabled()
    (gc.enable if before else gc.disable)()
    try:
        levels_of.compile("outer")
        assert found == [False] * 3 and gc.isenabled() == before
        with pytest.raises(ValueError, match="wrong"):
            levels_of.compile("wrong")
        assert gc.isenabled() == before
    finally:
        (gc.enable if was else gc.disable)()


def test_a_kernel_can_be_pickled() -> None:
    import pickle

    from torchrender.kernels.points.tree import levels_of

    assert pickle.loads(pickle.dumps(levels_of)) is levels_of


def test_libraries_are_told_only_where_they_ask(tmp_path) -> None:
    quiet = run(tmp_path, SUM)
    assert quiet["stderr"] == ""
    loud = "import logging; logging.basicConfig(level=logging.INFO, format='%(message)s')\n" + SUM
    told = run(tmp_path, loud, NUMBA_CACHE_DIR=str(tmp_path / "empty"))["stderr"]
    assert "compiling other.total, once; kept in" in told


def test_a_full_disk_is_said_once(monkeypatch, caplog) -> None:
    from torchrender.kernels import store

    def full(path: Path, _: bytes) -> None:
        raise OSError(28, "No space left on device", str(path))

    class Made:
        lifted = ()
        target_context = None

        class library:
            has_dynamic_globals = False

        def _reduce(self) -> tuple[()]:
            return ()

    monkeypatch.setattr(store, "write_whole", full)
    monkeypatch.setattr(store, "_unwritable", [])
    monkeypatch.setattr(store.CodeStore, "file_name", lambda *_: "x/y.code")
    kept = store.CodeStore("x.y", "key")
    with caplog.at_level(logging.WARNING):
        kept.save_overload((), Made())
        kept.save_overload((), Made())
    assert len(caplog.records) == 1 and "No space left" in caplog.text


def test_a_slow_disk_is_named_once(monkeypatch, caplog, tmp_path) -> None:
    """Pictures come all the same; who waits for them learns why."""
    from torchrender.kernels import store

    monkeypatch.setattr(store, "_slow", set())
    for took in (0.1, 3.0, 4.0):
        store._note_slow(tmp_path, took)
    assert len(caplog.records) == 1 and f"read slowly from {tmp_path} (3.0 s for one)" in caplog.text


def test_files_appear_whole(tmp_path, monkeypatch) -> None:
    from torchrender.kernels import store

    store.write_whole(tmp_path / "a" / "b.code", b"all of it")
    assert (tmp_path / "a" / "b.code").read_bytes() == b"all of it"

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(store.os, "replace", stopped)
    with pytest.raises(KeyboardInterrupt):
        store.write_whole(tmp_path / "a" / "c.code", b"x")
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["b.code"]


def test_helpers_are_linked_and_not_compiled() -> None:
    """With the versions that the constraints pin; a new one needs a look before it is added."""
    from torchrender.kernels import libraries

    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = tuple(
        line.split("==")[1] for name in ("numba", "llvmlite") for line in lines if line.startswith(f"{name}==")
    )
    assert pinned in libraries.TESTED
