"""Budgets measured: are they kept, is the picture complete, is its error what was predicted, and is it worth it?

``python -m torchrender.report.budget [--quick] [--seconds 200] [--part presets] [-o docs/results]`` writes
``budget.md``, ``.json`` and a plot. About eight minutes; ``--seconds`` ends a run early, and the next goes on, and
``--part`` measures one part anew and keeps the rest of the page. Errors are those of nine windows of each picture.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import torch

from torchrender.checks import checked_fields
from torchrender.image import Image
from torchrender.images.files import write_atomically
from torchrender.passes.table import PASSES
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import TOLERANCE
from torchrender.quality.machine import machine_record
from torchrender.quality.metrics import coverage
from torchrender.quality.pages import write_record, write_text
from torchrender.renderer import render
from torchrender.report.budget.page import page, plot
from torchrender.report.common.command import RESULTS, parts_parser, write_in_parts
from torchrender.report.common.parts import Parts
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import built_in_path, walks_of
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.tuning.windows import Windows

BUDGETS_MS = (50, 100, 200, 500)
PRESETS = {"draft": 0, "low": 1, "medium": 2, "high": 3}
"""Fixed settings to compare with: all knobs of a usual picture at their step of that number, those that can be off
included, at full resolution from "medium" on."""


FILLED = 1.05
"""Budget by the time that a preset took: predictions fill a budget up to about that part of it."""

SUBJECTS = ("nest", "grass", "city", "tree", "living_room", "washroom", "cornell_box")
"""Built-in scenes whose look a single kind of pass does not decide."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    scenes: tuple[str, ...] = SUBJECTS
    size: int = 512
    frames: int = 23  # of each path: 207 over the nine paths of these scenes
    budgets_ms: tuple[int, ...] = BUDGETS_MS
    checked: int = 2  # frames of each path whose error is measured
    repeats: int = 6  # pictures of a still sequence whose median time counts, beside presets


QUICK = StudyOptions(scenes=("cornell_box",), size=48, frames=3, budgets_ms=(5, 1000), checked=1, repeats=1)


def paths(study: StudyOptions) -> Iterator[tuple[str, Scene, Cameras]]:
    """Every walk of the rooms, and an orbit of each other scene, at the speed of 240 pictures for the whole path."""
    for name in study.scenes:
        scene = load(name)
        for path in walks_of(scene) or ("orbit",):
            walk = built_in_path(scene, path).cameras(
                240, width=study.size, height=study.size, near=1e-3 * (scene.diagonal or 1.0)
            )
            yield f"{name} {path}", scene, walk[torch.arange(60, 60 + study.frames)]


def budgets(name: str, scene: Scene, walk: Cameras, study: StudyOptions) -> list[dict[str, Any]]:
    """A record for every frame of a path and budget."""
    records = []
    places = [round((i + 1) * (len(walk) - 1) / study.checked) for i in range(study.checked)]
    wanted = {at: Windows.of(scene, walk[at]) for at in places}
    for budget in study.budgets_ms:
        history: RenderHistory | None = RenderHistory()
        for number in range(len(walk)):
            image = render(scene, walk[number], history=history, budget_ms=budget)
            history = image.history
            records.append(_record(name, budget, number, image, wanted.get(number)))
    return records


def _record(name: str, budget: float, number: int, image: Image, wanted: Windows | None) -> dict[str, Any]:
    plan = image.plan
    assert plan is not None
    share = coverage(image.radiance)
    record: dict[str, Any] = {
        "path": name,
        "budget_ms": budget,
        "frame": number,
        "ms": round(image.timings_ms["total"], 2),
        "predicted_ms": round(plan.predicted_ms or 0.0, 2),
        "possible": plan.possible,
        "kept": image.timings_ms["total"] <= TOLERANCE * budget,
        "complete": float(share.complete.min()),
        "predicted_error": plan.predicted_error,
        "settings": {row.name: row.setting for row in plan.running},
    }
    if wanted is not None:
        record["error"] = wanted.error(image)
    return record


@lru_cache(maxsize=1)
def _subject(name: str, size: int) -> tuple[Scene, Cameras, Windows]:
    """A scene, its camera, and what the picture should be: made once for all presets."""
    scene = load(name)
    camera = scene.camera(width=size, height=size)
    return scene, camera, Windows.of(scene, camera)


def fixed_settings(number: int) -> RenderOptions:
    """The options of a preset: what a usual picture leaves out stays out."""
    options = usual = RenderOptions(reuse=None)
    for step in PASSES:
        if step.settings.is_choice and step.settings.current(usual) != step.off:
            names = step.settings.names
            name = "1" if step is PASSES[0] and number >= 2 else names[min(number, len(names) - 1)]
            options = step.settings.named(name).applied(options)
    return options


