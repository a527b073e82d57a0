"""Measure what a plan costs: ``python -m torchrender.report.planning [--quick] [-o docs/results]``.

Writes ``planning.md`` and ``.json``: the time of a plan with a budget for tables of 8 to 20 made-up passes, and for the
built-in scenes, before a first picture and in a sequence.
"""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

from torchrender.passes.outlook import Outlook
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import Knowledge
from torchrender.planning.curves import load_curves
from torchrender.planning.planner import make_plan
from torchrender.planning.question import Question
from torchrender.planning.search import HEADROOM, choose
from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.pages import table, write_record, write_text
from torchrender.renderer import render
from torchrender.report.common.command import run_study
from torchrender.report.planning.tables import made_up, options_of, random_curves
from torchrender.scene.load import load
from torchrender.scene.procedural import SCENES

COUNTS = (8, 10, 12, 16, 20)
BUDGETS_MS = (50.0, 200.0, 1000.0)
FACTORS = (1.2, 2.0, 4.0)
"""Budgets of made-up tables, in times of their cheapest settings."""


def timed(work: Callable[[], Any], repeats: int) -> list[float]:
    """Milliseconds of each call."""
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        found.append(1e3 * (time.perf_counter() - begin))
    return found


def made_up_tables(counts: Sequence[int], seeds: int, repeats: int) -> list[dict[str, Any]]:
    """A record for every number of passes."""
    scene = load("cornell_box")
    camera = scene.camera(width=256, height=256)
    records = []
    for count in counts:
        times, products = [], []
        for seed in range(seeds):
            passes = made_up(count, random.Random(seed), asking=3)
            options = options_of(passes)
            outlook = Outlook(scene=scene, cameras=camera, options=options, history=RenderHistory().of_scene(scene))
            known = Knowledge(
                outlook=outlook, curves=random_curves(passes, outlook, random.Random(seed)), passes=passes
            )
            products.append(prod(len(step.settings.all) for step in passes))
            cheapest = choose(Question.about(known, options), 1e-9, None).predicted_ms
            for factor in FACTORS:
                budget = factor * cheapest / HEADROOM
                times += timed(lambda: choose(Question.about(known, options), budget, None), repeats)  # noqa: B023
        records.append({"passes": count, "combinations": max(products), **_spread(times)})
    return records


def built_in_scenes(names: Sequence[str], repeats: int) -> list[dict[str, Any]]:
    """A record for every scene, of the whole plan."""
    records = []
    for name in names:
        scene = load(name)
        camera = scene.camera(width=512, height=512)
        history = render(scene, camera, width=64, height=64, history=RenderHistory()).history
        for what, past in (("first picture", None), ("sequence", history)):
            known = Knowledge.of(scene, camera, RenderOptions(), past, load_curves())
            times = []
            for budget in BUDGETS_MS:
                times += timed(lambda: make_plan(known, RenderOptions(), budget), repeats)  # noqa: B023
            # What the planner finds out once a picture is part of a plan's time.
            fresh = replace(known, outlook=replace(known.outlook, facts={}))
            first = timed(lambda: make_plan(fresh, RenderOptions(), 200.0), 1)[0]  # noqa: B023
            records.append({"scene": name, "when": what, "first_ms": first, **_spread(times)})
    return records


def _spread(times: Sequence[float]) -> dict[str, float]:
    quarters = statistics.quantiles(times, n=4)
    return {"median_ms": statistics.median(times), "low_ms": quarters[0], "high_ms": quarters[2], "max_ms": max(times)}


def page(record: dict[str, Any]) -> list[str]:
    """Lines of the Markdown page."""

    def span(row: dict[str, Any]) -> list[str]:
        return [f"{row['median_ms']:.2f}", f"{row['low_ms']:.2f} to {row['high_ms']:.2f}", f"{row['max_ms']:.2f}"]

    machine = machine_line(record["machine"])
    lines = ["# What a plan costs", "", f"`python -m torchrender.report.planning` on {machine}", ""]
    lines += [
        "Choosing the settings of all passes for a budget: Pareto fronts are folded pass by pass, and the choice",
        "equals that of an exhaustive search (`tests/planning/test_search.py`). Made-up passes have two to five",
        "settings, the first six; three of them share something that is paid for once. Milliseconds.",
        "",
    ]
    head = ["passes", "combinations", "median", "middle half", "longest"]
    lines += table(head, [[str(r["passes"]), f"{r['combinations']:.2g}", *span(r)] for r in record["made_up"]])
    lines += ["The whole plan of a picture of 512 x 512 pixels with a budget, reasons and predictions included:", ""]
    head = ["scene", "when", "median", "middle half", "longest"]
    return lines + table(head, [[r["scene"], r["when"], *span(r)] for r in record["scenes"]])


def run(folder: Path, quick: bool) -> list[Path]:
    """Measure and write."""
    counts, seeds, repeats = (COUNTS[:2], 1, 2) if quick else (COUNTS, 5, 5)
    names = ("cornell_box",) if quick else tuple(SCENES)
    record = {
        "machine": machine_record(),
        "made_up": made_up_tables(counts, seeds, repeats),
        "scenes": built_in_scenes(names, 2 if quick else 20),
    }
    write_record(folder / "planning.json", record)
    write_text(folder / "planning.md", page(record))
    return [folder / "planning.json", folder / "planning.md"]


def main() -> None:
    """The command."""
    run_study(__doc__, run, quick="two small tables and one scene")
