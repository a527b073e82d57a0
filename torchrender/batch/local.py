"""A batch over processes of this machine."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchrender.batch.digest import scene_digest
from torchrender.batch.folder import alone_in, note, open_folder
from torchrender.batch.job import Job
from torchrender.batch.said import Said, note_said, say_all
from torchrender.errors import OptionError, TorchRenderError

TRIES = 3
"""How often a chunk is begun: a process that ends may have been killed for what somebody else did."""
MAX_WORKERS = 256
PATIENCE = 20.0
"""A process that takes so many times as long as the slowest chunk so far has hung, and is killed."""
LEAST_S, FIRST_S = 60.0, 3600.0
"""But it has at least so long, and until a chunk is done."""

Tell = Callable[[int, int], None]
"""Told how many cameras are done, and how many there are."""


@dataclass(frozen=True)
class Outcome:
    """What a run did."""

    cameras: int  # that are on disk now
    made: int  # of them by this run
    failed: dict[int, str]  # chunk: reason
    restarts: int  # of processes that ended


class BatchError(TorchRenderError):
    """A batch that cannot go on; what was made stays, and the same call goes on from there."""


def run(job: Job, folder: str | Path, *, workers: int | None = None, tell: Tell | None = None) -> Outcome:
    """Make what a job asks for, or what is left of it.

    The results are the same for every number of workers, bit for bit: a chunk is always made by one process from
    nothing. A worker that is killed, or hangs, loses the chunk that it was at, which another makes; a run that is
    killed goes on when it is called again.

    Args:
        folder: for the results; made where it does not exist.
        workers: processes; default: one for each core. The cores are shared out among them.
        tell: progress.

    Raises:
        OptionError: workers not in [1, MAX_WORKERS]. InputError: the folder holds another batch, another
            process writes there, or the scene changed.
        BatchError: no process can work on: a full disk, a scene that cannot be read any more.
        ImageFileError: the folder cannot be written.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    count = cores if workers is None else workers
    if not 1 <= count <= MAX_WORKERS:
        raise OptionError(f"workers must be in [1, {MAX_WORKERS}], got {workers}")
    folder = Path(folder)
    with alone_in(folder):
        left, done = begin(job, folder, tell)
        if not left:
            return Outcome(done, 0, {}, 0)
        return _Pool(job, folder, done, tell).work(left, min(count, len(left)), max(1, cores // count))


def begin(job: Job, folder: Path, tell: Tell | None) -> tuple[list[int], int]:
    """Open the folder; chunks that are left, and how many cameras are done."""
    there = open_folder(folder, job, scene_digest(job.scene.load()))
    done = sum(len(job.rows(chunk)) for chunk in there)
    if tell is not None:
        tell(done, len(job.cameras))
    return [chunk for chunk in range(job.chunks) if chunk not in there], done


class _Pool:
    def __init__(self, job: Job, folder: Path, done: int, tell: Tell | None) -> None:
        self._job, self._folder, self._done, self._tell = job, folder, done, tell
        self._made = self._restarts = 0
        self._failed: dict[int, str] = {}
        self._wall = ""  # why nothing can go on
        self._slowest_s: float | None = None  # of the chunks that are done
        self._tries: dict[int, int] = {}
        self._said: Said = {}
        self._left: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._processes: set[subprocess.Popen[str]] = set()

    def work(self, chunks: list[int], workers: int, threads: int) -> Outcome:
        for chunk in chunks:
            self._left.put(chunk)
        drivers = [threading.Thread(target=self._drive, args=(threads,), daemon=True) for _ in range(workers)]
        for driver in drivers:
            driver.start()
        try:
            for driver in drivers:
                while driver.is_alive():
                    driver.join(0.2)
        except BaseException:
            self._stop("interrupted")
            raise
        if self._wall:
            raise BatchError(f"{self._wall}; {self._done} of {len(self._job.cameras)} cameras are done and stay")
        say_all(self._said)
        return Outcome(self._done, self._made, self._failed, self._restarts)

    def _drive(self, threads: int) -> None:
        """Give a process one chunk after the other; another process where it ends."""
        process: subprocess.Popen[str] | None = None
        while not self._wall:
            try:
                chunk = self._left.get_nowait()
            except queue.Empty:
                break
            process = process or self._start(threads)
            if process is None:
                break
            answer = self._asked(process, chunk)
            if answer is None:
                self._lost(process, chunk)
                process = None
            elif "failed" in answer:
                self._refused(answer, chunk)
            else:
                self._note(answer)
        if process is not None:
            self._end(process)

    def _asked(self, process: subprocess.Popen[str], chunk: int) -> dict[str, Any] | None:
        """The answer; None where the process has ended, or hung and was killed."""
        begin = time.monotonic()
        alarm = threading.Timer(self._patience_s, process.kill)
        alarm.daemon = True
        alarm.start()
        try:
            answer = _ask(process, str(chunk))
        finally:
            alarm.cancel()
        if answer is not None:
            self._slowest_s = max(self._slowest_s or 0.0, time.monotonic() - begin)
        return answer

    @property
    def _patience_s(self) -> float:
        return FIRST_S if self._slowest_s is None else max(LEAST_S, PATIENCE * self._slowest_s)

    def _start(self, threads: int) -> subprocess.Popen[str] | None:
        command = [sys.executable, "-m", "torchrender.batch.worker", str(self._folder), str(threads)]
        pipe = subprocess.PIPE
        try:
            process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=_environment(threads))
        except OSError as error:
            self._stop(f"no process can be started ({error})")
            return None
        with self._lock:
            self._processes.add(process)
        answer = _answer(process)
        if answer is None:
            self._stop(f"a worker ended before it began, exit status {process.wait()}")
        elif "failed" in answer:
            self._stop(str(answer["failed"]))
        else:
            return process
        return None

    def _lost(self, process: subprocess.Popen[str], chunk: int) -> None:
        self._end(process)
        with self._lock:
            self._restarts += 1
            self._tries[chunk] = self._tries.get(chunk, 0) + 1
            if self._tries[chunk] < TRIES:
                self._left.put(chunk)
            else:
                self._failed[chunk] = f"the process that made it ended {TRIES} times, exit status {process.returncode}"

    def _refused(self, answer: dict[str, Any], chunk: int) -> None:
        if answer.get("for_all"):
            self._stop(str(answer["failed"]))
        with self._lock:
            self._failed[chunk] = str(answer["failed"])

    def _note(self, record: dict[str, Any]) -> None:
        with self._lock:
            try:
                note(self._folder, record)
            except OSError as error:
                self._wall = self._wall or f"{self._folder}: {error}"
                return
            count = len(self._job.rows(record["chunk"]))
            self._done += count
            self._made += count
            note_said(self._said, record)
            if self._tell is not None:
                self._tell(self._done, len(self._job.cameras))

    def _stop(self, why: str) -> None:
        with self._lock:
            self._wall = self._wall or why
            running = list(self._processes)
        for process in running:
            with contextlib.suppress(OSError):
                process.kill()

    def _end(self, process: subprocess.Popen[str]) -> None:
        for stream in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                stream and stream.close()
        process.wait()
        with self._lock:
            self._processes.discard(process)


def _ask(process: subprocess.Popen[str], line: str) -> dict[str, Any] | None:
    assert process.stdin is not None
    try:
        process.stdin.write(line + "\n")
        process.stdin.flush()
    except OSError:
        return None
    return _answer(process)


def _answer(process: subprocess.Popen[str]) -> dict[str, Any] | None:
    """The next line; None where the process has ended."""
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        return dict(json.loads(line)) if line.endswith("\n") else None
    except (OSError, ValueError):
        return None


def _environment(threads: int) -> dict[str, str]:
    """Processes find this package where this one found it, and start no more threads than they are to use."""
    here = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(p for p in (here, os.environ.get("PYTHONPATH", "")) if p)
    limits = {name: str(threads) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS")}
    return {**os.environ, **limits, "OMP_WAIT_POLICY": "PASSIVE", "PYTHONPATH": path}
