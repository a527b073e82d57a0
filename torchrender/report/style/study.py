"""Material style measured: stages and costs beside every baseline, known materials, the search, 2-D transfer.

``python -m torchrender.report.style [--quick] [-o docs/results]`` writes ``material-style.md``, ``.json``, a picture.
Photos and scene files are looked for in ``TORCHRENDER_DATA`` (default ``../shared/data``); what is absent is left out.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchrender.checks import checked_fields
from torchrender.errors import TorchRenderError
from torchrender.images.files import write_atomically
from torchrender.photo.style.options import FitOptions, SearchOptions, StyleOptions, StyleWarning
from torchrender.photo.style.search import exhaustive, greedy, random_choice, single_view, tabu_search
from torchrender.photo.style.session import Style
from torchrender.photo.style.statistics import rendered_distance
from torchrender.photo.style.transfer import style_scene
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import text_writer
from torchrender.report.common.command import study_parser
from torchrender.report.style import subjects
from torchrender.report.style.flat import flat_rows
from torchrender.report.style.known import known_row
from torchrender.report.style.page import write_page
from torchrender.report.style.picture import draw_gallery
from torchrender.scene.model import Scene

SOURCE_OBJECTS = 15
"""The scenes of the source have 5 to 17 objects; of larger scenes the largest objects are taken where that matters."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    rooms: tuple[str, ...] = ("living room", "washroom", "box", "bookstore")
    photos: tuple[str, ...] = ("reading corner", "kitchenette", "kitchen", "billiard room")
    odd: tuple[tuple[str, str], ...] = (("living room", "coffee"), ("washroom", "temple"))
    outdoor: tuple[tuple[str, str], ...] = (("garden", "temple"), ("city", "street"))
    random: int = 20
    seeds: int = 30
    gallery: bool = True
    options: StyleOptions = field(default_factory=StyleOptions)


QUICK = StudyOptions(
    rooms=("box",), photos=("kitchen",), odd=(("box", "coffee"),), outdoor=(), random=3, seeds=4, gallery=False,
    options=StyleOptions(views=8, width=80, height=60),
)  # fmt: skip


