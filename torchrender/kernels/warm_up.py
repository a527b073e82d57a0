"""Compiles what is recorded before it is needed, in as many processes as there are cores."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from torchrender.kernels.keys import cache_folder
from torchrender.kernels.signatures import Use, kernel_of, recorded, types_of
from torchrender.kernels.store import UNFINISHED

LOG = logging.getLogger("torchrender.kernels")
MAX_PROCESSES = 8
"""Each takes some 300 MB."""
OLD_S = 3600.0
"""A file that is unfinished for so long was left by a process that was stopped."""

Tell = Callable[[int, int], None]
"""Told how many kernels are done, and how many there are."""


@dataclass(frozen=True)
class Outcome:
    """What a warm-up did."""

    compiled: int
    failed: tuple[str, ...]  # kernel: reason


def missing(parts: Iterable[str] = ()) -> list[Use]:
    """Recorded uses for these parts, or for all, whose code is not on disk."""
    wanted = frozenset(parts)
    return [use for use in recorded() if (not wanted or use.serves(wanted)) and not _is_kept(use)]


def expected_seconds(uses: Iterable[Use]) -> float:
    """Rough time to compile these side by side, from where they were recorded."""
    return sum(use.seconds for use in uses) / process_count()


def process_count() -> int:
    """Processes that compile at once."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(cores, MAX_PROCESSES))


def warm_up(uses: list[Use], tell: Tell | None = None, *, processes: int | None = None) -> Outcome:
    """Compile these kernels and keep them on disk.

    What is there is not compiled again, so a warm-up that was stopped goes on where it was. Where no process can be
    started, this one compiles.

    Args:
        tell: called from this thread, first with 0.
        processes: as many; default: one for each core.
    """
    _remove_unfinished()
    work = _Work(uses, tell)
    work.report()
    if uses:
        count = min(process_count() if processes is None else processes, len(uses))
        threads = [threading.Thread(target=work.drive, daemon=True) for _ in range(count)]
        for thread in threads:
            thread.start()
        try:
            while any(thread.is_alive() for thread in threads):
                if work.changed.wait(0.5):
                    work.changed.clear()
                    work.report()
        finally:
            work.stop()
        work.report()
    return Outcome(work.done - len(work.failed), tuple(work.failed))


@dataclass(eq=False)
class _Work:
    """What is still to be compiled, shared by the threads that each talk to one process."""

    uses: list[Use]
    tell: Tell | None
    done: int = 0
    failed: list[str] = field(default_factory=list)
    changed: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self._lock = threading.Lock()
        self._groups: dict[str, list[Use]] = defaultdict(list)
        for use in sorted(self.uses, key=lambda one: one.seconds):
            self._groups[use.module].append(use)
        self._taken: set[str] = set()
        self._processes: list[subprocess.Popen[str]] = []
        self._stopped = False

    def report(self) -> None:
        """Tell how far it is."""
        if self.tell is not None:
            self.tell(self.done, len(self.uses))

    def drive(self) -> None:
        """Start a process and give it one kernel after the other."""
        module: str | None = None
        process = self._start()
        while True:
            module, use = self._next(module)
            if use is None:
                break
            try:
                failure = _compile_here(use) if process is None else _ask(process, use)
            except (OSError, ValueError) as error:
                if self._stopped:
                    return
                failure = f"the process that compiled it ended ({error})"
                process = self._start()
            with self._lock:
                self.done += 1
                if failure:
                    self.failed.append(f"{use.kernel}: {failure}")
            self.changed.set()
        if process is not None and process.stdin is not None:
            with contextlib.suppress(OSError):
                process.stdin.close()

    def stop(self) -> None:
        """End all processes; what they have compiled is kept."""
        with self._lock:
            self._stopped = True
            processes = list(self._processes)
        for process in processes:
            if process.poll() is None and self.done < len(self.uses):
                process.kill()
            with contextlib.suppress(OSError):
                process.stdout and process.stdout.close()
            process.wait()

    def _start(self) -> subprocess.Popen[str] | None:
        """A process that is ready; None where none can be started."""
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "torchrender.kernels.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=_environment(),
            )
        except (OSError, ValueError) as error:
            LOG.info("no process can be started to compile kernels: %s", error)
            return None
        with self._lock:
            stopped = self._stopped
            self._processes.append(process)
        if stopped:
            process.kill()
        assert process.stdout is not None
        return process if process.stdout.readline() else None

    def _next(self, module: str | None) -> tuple[str | None, Use | None]:
        """The longest kernel of the same module, whose helpers the process has; else of the module with most left."""
        with self._lock:
            if self._stopped:
                return None, None
            left = {name: uses for name, uses in self._groups.items() if uses}
            if not left:
                return None, None
            if module not in left:
                fresh = {name: uses for name, uses in left.items() if name not in self._taken}
                module = max(fresh or left, key=lambda name: sum(use.seconds for use in left[name]))
            self._taken.add(module)
            return module, left[module].pop()


def _ask(process: subprocess.Popen[str], use: Use) -> str | None:
    """Why a process could not compile a kernel; None where it could."""
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(json.dumps({"kernel": use.kernel, "types": use.arguments}) + "\n")
    process.stdin.flush()
    line = process.stdout.readline()
    if not line:
        raise OSError(f"exit status {process.wait()}")
    return json.loads(line).get("failed")


def _compile_here(use: Use) -> str | None:
    try:
        kernel_of(use).compile(types_of(use))
    except Exception as error:  # as in a process of its own: reported
        return f"{type(error).__name__}: {error}"
    return None


def _is_kept(use: Use) -> bool:
    try:
        return kernel_of(use).is_kept(types_of(use))
    except (ImportError, AttributeError, TypeError):
        return True  # a kernel that this installation lacks cannot be compiled either


def _environment() -> dict[str, str]:
    """Of the processes: they find this package where this process found it, and no secrets."""
    here = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    path = os.pathsep.join(p for p in (here, os.environ.get("PYTHONPATH", "")) if p)
    return {k: v for k, v in os.environ.items() if k != "TORCHRENDER_API_KEY"} | {"PYTHONPATH": path}


def _remove_unfinished() -> None:
    """What processes left that were stopped while they wrote."""
    with contextlib.suppress(OSError):
        for file in cache_folder().glob(f"*/*{UNFINISHED}"):
            with contextlib.suppress(OSError):
                if time.time() - file.stat().st_mtime > OLD_S:
                    file.unlink()


def main(parts: list[str]) -> int:
    """Compile for these parts; progress as lines of JSON on standard output, for a process that knows no numba."""

    def tell(done: int, total: int) -> None:
        sys.stdout.write(json.dumps({"done": done, "total": total}) + "\n")
        sys.stdout.flush()

    outcome = warm_up(missing(parts), tell)
    for failure in outcome.failed:
        sys.stderr.write(f"{failure}\n")
    return 0


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stderr.flush()
    os._exit(code)
