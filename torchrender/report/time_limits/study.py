"""Who keeps a time limit, and with what picture.

``python -m torchrender.report.time_limits [--quick] [--seconds 200]`` writes ``docs/results/time-limits.md``, ``.json``
and ``.png``; ``--seconds`` ends a run early, and the next goes on. torchrender with a budget stands beside Mitsuba and
Blender Cycles with their time limits, on the same diffuse scenes. Both are optional (``pip install
'torchrender[bench]'``, ``'torchrender[blender]'``) and run in processes of their own; what is missing is said.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.checks import checked_fields
from torchrender.errors import ImageFileError
from torchrender.images.files import read_image, write_image
from torchrender.kernels.compile import thread_count
from torchrender.numerics.tonemap import auto_exposure, tone_map
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.machine import machine_record
from torchrender.quality.metrics import coverage, flip
from torchrender.quality.pages import write_record, write_text
from torchrender.renderer import render
from torchrender.report.common.command import run_in_parts
from torchrender.report.common.parts import Parts
from torchrender.report.time_limits.page import page
from torchrender.report.time_limits.scene import export_scene, plain_scene
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

BEST = RenderOptions(area_shadows="sampled", point_shadows="traced", supersample=2.0)
"""torchrender without a limit, as accurate as it gets on scenes without mirrors."""

PEERS = {
    "Mitsuba": ("time_limits.mitsuba", {"variant": "scalar_rgb"}),
    "Mitsuba, LLVM": ("time_limits.mitsuba", {"variant": "llvm_ad_rgb"}),
    "Blender Cycles": ("time_limits.cycles", {}),
}
REFERENCE = "reference"
PATIENCE = 1200.0  # seconds after which a process is given up


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    scenes: tuple[str, ...] = ("cornell_box", "living_room")
    size: int = 512
    limits_ms: tuple[int, ...] = (50, 100, 200, 500, 1000, 2000)
    runs: int = 2
    samples: int = 16  # per pixel, that path tracers are asked for


QUICK = StudyOptions(scenes=("cornell_box",), size=48, limits_ms=(50, 500), runs=1, samples=16)


def compared(name: str, options: StudyOptions) -> tuple[dict[str, Any], Tensor]:
    """The record of a scene, and its pictures: a row for each renderer, a column for each limit."""
    scene = plain_scene(build(name))
    camera = scene.camera(width=options.size, height=options.size)
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        export_scene(scene, camera, folder)
        found = {"torchrender": own(scene, camera, options)}
        found |= {peer: other(peer, folder, options) for peer in PEERS}
    pictures = {renderer: row.pop("pictures") for renderer, row in found.items() if "pictures" in row}
    record = {"triangles": scene.geometry.triangle_count, "renderers": found}
    return record, torch.cat([torch.cat(list(made), dim=1) for made in pictures.values()])


def _written(name: str, options: StudyOptions, path: Path) -> dict[str, Any]:
    """The record of a scene whose pictures are in a file."""
    record, pictures = compared(name, options)
    write_image(path, pictures)
    return record


def own(scene: Scene, camera: Cameras, options: StudyOptions) -> dict[str, Any]:
    """torchrender's row."""
    begin = time.perf_counter()
    images = {REFERENCE: render(scene, camera, options=BEST).radiance}
    free_ms = 1e3 * (time.perf_counter() - begin)
    times: dict[str, list[float]] = {}
    notes = {}
    for limit in options.limits_ms:
        render(scene, camera, budget_ms=float(limit))  # kernels of these settings are compiled on first use
        times[str(limit)] = []
        for _ in range(options.runs):
            begin = time.perf_counter()
            made = render(scene, camera, budget_ms=float(limit))
            times[str(limit)].append(1e3 * (time.perf_counter() - begin))
        images[str(limit)] = made.radiance
        if made.plan is not None and not made.plan.possible:
            notes[str(limit)] = made.plan.statement
    return {"notes": notes, "free_ms": free_ms, **_compared(images, dict.fromkeys(images), times)}


