"""Reads damaged files in processes of their own: ``python -m torchrender.report.fuzz --count 100000``.

Each file must give a scene, a picture or one of the package's errors within ``--seconds``, and the process that reads
it must not need more than ``--megabytes`` beyond what it needed at its start. Whatever else happens is printed with the
name and number of the file, from which :func:`~torchrender.report.fuzz.mutate.mutated` makes it again.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
import warnings
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from torchrender.report.fuzz.mutate import mutated
from torchrender.report.fuzz.seeds import picture, seeds

SECONDS = 5.0
MEGABYTES = 1024.0
START_SECONDS = 120.0
PICTURES = (".png", ".jpg", ".webp", ".bmp", ".tga", ".hdr", ".exr", ".ktx2")


@dataclass
class Outcome:
    """What became of the files of one kind."""

    name: str
    count: Counter[str] = field(default_factory=Counter)  # "read" or the name of an error
    failures: list[tuple[int, str]] = field(default_factory=list)  # number of the file, what happened
    slowest_s: float = 0.0
    most_megabytes: float = 0.0

    @property
    def files(self) -> int:
        """How many were read."""
        return sum(self.count.values()) + len(self.failures)


def read(suffix: str, data: bytes, folder: Path) -> str:
    """What becomes of a file: "read", or the name of the error of this package that it meets.

    Raises:
        Exception: any other error.
    """
    from torchrender.errors import TorchRenderError
    from torchrender.images.files import read_image
    from torchrender.points.draw import render_points
    from torchrender.points.file import open_points
    from torchrender.points.load import holds_points, load_points
    from torchrender.scene.load import load

    path = folder / f"a{suffix}"
    path.write_bytes(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if suffix in PICTURES:
                read_image(path)
                return "read"
            if suffix == ".trp":
                points = open_points(path)
                render_points(points, points.camera(width=16, height=16))
                return "read"
            if suffix == ".ply" and holds_points(path):
                load_points(path)
                return "read"
            scene = load(folder / "a.obj" if suffix == ".mtl" else path)
            if scene.animations:
                scene.at(0.5)
            if suffix == ".ply":
                load_points(path, samples=10)
    except TorchRenderError as error:
        return type(error).__name__
    return "read"


def _work(orders: Connection, first: int, last: int, name: str) -> None:
    """Read files ``first`` to ``last`` of a kind and tell about each."""
    import resource

    # Libraries print what they think of damaged files, past everything that Python could hold back.
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    suffix, data = seeds()[name]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "a.png").write_bytes(picture("PNG"))
        (folder / "a.obj").write_bytes(seeds()["obj"][1])
        (folder / "a.mtl").write_bytes(seeds()["mtl"][1])
        read(suffix, data, folder)
        scale = 1.0 / 1024.0 if sys.platform != "darwin" else 1.0 / 1024.0**2
        start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale
        orders.send("ready")
        for number in range(first, last):
            begin = time.perf_counter()
            try:
                found = read(suffix, mutated(data, number), folder)
            except Exception as error:
                found = f"!{type(error).__name__}: {error}"[:300]
            taken = time.perf_counter() - begin
            grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale - start
            orders.send((number, found, taken, grown))


def study(name: str, count: int, *, seconds: float = SECONDS, megabytes: float = MEGABYTES, first: int = 0) -> Outcome:
    """Read ``count`` damaged files of one kind."""
    outcome = Outcome(name)
    last, at = first + count, first
    context = multiprocessing.get_context("spawn")
    while at < last:
        ours, theirs = context.Pipe(duplex=False)
        worker = context.Process(target=_work, args=(theirs, at, last, name), daemon=True)
        worker.start()
        theirs.close()
        at = _listen(ours, worker, outcome, at, last, (seconds, megabytes))
        worker.kill()
        worker.join()
    return outcome


def _listen(answers: Connection, worker: Any, outcome: Outcome, at: int, last: int, limits: tuple[float, float]) -> int:
    """Take answers until the worker is done, dead, too slow or too large; the number of the next file."""
    seconds, megabytes = limits
    # The first answer says that everything is imported and compiled.
    if not answers.poll(START_SECONDS) or answers.recv() != "ready":
        raise RuntimeError(f"a process for {outcome.name!r} did not start")
    while at < last:
        try:
            if not answers.poll(seconds):
                outcome.failures.append((at, f"took more than {seconds:g} s"))
                return at + 1
            number, found, taken, grown = answers.recv()
        except EOFError:
            worker.join(5)
            outcome.failures.append((at, f"the process died: {worker.exitcode}"))
            return at + 1
        at = number + 1
        outcome.slowest_s = max(outcome.slowest_s, taken)
        outcome.most_megabytes = max(outcome.most_megabytes, grown)
        if found.startswith("!"):
            outcome.failures.append((number, found[1:]))
        else:
            outcome.count[found] += 1
        if grown > megabytes:
            outcome.failures.append((number, f"grew by {grown:.0f} MB"))
            return at
    return at


def main(arguments: list[str] | None = None) -> int:
    """Read damaged files of every kind and say what happened; 1 where something else than an error of ours did."""
    parser = argparse.ArgumentParser(prog="python -m torchrender.report.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="files of each kind (default 1000; a night: 100000)")
    parser.add_argument("--first", type=int, default=0, help="number of the first one (default 0)")
    parser.add_argument("--kind", action="append", choices=tuple(seeds()), help="only these kinds")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, help=f"longest time for one file (default {SECONDS:g})"
    )
    parser.add_argument("--megabytes", type=float, default=MEGABYTES, help=f"most memory (default {MEGABYTES:g})")
    chosen = parser.parse_args(arguments)
    failed = 0
    for name in chosen.kind or seeds():
        outcome = study(name, chosen.count, seconds=chosen.seconds, megabytes=chosen.megabytes, first=chosen.first)
        failed += len(outcome.failures)
        found = ", ".join(f"{count} {kind}" for kind, count in outcome.count.most_common())
        line = f"{name:12s} {outcome.files} files: {found}; slowest {outcome.slowest_s:.2f} s"
        sys.stdout.write(f"{line}, {outcome.most_megabytes:.0f} MB\n")
        for number, what in outcome.failures[:20]:
            sys.stdout.write(f"    file {number}: {what}\n")
        sys.stdout.flush()
    return 1 if failed else 0
