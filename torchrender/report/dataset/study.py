"""Measure many views and moving objects: ``python -m torchrender.report.dataset [--quick] [-o docs/results]``.

Writes ``dataset.md`` and ``.json``: pictures per second of 200 views of 256 x 256 pixels in one call, with the memory
that takes, and the time of pictures of a room in which an armchair turns.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.pages import table, write_record, write_text
from torchrender.report.common.command import run_study
from torchrender.report.dataset import moving, views

SCENES = ("living_room", "city", "nest")
ROOMS = {40_000: 30, 280_000: 12}
"""Triangles, and pictures."""


def page(record: dict[str, Any]) -> list[str]:
    """Lines of the Markdown page."""
    machine = machine_line(record["machine"])
    lines = ["# Data sets and moving objects", "", f"`python -m torchrender.report.dataset` on {machine}", ""]
    return [*lines, *_views(record["views"]), *_moving(record["moving"])]


def _views(rows: list[dict[str, Any]]) -> list[str]:
    count, side = rows[0]["views"], views.SIDE
    lines = [
        "## Many views in one call",
        "",
        f"`rasterize` of {count} views of {side} x {side} pixels from random places in the scene, pictures per second:",
        "in one call, and in a loop over the views. open3d casts the rays of the same cameras, made before and not",
        "counted, on as many threads; they tell depth, normals, ids. Every tenth view was compared, bit by bit, with",
        "a picture of it alone. Memory: by how much the process grows at most while the call works, results included,",
        "and how large it is then, with the package, its compiled code and the scene.",
        "",
    ]
    head = ["scene", "triangles", "depth", "loop", "depth, normals, ids", "loop", "open3d", "ratio", "the same"]
    cells = []
    for row in rows:
        peer, rate, loop = row["open3d"], row["all"]["rate"], [row[kind]["loop"] for kind in ("depth", "all")]
        told = (peer, "") if isinstance(peer, str) else (f"{peer:.0f}", f"{rate / peer:.1f}")
        rates = [f"{value:.0f}" for value in (row["depth"]["rate"], loop[0], rate, loop[1])]
        cells.append([row["scene"], f"{row['triangles']:,}", *rates, *told, "yes" if row["same"] else "**no**"])
    lines += table(head, cells)
    head = ["scene", "depth, normals, ids: results", "grows by", "process then", "depth: results", "grows by"]
    sizes = [f"{count * side**2 * width / 2**20:.0f} MB" for width in (24, 4)]  # bytes per pixel
    cells = []
    for row in rows:
        grown = [_mb(row["all"]["grown_mb"]), _mb(row["all"]["peak_mb"])]
        cells.append([row["scene"], sizes[0], *grown, sizes[1], _mb(row["depth"]["grown_mb"])])
    return lines + table(head, cells)


def _moving(rows: list[dict[str, Any]]) -> list[str]:
    size = f"{moving.WIDTH} x {moving.HEIGHT}"
    lines = [
        "## An object that moves",
        "",
        f"The armchair of the living room turns in pictures of {size} pixels with a history and all",
        "usual effects; `scene.moved` is included. The first pictures make what is kept, the median is of those from",
        "the fourth on. Alone: the same picture of a scene that was built anew, without history. Difference to that:",
        "mean of display values from 0 to 255, and pixels that are off by more than 8.",
        "",
    ]
    head = [
        "triangles",
        "that move",
        "pictures",
        "first three, ms",
        "median, ms",
        "longest",
        "alone, ms",
        "mean off",
        "pixels off",
    ]
    cells = []
    for row in rows:
        times = [f"{row[name]:.0f}" for name in ("median_ms", "longest_ms", "alone_ms")]
        counts = [
            f"{row['triangles']:,}",
            f"{row['moving']:,}",
            str(row["frames"]),
            ", ".join(f"{ms:.0f}" for ms in row["first_ms"]),
        ]
        cells.append([*counts, *times, f"{row['mean_error']:.3f}", f"{100 * row['visible']:.2f} %"])
    lines += table(head, cells)
    lines += ["Where the time goes, median of each pass, ms:", ""]
    names = sorted(rows[0]["passes"], key=lambda name: -rows[0]["passes"][name])[:12]
    cells = [[f"{row['triangles']:,}", *(f"{row['passes'].get(n, 0.0):.1f}" for n in names)] for row in rows]
    return lines + table(["triangles", *names], cells)


def _mb(value: float | None) -> str:
    return "not known" if value is None else f"{value:.0f} MB"


def run(folder: Path, quick: bool) -> list[Path]:
    """Measure and write."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"machine": machine_record(), "views": [], "moving": []}
    for name in SCENES[-1:] if quick else SCENES:
        begin = time.perf_counter()
        record["views"].append(views.measured(name, 24 if quick else 200, 1 if quick else 2))
        sys.stdout.write(f"views of {name}: {time.perf_counter() - begin:.1f} s\n")
        sys.stdout.flush()
    for count, frames in [*ROOMS.items()][: 1 if quick else None]:
        begin = time.perf_counter()
        record["moving"].append(moving.measured(count, 5 if quick else frames, 1 if quick else 2))
        sys.stdout.write(f"armchair among {count} triangles: {time.perf_counter() - begin:.1f} s\n")
        sys.stdout.flush()
    write_record(folder / "dataset.json", record)
    write_text(folder / "dataset.md", page(record))
    return [folder / "dataset.json", folder / "dataset.md"]


def main() -> None:
    """The command."""
    run_study(__doc__, run, quick="few views of one scene, few pictures")