def other(peer: str, folder: Path, options: StudyOptions) -> dict[str, Any]:
    """The row of another renderer, or why there is none."""
    module, extra = PEERS[peer]
    label = peer.lower().replace(", ", "-").replace(" ", "-")
    tasks: list[list[Any]] = [[str(n), n / 1000.0, options.samples, options.runs] for n in options.limits_ms]
    tasks.append([REFERENCE, 0.0, options.samples, 1])
    result = folder / f"{label}.json"
    job = {"folder": str(folder), "label": label, "tasks": tasks, "result": str(result), "threads": thread_count()}
    job_file = folder / f"{label}-job.json"
    job_file.write_text(json.dumps({**job, **extra}))
    command = [sys.executable, "-m", f"torchrender.report.{module}", str(job_file)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, env={**os.environ})
    except subprocess.TimeoutExpired:
        return {"missing": f"gave no answer within {PATIENCE:g} s"}
    if done.returncode != 0:
        return {"missing": _reason(done)}
    answer = json.loads(result.read_text())
    images, valid = {}, {}
    for name in answer["ms"]:
        try:
            pixels = read_image(folder / f"{label}-{name}.exr")
        except ImageFileError as error:
            return {"missing": str(error)}
        images[name], valid[name] = pixels[None, ..., :3], pixels[None, ..., 3] > 0
    times = {name: ms for name, ms in answer["ms"].items() if name != REFERENCE}
    return {
        "version": answer["version"],
        "free_ms": answer["ms"][REFERENCE][0],
        **_compared(images, valid, times),
    }


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    """The line that says most of a process that failed."""
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    telling = [line for line in lines if "Error" in line or "ERROR" in line]
    return f"exit status {done.returncode}: {(telling or lines or ['no message'])[-1][:120]}"


def _compared(images: dict[str, Tensor], valid: dict[str, Any], times: dict[str, list[float]]) -> dict[str, Any]:
    """Times, completeness and FLIP against the same renderer without a limit, and small pictures."""
    exposure = auto_exposure(images[REFERENCE])
    shown = {name: tone_map(image, "reinhard", exposure=exposure) for name, image in images.items()}
    rows = {}
    for name, ms in times.items():
        rows[name] = {
            "ms": statistics.median(ms),
            "most_ms": max(ms),
            "complete": float(coverage(images[name], valid=valid[name]).complete),
            "flip": float(flip(shown[name], shown[REFERENCE])),
        }
    return {"limits": rows, "pictures": list(_small(shown, list(times)))}


def _small(shown: dict[str, Tensor], names: list[str], side: int = 192) -> Iterator[Tensor]:
    """Pictures (side,side,3), the reference last."""
    for name in (*names, REFERENCE):
        planes = shown[name].permute(0, 3, 1, 2)
        yield torch.nn.functional.adaptive_avg_pool2d(planes, side)[0].permute(1, 2, 0)


def run(options: StudyOptions, folder: Path, parts: Parts) -> list[Path]:
    """Measure and write the page, with the pictures of the last scene."""
    record: dict[str, Any] = {
        "machine": machine_record(),
        "size": options.size,
        "limits_ms": list(options.limits_ms),
        "runs": options.runs,
        "samples": options.samples,
        "scenes": {},
    }
    files = [folder / f"time-limits{suffix}" for suffix in (".json", ".png", ".md")]
    for name in options.scenes:
        record["scenes"][name] = parts.measured(name, partial(_written, name, options, files[1]))
    write_record(files[0], record)
    write_text(files[2], page(record))
    return files


def main(argv: Sequence[str] | None = None) -> None:
    """The command."""
    run_in_parts(
        __doc__,
        lambda folder, quick, parts: run(QUICK if quick else StudyOptions(), folder, parts),
        "time-limits",
        quick="one small scene, to check that it works",
        argv=argv,
    )
