"""A copy of the tree in which faults are seeded, and the tests run in a process of their own for each."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path

PAGE = "service/torchrender_service/static"
BUNDLES = {"page.js": "../js/main.js", "decode-worker.js": "../js/decode-worker.js", "fog.js": "../js/fog/main.js"}
"""The copy serves the page's modules as they are in place of bundles of them."""

CAUGHT, SURVIVED, ENDLESS, UNUSABLE = "caught", "survived", "endless", "unusable"
_MEANING = {0: SURVIVED, 1: CAUGHT, 2: CAUGHT}  # of pytest's exit status: passed, failed, not even collected


class Bench:
    """The copy, kept from run to run with the bytecode that it holds; another process takes another."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self._lock = _own(folder)
        listed = subprocess.run(
            ["git", "ls-files", "-z", "-c", "-o", "--exclude-standard"],
            cwd=root, capture_output=True, check=True, text=True,
        ).stdout  # fmt: skip
        bundles = {f"{PAGE}/bundle/{name}": f'import "{source}";\n' for name, source in BUNDLES.items()}
        names = {name for name in listed.split("\0") if name and (root / name).is_file()} - set(bundles)
        for path in [path for path in self.root.rglob("*") if path.is_file() and "__pycache__" not in path.parts]:
            if str(path.relative_to(self.root)) not in names:
                path.unlink()
        for name in names:
            _copy(root / name, self.root / name)
        for name, text in bundles.items():
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            (self.root / name).write_text(text)
        os.environ.setdefault("TORCHRENDER_DATA", str(root.parent / "shared" / "data"))
        self._stamp = time.time()

    def run(self, file: str | None, text: str, tests: str, limit_s: float) -> tuple[str, str]:
        """What became of the tests with ``text`` in ``file``, and the end of what they said."""
        if file is None:
            return self._run(tests, limit_s)
        path = self.root / file
        before, times = path.read_bytes(), path.stat()
        try:
            path.write_text(text)
            # Bytecode is known by whole seconds: no two versions of a file may share one.
            self._stamp += 2
            os.utime(path, (self._stamp, self._stamp))
            return self._run(tests, limit_s)
        finally:
            path.write_bytes(before)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            for bytecode in path.parent.glob(f"__pycache__/{path.stem}.*.pyc"):
                bytecode.unlink()

    def _run(self, tests: str, limit_s: float) -> tuple[str, str]:
        told = self.root / "told.txt"
        child = os.fork()
        if child == 0:
            os.setsid()
            _become(self.root, told, arguments(tests))
        status = _ended(child, time.monotonic() + limit_s)
        said = told.read_text(errors="replace")[-1500:] if told.exists() else ""
        if status is None:
            return ENDLESS, said
        code = os.waitstatus_to_exitcode(status)
        # Ended by a signal: memory that is not there was written.
        return _MEANING.get(code, CAUGHT if code < 0 else UNUSABLE), said


def _own(folder: Path) -> tuple[Path, int]:
    """The first copy that no other process works in, and what says so while it is open."""
    folder.mkdir(parents=True, exist_ok=True)
    number = 0
    while True:
        lock = os.open(folder / f"{number}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC)
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            (folder / str(number)).mkdir(exist_ok=True)
            return folder / str(number), lock
        os.close(lock)
        number += 1


def _copy(source: Path, target: Path) -> None:
    """Unless it is there: a fault that a stopped run left has another time."""
    told = source.stat()
    if target.is_file() and (target.stat().st_mtime_ns, target.stat().st_size) == (told.st_mtime_ns, told.st_size):
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(source, target)


def arguments(tests: str) -> list[str]:
    """Of pytest; an expression behind ``-k`` keeps its blanks."""
    files, _, expression = tests.partition(" -k ")
    return [*files.split(), *(["-k", expression] if expression else [])]


def _become(root: Path, told: Path, given: Sequence[str]) -> None:
    """Turn this forked process into a test run in the copy; torch is imported already, torchrender is not."""
    os.chdir(root)
    out = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(out, 1)
    os.dup2(out, 2)
    os.environ["PYTHONPATH"] = f"{root}{os.pathsep}{root / 'service'}"
    sys.path[:0] = [str(root), str(root / "service")]
    code = 3
    try:
        import pytest

        code = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "--no-header", *given]))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(code)


def _ended(child: int, deadline: float) -> int | None:
    """Exit status; None if it had to be stopped. What it started ends with it."""
    status = None
    try:
        while time.monotonic() < deadline:
            done, found = os.waitpid(child, os.WNOHANG)
            if done:
                status = found
                break
            time.sleep(0.05)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        if status is None:
            os.waitpid(child, 0)
    return status