def styled(scene: Scene, name: str, options: StyleOptions) -> Style:
    """A scene in the style of a photo of the study."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StyleWarning)
        return style_scene(scene, subjects.photo(name), options)


def cost_row(scene: str, photo: str, style: Style, study: StudyOptions) -> dict[str, Any]:
    """Costs, times, and F of every baseline from the same tables."""
    cost, usable, start = style.cost(), style.free(), style.start
    singles = [cost.total(single_view(usable, start, c)) for c in range(usable.shape[1])]
    chance = [cost.total(random_choice(usable, start, s)) for s in range(study.random)]
    return {
        "scene": scene,
        "photo": photo,
        "objects": len(style.names),
        "views": len(style.problem.views),
        "unseen": len(style.unseen),
        "valid": float(style.candidates.valid.double().mean()),
        "before": vars(style.before),
        "after": vars(style.after),
        "start": style.before.total,
        "found": style.after.total,
        "moves": style.result.iterations,
        "single": [min(singles), float(np.mean(singles))],
        "random": [min(chance), float(np.mean(chance))],
        "greedy": greedy(cost, start, usable).cost,
        "published": published_row(style),
        "timings_ms": dict(style.timings_ms),
    }


def published_row(style: Style) -> dict[str, float]:
    """F of the start and after the search without what is added here: neither prior nor misfit."""
    options = style.problem.options
    plain = replace(options, search=replace(options.search, prior_weight=0.0, fit_weight=0.0))
    made = replace(style, problem=replace(style.problem, options=plain)).searched()
    cost, usable = made.cost(), made.free()
    singles = [cost.total(single_view(usable, made.start, c)) for c in range(usable.shape[1])]
    return {
        "start": made.before.total,
        "found": made.after.total,
        "single": min(singles),
        "greedy": greedy(cost, made.start, usable).cost,
    }


def unclustered_row(scene: Scene, photo: str, style: Style, options: StyleOptions) -> dict[str, float]:
    """Fits to all pixels of an object: F, and the mean chroma of the materials, which averaging washes out."""
    plain = styled(scene, photo, replace(options, fit=replace(options.fit, seeds=1)))

    def chroma(made: Style) -> float:
        from torchrender.photo.lab import lab_from_linear
        from torchrender.photo.style.finish import albedo

        lab = lab_from_linear(albedo(made.materials, made.problem.cosine))
        return float(lab[:, 1:].norm(dim=1).mean())

    return {"found": plain.after.total, "chroma": chroma(plain), "chroma_clustered": chroma(style)}


def optimum_share(style: Style, seeds: int, objects: int = 5, columns: int = 6) -> dict[str, float]:
    """How often the search finds the best of all choices, with all but five objects locked, six candidates each."""
    cost, usable = style.cost(), style.usable.numpy()
    rich = np.flatnonzero(usable.sum(axis=1) >= columns)
    hits, gaps, moves = 0, [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        free = np.zeros_like(usable)
        free[np.arange(len(usable)), style.start] = True
        start = style.start.copy()
        for i in rng.choice(rich, min(objects, len(rich)), replace=False):
            chosen = rng.choice(np.flatnonzero(usable[i]), columns, replace=False)
            free[i] = False
            free[i, chosen] = True
            start[i] = chosen[0]
        found, truth = tabu_search(cost, start, free), exhaustive(cost, free, start)
        hits += found.cost <= truth.cost + 1e-9
        gaps.append(found.cost / truth.cost - 1.0)
        moves.append(found.iterations)
    return {"share": hits / seeds, "gap": float(np.mean(gaps)), "moves": float(np.mean(moves)), "seeds": seeds}


def time_row(scene: Scene, photo: str, options: StyleOptions) -> dict[str, Any]:
    """All of the time for fifteen objects and ten views, warm; a lock; tables against rendering."""
    part = subjects.largest(scene, SOURCE_OBJECTS)
    styled(part, photo, options)  # kernels are compiled once per installation
    begin = time.perf_counter()
    style = styled(part, photo, options)
    total = time.perf_counter() - begin
    begin = time.perf_counter()
    style.lock(style.names[0])
    lock = time.perf_counter() - begin
    begin = time.perf_counter()
    style.pick(style.names[-1], (0, 0, 100, 100))
    pick = time.perf_counter() - begin
    moves = style.cost().start(style.result.choice)
    index = int(style.usable.sum(dim=1).argmax())

    def step() -> object:
        moves.move(index, int(style.choice[index]))
        return moves.neighbours()

    table = _median(step)
    count = int((style.usable.sum(dim=1) - 1).clamp_min(0).sum())
    rows = style.materials
    wanted = style.wanted()
    whole = _median(lambda: rendered_distance(style.problem.terms, rows, wanted), 3) * count
    return {
        "objects": len(style.names), "views": len(style.problem.views), "total_s": total, "lock_s": lock,
        "pick_s": pick, "timings_ms": dict(style.timings_ms), "neighbours": count, "table_ms": 1e3 * table,
        "render_ms": 1e3 * whole, "table_error": _table_error(style),
    }  # fmt: skip


def _table_error(style: Style) -> float:
    """Largest difference of F between tables and whole renderings over ten random choices."""
    cost, wanted = style.cost(), style.wanted()
    worst = 0.0
    for seed in range(10):
        choice = random_choice(style.usable.numpy(), style.start, seed)
        rows = style.candidates.materials[torch.arange(len(choice)), torch.from_numpy(choice)]
        parts = cost.parts(choice)
        whole = float(rendered_distance(style.problem.terms, rows, wanted).sum())
        worst = max(worst, abs(parts.mean + parts.deviation + parts.histogram - whole))
    return worst


def _median(work: Callable[[], object], runs: int = 7) -> float:
    times = []
    for _ in range(runs):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def settings_rows(scene: Scene, photo: str, options: StyleOptions) -> list[dict[str, Any]]:
    """Accuracy against time: view size, views, bins, refinement, thinning."""
    cases = {
        "as it is": options,
        "views of 200x150": replace(options, width=200, height=150),
        "views of 800x600": replace(options, width=800, height=600),
        "15 views": replace(options, views=15),
        "one solve (refine 0)": replace(options, fit=FitOptions(refine=0)),
        "1,000 pixels per fit": replace(options, fit=FitOptions(max_pixels=1000)),
        "16 bins": replace(options, search=SearchOptions(bins=16)),
        "64 bins": replace(options, search=SearchOptions(bins=64)),
        "3 candidates an object": replace(options, search=SearchOptions(cluster=3)),
        "tabu list of moves": replace(options, search=SearchOptions(tabu="move")),
    }
    rows = []
    for name, chosen in cases.items():
        begin = time.perf_counter()
        style = styled(scene, photo, chosen)
        ratio = style.after.total / style.before.total
        seconds = time.perf_counter() - begin
        rows.append({"case": name, "seconds": seconds, "per_view": style.after.total / len(style.problem.views),
                     "ratio": ratio, "search_ms": style.timings_ms["search"]})  # fmt: skip
    return rows


def run(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """The whole record; the gallery is drawn on the way."""
    rooms = subjects.indoor(study.rooms)
    outside = subjects.outdoor(tuple(dict.fromkeys(s for s, _ in study.outdoor)))
    pairs = [(s, p) for s in rooms for p in study.photos] + list(study.odd) + list(study.outdoor)
    scenes = {**rooms, **outside}
    costs, styles = [], {}
    for scene, photo in pairs:
        if scene in scenes:
            say(f"{scene}, {photo}")
            styles[scene, photo] = styled(scenes[scene], photo, study.options)
            costs.append(cost_row(scene, photo, styles[scene, photo], study))
    first, photo = next(iter(rooms)), study.photos[0]
    main_style = styles[first, photo]
    say("baselines without clustering, optimum, 2-D transfer")
    record = {
        "machine": machine_record(),
        "costs": costs,
        "unclustered": unclustered_row(rooms[first], photo, main_style, study.options),
        "optimum": optimum_share(main_style, study.seeds),
        "flat": [{"photo": p, **row} for p in study.photos[:3] for row in flat_rows(styles[first, p])],
    }
    say("known materials")
    record["known"] = [
        known_row(name, subjects.largest(scene, SOURCE_OBJECTS), study.options, registered)
        for name, scene in rooms.items()
        for registered in (True, False)
    ]
    say("times and settings")
    record["time"] = time_row(rooms[first], photo, study.options)
    record["settings"] = settings_rows(subjects.largest(rooms[first], SOURCE_OBJECTS), photo, study.options)
    if study.gallery:
        say("gallery")
        draw_gallery(styles, folder)
    return record


def say(text: str) -> None:
    """Progress, on stderr."""
    sys.stderr.write(f"material style: {text}\n")


def main() -> None:
    """The command."""
    given = study_parser(__doc__, quick="one small scene: checks that it works").parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    try:
        record = run(QUICK if given.quick else StudyOptions(), given.output)
    except TorchRenderError as error:
        sys.exit(f"material style: {error}")
    write_atomically(given.output / "material-style.json", text_writer(json.dumps(record, indent=1) + "\n"))
    write_page(record, given.output)
