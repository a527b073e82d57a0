"""A file of points that is larger than memory should be: made, packed within a bound, and drawn.

``python -m torchrender.report.points.large --gigabytes 2 --memory 1024`` writes a PLY file of that size into a
temporary folder, packs it in a process of its own, draws it, and prints times and the most memory that the process had
beyond what it had at its start. It needs about three times the size of the file on disk for a while.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.points.draw import render_points
from torchrender.points.file import open_points, write_points
from torchrender.points.load import load_points
from torchrender.points.pack import PackOptions, pack_points
from torchrender.points.tree import build_patches

ROW = np.dtype([("place", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)])
PIECE = 1 << 20
SIZE = 512


def write_hills(path: Path, count: int, seed: int = 0) -> None:
    """A scan of ``count`` points on hills, as a binary PLY file with normals and colours."""
    rng = np.random.default_rng(seed)
    names = [
        *(f"float {n}" for n in ["x", "y", "z", "nx", "ny", "nz"]),
        *(f"uchar {n}" for n in ["red", "green", "blue"]),
    ]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    head += "".join(f"property {n}\n" for n in names) + "end_header\n"
    with path.open("wb") as file:
        file.write(head.encode())
        for start in range(0, count, PIECE):
            x, z = rng.uniform(-50, 50, (2, min(PIECE, count - start)))
            rows = np.zeros(len(x), ROW)
            height = 3 * np.sin(0.21 * x) * np.cos(0.17 * z) + np.sin(0.9 * x + 0.4 * z)
            along = 0.63 * np.cos(0.21 * x) * np.cos(0.17 * z) + 0.9 * np.cos(0.9 * x + 0.4 * z)
            across = -0.51 * np.sin(0.21 * x) * np.sin(0.17 * z) + 0.4 * np.cos(0.9 * x + 0.4 * z)
            normal = np.stack([-along, np.ones_like(x), -across], axis=1)
            rows["place"] = np.stack([x, height, z], axis=1)
            rows["normal"] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
            rows["color"] = np.clip(np.stack([90 + 20 * height, 130 + 10 * height, 80 + 0 * x], axis=1), 0, 255)
            file.write(rows.tobytes())


class Watch:
    """The most memory that this process takes while it is open, megabytes, looked at 50 times a second."""

    def __init__(self) -> None:
        self.most = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def _look(self) -> None:
        while not self._done.wait(0.02):
            self.most = max(self.most, resident_mb())

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()


def resident_mb() -> float:
    """Memory of this process now; where the system does not tell, the most that it ever had."""
    statm = Path("/proc/self/statm")
    if statm.is_file():
        return int(statm.read_text().split()[1]) * resource.getpagesize() / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1e-6 if sys.platform == "darwin" else 1e-3)


def _measure(source: Path, target: Path, memory_mb: float, answers: Any) -> None:
    # Whatever is imported and compiled for small models is no part of the bound.
    small = target.with_name("small.ply")
    write_hills(small, 5_000)
    write_points(small.with_suffix(".trp"), build_patches(load_points(small)))
    pack_points(small, small.with_suffix(".trp"))
    before, start = resident_mb(), time.perf_counter()
    with Watch() as watch:
        size = pack_points(source, target, PackOptions(memory_mb=memory_mb))
    answers.send((size, time.perf_counter() - start, watch.most - before))


def measure(folder: Path, gigabytes: float, memory_mb: float) -> dict[str, float]:
    """Make, pack and draw a file of that size."""
    source, target = folder / "hills.ply", folder / "hills.trp"
    write_hills(source, max(int(gigabytes * 1e9 / ROW.itemsize), 1))
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    worker = context.Process(target=_measure, args=(source, target, memory_mb, theirs))
    worker.start()
    theirs.close()
    size, pack_s, grown_mb = ours.recv()
    worker.join()
    model = open_points(target)
    start = time.perf_counter()
    camera = model.camera(width=SIZE, height=SIZE)
    drawn = render_points(model, camera)
    draw_s = time.perf_counter() - start
    return {
        "file_mb": source.stat().st_size / 1e6,
        "points": float(model.point_count),
        "packed_mb": size / 1e6,
        "pack_s": pack_s,
        "grown_mb": grown_mb,
        "draw_s": draw_s,
        "covered": float(drawn.mask.float().mean()),
    }


def main(arguments: list[str] | None = None) -> int:
    """Print one line; 1 where the bound was broken."""
    parser = argparse.ArgumentParser(prog="python -m torchrender.report.points.large", description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=2.0, help="size of the file (default 2)")
    parser.add_argument("--memory", type=float, default=1024.0, metavar="MB", help="the bound (default 1024)")
    parser.add_argument("--folder", type=Path, help="where the files are for a while (default: of the system)")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(dir=chosen.folder, ignore_cleanup_errors=True) as folder:
        found = measure(Path(folder), chosen.gigabytes, chosen.memory)
    sys.stdout.write(
        f"{found['file_mb']:,.0f} MB of PLY, {found['points']:,.0f} points: packed into {found['packed_mb']:,.0f} MB "
        f"in {found['pack_s']:.0f} s; memory grew by {found['grown_mb']:,.0f} MB of {chosen.memory:,.0f} MB allowed; "
        f"first picture of {SIZE} x {SIZE} in {found['draw_s']:.1f} s, {100 * found['covered']:.0f} % covered\n"
    )
    return int(found["grown_mb"] > chosen.memory)


if __name__ == "__main__":
    raise SystemExit(main())
