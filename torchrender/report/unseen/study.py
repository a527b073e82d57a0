"""Predicted errors, error bounds and budgets on scenes that calibration never saw.

``python -m torchrender.report.unseen [--quick] [--seconds 200] [-o docs/results]`` writes ``unseen.md`` and
``.json``; ``--seconds`` ends a run early, and the next goes on. The scenes are random ones of other seeds than
calibration takes, and where ``TORCHRENDER_DATA`` names a folder, files of others in it; their paths and picture sizes
are others, too.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.checks import checked_fields
from torchrender.image import Image
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import TOLERANCE
from torchrender.quality.machine import machine_record
from torchrender.quality.metrics import flip
from torchrender.quality.pages import write_record, write_text
from torchrender.renderer import render
from torchrender.report.common.command import run_in_parts
from torchrender.report.common.parts import Parts
from torchrender.report.unseen.page import page
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import built_in_path
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.scene.procedural.anything import anything
from torchrender.tuning.measure import exact_options
from torchrender.tuning.unseen import HELD_OUT, SEEDS

DATA = "TORCHRENDER_DATA"
FILES = (
    "gltf/DamagedHelmet.glb",
    "meshes/spot_textured.glb",
    "meshes/stanford_dragon_res2.ply",
    "scenes/bookstore.glb",
    "scenes/forest_tile.glb",
)
"""Below the folder of data by others."""

FIRST_SEED = 10_000
"""Far from those of calibration."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    random: int = 7  # scenes
    files: tuple[str, ...] = FILES
    sides: tuple[int, ...] = (160, 240)  # of pictures, in turn; calibration has 176 and 512
    budgets_ms: tuple[float, ...] = (60.0, 200.0)
    bounds: tuple[float, ...] = (0.1, 0.05, 0.025)
    ladder: tuple[float, ...] = (0.2, 0.035)
    frames: int = 3


QUICK = StudyOptions(random=1, files=(), sides=(48,), budgets_ms=(50.0,), bounds=(0.1,), ladder=(0.2,), frames=2)


def scenes(study: StudyOptions) -> Iterator[tuple[str, Scene]]:
    """Random ones, then files."""
    assert max(*SEEDS, *HELD_OUT) < FIRST_SEED
    for number in range(study.random):
        yield f"random {number}", anything(FIRST_SEED + number)
    folder = Path(os.environ.get(DATA, "../shared/data"))
    for name in study.files:
        if (folder / name).exists():
            yield Path(name).stem, load(folder / name)
        else:
            sys.stderr.write(f"left out, not there: {name}\n")


def walk_of(scene: Scene, side: int, frames: int) -> Cameras:
    """A short piece of an orbit, as fast as 240 pictures for all of it."""
    near = 1e-3 * (scene.diagonal or 1.0)
    path = built_in_path(scene, "orbit").cameras(240, width=side, height=side, near=near)
    return path[torch.arange(100, 100 + frames)]


@dataclass(eq=False)
class Subject:
    """A scene, its cameras, and what its last picture should be."""

    name: str
    scene: Scene
    walk: Cameras
    wanted: Tensor  # (1,H,W,3) display values of the last picture, every pass at its reference

    @classmethod
    def of(cls, name: str, scene: Scene, side: int, frames: int) -> Subject:
        """With its reference."""
        walk = walk_of(scene, side, frames)
        return cls(name, scene, walk, render(scene, walk[len(walk) - 1], options=exact_options()).displayed())

    def sequence(self, **wishes: Any) -> list[Image]:
        """All pictures in turn."""
        history: RenderHistory | None = RenderHistory()
        images = []
        for number in range(len(self.walk)):
            images.append(render(self.scene, self.walk[number], history=history, **wishes))
            history = images[-1].history
        return images

    def record(self, kind: str, wish: float, image: Image, late: Sequence[float]) -> dict[str, Any]:
        """What was predicted of the last picture, and what came.

        Args:
            late: milliseconds of pictures after the first.
        """
        plan = image.plan
        assert plan is not None
        error = float(flip(image.displayed(), self.wanted)[0])
        return {
            "scene": self.name,
            "side": self.walk.width,
            "kind": kind,
            "wish": wish,
            "error": error,
            "predicted": plan.predicted_error,
            "interval": plan.error_interval,
            "possible": plan.possible,
            "ms": round(image.timings_ms["total"], 2),
            "late_ms": [round(ms, 2) for ms in late],
            "settings": {row.name: row.setting for row in plan.running if row.setting != "-"},
        }


def measure(subject: Subject, study: StudyOptions) -> list[dict[str, Any]]:
    """Budgets over a sequence, then bounds for its last picture alone and in a sequence, then the ladder of bounds."""
    records = []
    for budget in study.budgets_ms:
        images = subject.sequence(budget_ms=budget)
        times = [image.timings_ms["total"] for image in images]
        records.append(subject.record("budget", budget, images[-1], times[1:]))
    last = subject.walk[len(subject.walk) - 1]
    for bound in study.bounds:
        alone = render(subject.scene, last, max_error=bound)
        records.append(subject.record("bound alone", bound, alone, []))
    for bound in sorted({*study.ladder, *study.bounds}, reverse=True):
        images = subject.sequence(max_error=bound, options=RenderOptions(reuse=None))
        times = [image.timings_ms["total"] for image in images]
        kind = "bound" if bound in study.bounds else "rung"
        records.append(subject.record(kind, bound, images[-1], times[1:]))
    return records


def _scene(name: str, scene: Scene, side: int, study: StudyOptions) -> list[dict[str, Any]]:
    return measure(Subject.of(name, scene, side, study.frames), study)


def run(study: StudyOptions, folder: Path, parts: Parts) -> list[Path]:
    """Measure and write."""
    records: list[dict[str, Any]] = []
    for number, (name, scene) in enumerate(scenes(study)):
        side = study.sides[number % len(study.sides)]
        records += parts.measured(name, partial(_scene, name, scene, side, study))
    record = {"machine": machine_record(), "tolerance": TOLERANCE, "records": records}
    files = [folder / "unseen.json", folder / "unseen.md"]
    write_record(files[0], record)
    write_text(files[1], page(record))
    return files


def main(argv: Sequence[str] | None = None) -> None:
    """The command."""
    run_in_parts(
        __doc__,
        lambda folder, quick, parts: run(QUICK if quick else StudyOptions(), folder, parts),
        "unseen",
        quick="a check that takes seconds",
        argv=argv,
    )
