"""Batches over processes and over Ray's actors: how quick, and what is lost or doubled when something is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from torchrender.batch import Job, Outcome, SceneSource, run
from torchrender.batch.job import MANIFEST
from torchrender.errors import TorchRenderError
from torchrender.report.distributed.cluster import command_line, cpu_s, descendants
from torchrender.scene.cameras.path import built_in_path
from torchrender_service.load_test.rows import Row

WAIT_S = 120.0


@dataclass(frozen=True, kw_only=True)
class BatchEffort:
    """How much is made."""

    scene: str = "washroom"
    size: int = 384
    cameras: int = 48
    chunk: int = 2


QUICK = BatchEffort(scene="city", size=96, cameras=24)


def job_of(effort: BatchEffort) -> Job:
    """Pictures on a swing about a scene."""
    source = SceneSource(effort.scene)
    scene = source.load()
    cameras = built_in_path(scene, "orbit").cameras(
        effort.cameras, width=effort.size, height=effort.size, near=1e-3 * scene.diagonal
    )
    return Job(source, cameras, chunk=effort.chunk, wishes={"supersample": 2})


@dataclass(frozen=True)
class Told:
    """Of progress: when, what this process and those below it have used by then, both in seconds, and pictures done."""

    at: float
    cpu_s: float
    done: int


class Clock:
    """Told of progress; knows when work began to come, and the rate from then on."""

    def __init__(self) -> None:
        self.begin = time.perf_counter()
        self.told: list[Told] = []

    def __call__(self, done: int, total: int) -> None:
        del total
        self.told.append(Told(time.perf_counter(), cpu_s(os.getpid()), done))

    @property
    def _steady(self) -> tuple[Told, Told]:
        """The first chunk and, while all workers are still there, the last one."""
        came = [one for one in self.told if one.done]
        return came[0], came[-1]

    @property
    def first_s(self) -> float:
        """Until the first chunk was done."""
        return self._steady[0].at - self.begin

    @property
    def rate(self) -> float:
        """Pictures a second from the first chunk to the last."""
        first, last = self._steady
        return (last.done - first.done) / (last.at - first.at)

    @property
    def cores(self) -> float:
        """Busy ones, in the middle, in the same time."""
        first, last = self._steady
        return (last.cpu_s - first.cpu_s) / (last.at - first.at)


def local_record(effort: BatchEffort) -> dict[str, Any]:
    """One process with two threads, and two with one each."""
    job, found = job_of(effort), {}
    with tempfile.TemporaryDirectory() as folder:
        for workers in (1, 2):
            clock = Clock()
            out = Path(folder) / str(workers)
            outcome = run(job, out, workers=workers, tell=clock)
            found[str(workers)] = {"rate": clock.rate, "first_s": clock.first_s, "cameras": outcome.cameras}
            found[str(workers)]["cores"] = clock.cores
        same = digests(Path(folder) / "1") == digests(Path(folder) / "2")
    return {"workers": found, "same": same, "cameras": len(job.cameras)}


def local_rows(parts: dict[str, Any]) -> list[Row]:
    """As the page has them."""
    record = parts["batch"]
    one, two = (record["workers"][n]["rate"] for n in ("1", "2"))
    found = [record["workers"][n] for n in ("1", "2")]
    busy = " and ".join(f"{each['cores']:.2f}" for each in found)
    spent = " and ".join(f"{each['cores'] / each['rate']:.2f} s" for each in found)
    return [
        Row(
            what="two workers against one process with two threads, pictures/s from the first chunk on",
            goal="≥ 1.7×",
            measured=f"{two:.2f} against {one:.2f}: {two / one:.2f}×; {busy} cores busy, {spent} of a core a picture",
            met=two >= 1.7 * one,
        ),
        _same_row("results of one and of two workers", record),
    ]


def _same_row(what: str, record: dict[str, Any]) -> Row:
    measured = "the same" if record["same"] else "they differ"
    return Row(what=what, goal="the same, bit for bit", measured=measured, met=record["same"])


def ray_record(effort: BatchEffort) -> dict[str, Any]:
    """The pool of this machine and Ray's actors, one after the other.

    Raises:
        MissingExtraError: Ray is not installed.
    """
    from torchrender.batch.on_ray import run_on_ray

    job, found = job_of(effort), {}
    with tempfile.TemporaryDirectory() as folder:
        for name, make in (("pool", run), ("ray", run_on_ray)):
            clock = Clock()
            make(job, Path(folder) / name, workers=2, tell=clock)
            making = records(Path(folder) / name)[0]["ms"] / 1e3
            found[name] = {"rate": clock.rate, "first_s": clock.first_s, "start_s": clock.first_s - making}
        same = digests(Path(folder) / "pool") == digests(Path(folder) / "ray")
    return {**found, "same": same}


def ray_rows(parts: dict[str, Any]) -> list[Row]:
    """As the page has them."""
    record = parts["ray-batch"]
    pool, on_ray = record["pool"], record["ray"]
    return [
        Row(
            what="two actors of Ray Data against the pool of two processes, pictures/s from the first chunk on",
            goal="≥ 0.9×",
            measured=f"{on_ray['rate']:.2f} against {pool['rate']:.2f}: {on_ray['rate'] / pool['rate']:.2f}×",
            met=on_ray["rate"] >= 0.9 * pool["rate"],
        ),
        Row(
            what="from the call until the first chunk that gets done is begun, a cluster of its own included",
            goal="≤ 20 s",
            measured=f"{_begin(on_ray)} (pool: {_begin(pool)})",
            met=on_ray["start_s"] <= 20.0,
        ),
        _same_row("results of Ray Data and of the pool", record),
    ]


def _begin(found: dict[str, Any]) -> str:
    return f"{found['start_s']:.1f} s, done after {found['first_s']:.1f} s"


def killed_record(effort: BatchEffort) -> dict[str, Any]:
    """What is killed, and what is then there and was made twice."""
    job, found = job_of(effort), {}
    with tempfile.TemporaryDirectory() as folder:
        wanted = Path(folder) / "wanted"
        run(job, wanted, workers=2)
        ways = ["worker", "driver"]
        if find_spec("ray") is not None:
            ways += ["actor", "driver of Ray"]
        for way in ways:
            out = Path(folder) / way.replace(" ", "-")
            with started(effort, out, on_ray=way in ("actor", "driver of Ray")) as driver:
                wait_for(out, job.chunks // 4)
                before = len(chunks(out))
                if way.startswith("driver"):
                    driver.kill()
                    driver.wait()
                else:
                    os.kill(worker_of(driver.pid), signal.SIGKILL)
                    driver.wait(WAIT_S)
            if way.startswith("driver"):
                with started(effort, out, on_ray="Ray" in way) as driver:
                    driver.wait(WAIT_S)
            made = chunks(out)
            whole = digests(out) == digests(wanted)
            found[way] = {"before": before, "chunks": len(made), "twice": len(made) - len(set(made)), "same": whole}
    return {"chunks": job.chunks, "killed": found}


def killed_rows(parts: dict[str, Any]) -> list[Row]:
    """As the page has them."""
    record = parts["killed"]
    rows = []
    for way, found in record["killed"].items():
        lost = record["chunks"] - (found["chunks"] - found["twice"])
        then = ", then started again" if way.startswith("driver") else ""
        rows.append(
            Row(
                what=f"{way} killed after {found['before']} of {record['chunks']} chunks{then}",
                goal="nothing lost, nothing doubled",
                measured=f"{lost} lost, {found['twice']} doubled, {'the same' if found['same'] else 'other'} bytes",
                met=lost == 0 and found["twice"] == 0 and found["same"],
            )
        )
    return rows


@contextmanager
def started(effort: BatchEffort, out: Path, *, on_ray: bool) -> Iterator[subprocess.Popen[bytes]]:
    """The command in a process of its own."""
    command = [sys.executable, "-m", "torchrender.report.distributed.driver", str(out), "ray" if on_ray else "pool"]
    command += [effort.scene, *map(str, (effort.size, effort.cameras, effort.chunk))]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def worker_of(pid: int) -> int:
    """A process that makes chunks."""
    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        for one in descendants(pid):
            words = command_line(one)
            if words.startswith("ray::MapWorker") or "torchrender.batch.worker" in words:
                return one
        time.sleep(0.02)
    raise TorchRenderError("no process makes chunks")


def wait_for(out: Path, count: int) -> None:
    """Until so many chunks are done."""
    end = time.monotonic() + WAIT_S
    while len(chunks(out)) < count:
        if time.monotonic() > end:
            raise TorchRenderError(f"{len(chunks(out))} chunks in {WAIT_S:g} s, {count} were waited for")
        time.sleep(0.02)


def records(out: Path) -> list[dict[str, Any]]:
    """Of the chunks that are done."""
    try:
        text = (out / MANIFEST).read_text()
    except FileNotFoundError:
        return []
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]


def chunks(out: Path) -> list[int]:
    """Their numbers."""
    return [record["chunk"] for record in records(out)]


def digests(out: Path) -> dict[str, str]:
    """Of all files."""
    return {file["file"]: file["sha256"] for record in records(out) for file in record["files"]}


def drive(words: Sequence[str]) -> Outcome:
    """Make a batch: folder, "pool" or "ray", scene, size, cameras, cameras of a chunk."""
    out, how, scene, *numbers = words
    size, cameras, chunk = map(int, numbers)
    job = job_of(BatchEffort(scene=scene, size=size, cameras=cameras, chunk=chunk))
    if how == "pool":
        return run(job, out, workers=2)
    from torchrender.batch.on_ray import run_on_ray

    return run_on_ray(job, out, workers=2)