def preset(name: str, study: StudyOptions, title: str) -> dict[str, Any]:
    """Fixed settings beside the planner's: at their time, and at their error. Still sequences, medians."""
    scene, camera, wanted = _subject(name, study.size)
    ms, image = _steady(scene, camera, study.repeats, options=fixed_settings(PRESETS[title]))
    error = wanted.error(image)
    time, timed = _steady(scene, camera, study.repeats, budget_ms=FILLED * ms)
    bound, bounded = _steady(scene, camera, study.repeats, max_error=min(max(error, 1e-4), 1.0))
    return {
        "scene": name,
        "preset": title,
        "ms": ms,
        "error": error,
        "at_its_time": {"ms": time, "error": wanted.error(timed), "same": _same(image, timed)},
        "at_its_error": {"ms": bound, "error": wanted.error(bounded), "same": _same(image, bounded)},
    }


def _same(one: Image, other: Image) -> bool:
    """Both were made with the same settings of all passes that ran."""
    assert one.plan is not None and other.plan is not None
    ran = [[(row.name, row.setting) for row in image.plan.running] for image in (one, other) if image.plan]
    return ran[0] == ran[1]


def _steady(scene: Scene, camera: Cameras, repeats: int, **wishes: Any) -> tuple[float, Image]:
    """Median time of the later pictures of a still sequence without reuse, and the last one."""
    history: RenderHistory | None = RenderHistory()
    wishes.setdefault("options", RenderOptions(reuse=None))
    times: list[float] = []
    image = None
    for _ in range(repeats + 2):
        image = render(scene, camera, history=history, **wishes)
        history = image.history
        times.append(image.timings_ms["total"])
    assert image is not None
    return statistics.median(times[2:]), image


def deleted_passes(name: str, study: StudyOptions) -> list[dict[str, Any]]:
    """A diffuse scene with all passes in the table, and with those deleted that do not apply; pictures take turns."""
    scene = load(name)
    if any(m.is_reflector for m in scene.materials):
        return []
    camera = scene.camera(width=study.size, height=study.size)
    image = render(scene, camera)
    assert image.plan is not None
    ran = {row.name for row in image.plan.running}
    times: dict[bool, list[float]] = {True: [], False: []}
    for number in range(2 * study.repeats):
        whole = number % 2 == 0
        steps = PASSES if whole else tuple(s for s in PASSES if s.name in ran)
        image = render(scene, camera, options=RenderOptions(passes=steps))
        times[whole].append(image.timings_ms["total"])
    whole_ms, few_ms = statistics.median(times[True]), statistics.median(times[False])
    return [{"scene": name, "all_ms": whole_ms, "few_ms": few_ms, "ratio": whole_ms / few_ms}]


def beside_presets(study: StudyOptions, parts: Parts) -> list[dict[str, Any]]:
    """Fixed settings and the planner's."""
    rows = [(name, title) for name in study.scenes for title in PRESETS]
    return [parts.measured(f"{name}, {title}", partial(preset, name, study, title)) for name, title in rows]


def without_passes(study: StudyOptions, parts: Parts) -> list[dict[str, Any]]:
    """Diffuse scenes with a shorter table."""
    found: list[dict[str, Any]] = []
    for name in study.scenes:
        found += parts.measured(f"{name}, passes deleted", partial(deleted_passes, name, study))
    return found


def under_budgets(study: StudyOptions, parts: Parts) -> list[dict[str, Any]]:
    """All paths under all budgets."""
    found: list[dict[str, Any]] = []
    for name, scene, walk in paths(study):
        found += parts.measured(name, partial(budgets, name, scene, walk, study))
    return found


PARTS = {"presets": beside_presets, "deleted": without_passes, "budgets": under_budgets}


def run(study: StudyOptions, folder: Path, parts: Parts, part: str | None = None) -> list[Path]:
    """Measure, all or one part, and write."""
    record = {} if part is None else recorded(folder)
    machines = record.setdefault("machines", {name: record.get("machine") for name in PARTS})
    for name in PARTS if part is None else (part,):
        record[name] = PARTS[name](study, parts)
        machines[name] = machine_record()
    record["machine"] = machines["budgets"]
    if part in (None, "budgets"):
        record["study"] = {"size": study.size, "frames": study.frames, "tolerance": TOLERANCE}
    files = [folder / f"budget{suffix}" for suffix in (".json", ".png", ".md")]
    write_record(files[0], record)
    write_atomically(files[1], lambda path: plot(path, record))
    write_text(files[2], page(record))
    return files


def recorded(folder: Path) -> dict[str, Any]:
    """What an earlier run left in a folder, or, where there is none, in the documentation."""
    places = [place / "budget.json" for place in (folder, RESULTS)]
    found = next((place for place in places if place.exists()), None)
    if found is None:
        raise SystemExit(f"no earlier run in {folder} to keep the rest of: leave out --part")
    kept: dict[str, Any] = json.loads(found.read_text())
    return kept


def main(argv: Sequence[str] | None = None) -> None:
    """The command."""
    parser = parts_parser(__doc__, quick="a check that takes seconds")
    parser.add_argument("--part", choices=tuple(PARTS), help="measure this alone, keep the rest of the recorded page")
    arguments = parser.parse_args(argv)
    study = QUICK if arguments.quick else StudyOptions()
    write_in_parts(arguments, lambda folder, parts: run(study, folder, parts, arguments.part), "budget")
