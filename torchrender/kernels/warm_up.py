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
from dataclasses import dataclass
from typing import Any

from torchrender.kernels.pruning import prune
from torchrender.kernels.signatures import Use, kernel_of, recorded, types_of

LOG = logging.getLogger("torchrender.kernels")
MAX_PROCESSES = 8
"""Each takes some 300 MB."""
IDLE_S = 1.0
"""Processes that have nothing to do for so long end: more work may come from a plan that is being made."""
POLL_S = 0.2
"""Between looks at what another process compiles."""
GENTLY = 3
"""Niceness of processes that compile what nobody waits for yet: little more than that of renderers, which may come to
wait for them on a busy machine."""

Tell = Callable[[int, int], None]
"""Told how many kernels are done, and how many there are."""
Answer = dict[str, Any]
"""``made`` (false where another process did it), ``busy`` (one is at it) or ``failed`` with the reason."""


@dataclass(frozen=True)
class Outcome:
    """What a warm-up did."""

    compiled: int  # here, not by other processes meanwhile
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

    What is there is not compiled again, so a warm-up that was stopped goes on where it was; what another process is
    compiling is waited for. Where no process can be started, this one compiles.

    Args:
        tell: called first with 0, from any thread, one at a time.
        processes: as many; default: one for each core.
    """
    prune()
    work = Compilation(tell, processes=processes)
    try:
        work.add(uses)
        return work.wait()
    finally:
        work.stop()


class Compilation:
    """Kernels being compiled by processes of their own, while this process does something else."""

    def __init__(self, tell: Tell | None = None, *, processes: int | None = None) -> None:
        self._tell = tell
        self._most = process_count() if processes is None else processes
        self._changed = threading.Condition()
        self._known: set[tuple[str, str]] = set()
        self._groups: dict[str, list[Use]] = defaultdict(list)
        self._urgent: list[Use] = []  # somebody waits for them
        self._elsewhere: list[Use] = []  # another process compiles them
        self._at_work: list[Use] = []
        self._taken: set[str] = set()
        self._processes: list[subprocess.Popen[str]] = []
        self._threads = 0
        self._stopped = False
        self._done = self._made = 0
        self._failed: list[str] = []

    def add(self, uses: Iterable[Use]) -> None:
        """Compile these, too."""
        with self._changed:
            for use in sorted(uses, key=lambda one: one.seconds):
                if (use.kernel, use.arguments) not in self._known:
                    self._known.add((use.kernel, use.arguments))
                    self._groups[use.module].append(use)
            self._report()
            waiting = sum(len(group) for group in self._groups.values())
            for _ in range(min(self._most, self._threads + waiting) - self._threads):
                self._threads += 1
                threading.Thread(target=self._drive, daemon=True).start()

    def wait_for(self, kernel: str) -> bool:
        """Have this kernel compiled next, and wait until nothing of it is left to do; False if nothing was."""
        with self._changed:
            if not any(use.kernel == kernel for use in self._left()):
                return False
            for name, group in self._groups.items():
                self._urgent += [use for use in group if use.kernel == kernel]
                self._groups[name] = [use for use in group if use.kernel != kernel]
            while self._threads and any(use.kernel == kernel for use in self._left()):
                self._changed.wait(0.5)  # a wait without end could not be interrupted everywhere
            return True

    def wait(self) -> Outcome:
        """Until all is done."""
        with self._changed:
            while self._threads and self._left():
                self._changed.wait(0.5)
            left = [f"{use.kernel}: what compiled it ended" for use in self._left()]
            return Outcome(self._made, (*self._failed, *left))

    def stop(self) -> None:
        """End all processes; what they have compiled is kept."""
        with self._changed:
            self._stopped = True
            left, processes = bool(self._left()), list(self._processes)
            self._changed.notify_all()
        for process in processes:
            if left and process.poll() is None:
                process.kill()
            with contextlib.suppress(OSError):
                process.stdout and process.stdout.close()
            process.wait()

    def _left(self) -> list[Use]:
        waiting = [use for group in self._groups.values() for use in group]
        return [*self._at_work, *self._urgent, *self._elsewhere, *waiting]

    def _report(self) -> None:
        if self._tell is not None and not self._stopped:
            try:
                self._tell(self._done, len(self._known))
            except OSError:  # nobody reads it any more
                self._tell = None

    def _drive(self) -> None:
        try:
            self._compile()
        except Exception:
            LOG.exception("compiling kernels")
            with self._changed:
                self._threads -= 1
                self._changed.notify_all()

    def _compile(self) -> None:
        """Start a process and give it one kernel after the other."""
        module: str | None = None
        process = self._start()
        while (use := self._next(module)) is not None:
            module = use.module
            try:
                answer = _compile_here(use) if process is None else _ask(process, use)
            except (OSError, ValueError) as error:
                if self._stopped:
                    break
                answer = {"failed": f"the process that compiled it ended ({error})"}
                process = self._start()
            self._note(use, answer)
        if process is not None and process.stdin is not None:
            with contextlib.suppress(OSError):
                process.stdin.close()

    def _note(self, use: Use, answer: Answer) -> None:
        with self._changed:
            self._at_work.remove(use)
            if "busy" in answer:
                self._elsewhere.append(use)
            else:
                self._done += 1
                self._made += bool(answer.get("made"))
                if "failed" in answer:
                    self._failed.append(f"{use.kernel}: {answer['failed']}")
                self._report()
            self._changed.notify_all()

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
        with self._changed:
            stopped = self._stopped
            self._processes.append(process)
        if stopped:
            process.kill()
        assert process.stdout is not None
        try:
            return process if process.stdout.readline() else None
        except ValueError:  # closed meanwhile
            return None

    def _next(self, module: str | None) -> Use | None:
        """What somebody waits for; else the longest kernel of the same module, whose helpers the process has; else of
        the module with most left.

        Then what other processes had begun, should they not end it; None after a while without work.
        """
        with self._changed:
            end = time.monotonic() + IDLE_S
            while not self._stopped:
                if self._urgent:
                    return self._begin(self._urgent.pop(0))
                left = {name: uses for name, uses in self._groups.items() if uses}
                if left:
                    if module not in left:
                        fresh = {name: uses for name, uses in left.items() if name not in self._taken}
                        module = max(fresh or left, key=lambda name: sum(use.seconds for use in left[name]))
                    self._taken.add(module)
                    return self._begin(left[module].pop())
                if self._elsewhere:
                    self._changed.wait(POLL_S)
                    if self._elsewhere:
                        return self._begin(self._elsewhere.pop(0))
                elif time.monotonic() > end:
                    break
                else:
                    self._changed.wait(0.5)
            self._threads -= 1
            return None

    def _begin(self, use: Use) -> Use:
        self._at_work.append(use)
        return use


def _ask(process: subprocess.Popen[str], use: Use) -> Answer:
    """What a process says that was asked to compile a kernel."""
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(json.dumps({"kernel": use.kernel, "types": use.arguments}) + "\n")
    process.stdin.flush()
    line = process.stdout.readline()
    if not line:
        raise OSError(f"exit status {process.wait()}")
    return dict(json.loads(line))


def _compile_here(use: Use) -> Answer:
    try:
        kernel_of(use).compile(types_of(use))
    except Exception as error:  # as in a process of its own: reported
        return {"failed": f"{type(error).__name__}: {error}"}
    return {"made": True}


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


def main(parts: list[str]) -> int:
    """Compile for one of these parts after the other; progress, and what failed, as lines of JSON on standard output.

    They are for a process that knows no numba. The first part is waited for; the others are compiled with whatever
    time is left.
    """
    for number, part in enumerate(parts):
        if number == 1 and hasattr(os, "nice"):
            os.nice(GENTLY)

        def tell(done: int, total: int, part: str = part) -> None:
            _say({"part": part, "done": done, "total": total})

        for failure in warm_up(missing([part]), tell).failed:
            with contextlib.suppress(OSError):  # nobody reads it any more
                _say({"part": part, "failed": failure})
    return 0


def _say(told: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(told) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stderr.flush()
    os._exit(code)
