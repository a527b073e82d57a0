"""Error-against-time curves of passes and systems: as JSON, a table, a plot, and one page for all scenes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from torch import Tensor

from torchrender.errors import InputError
from torchrender.images.files import write_atomically
from torchrender.passes.contract import Pass
from torchrender.passes.table import PASSES
from torchrender.planning.curves import scene_key
from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.pages import text_writer
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.tuning.measure import SIDE, Measured, frontier, measure_pass, passes_named, views_of
from torchrender.tuning.picture_url import picture_url
from torchrender.tuning.systems.system import System, measure_system
from torchrender.tuning.systems.table import SYSTEMS

SUBJECTS: tuple[Pass | System, ...] = (*PASSES, *SYSTEMS)
SUMMARIES = {one.name: one.summary for one in SUBJECTS}
"""What curves there may be of: passes, then systems that are none."""
PICTURES = ("picture", "difference")
DOT, LABEL_STEPS = 4.0, 24
"""Pixels of a plot from the middle of a point to its edge; half lines that its name may lie above or below."""


class Kept(Protocol):
    """What was measured under a name is taken over, else measured now."""

    def __call__(self, name: str, measure: Callable[[], Any], /) -> Any:
        """The record, as JSON has it."""


@dataclass(frozen=True, eq=False)
class SceneCurves:
    """The curves of one scene."""

    name: str
    size: int  # pixels of a side
    passes: Mapping[str, Mapping[str, Any]]  # by pass or system, what there is to tell of those that have a choice

    def record(self) -> dict[str, Any]:
        """Numbers alone."""
        return {name: _plain(values) for name, values in self.passes.items()}

    def beside(self, earlier: Mapping[str, Mapping[str, Any]]) -> SceneCurves:
        """With curves that were measured earlier, where there are no new ones."""
        both = {**earlier, **self.passes}
        return replace(self, passes={name: both[name] for name in SUMMARIES if name in both})


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Without pictures, at any depth."""
    inside = {k: _plain(v) if isinstance(v, Mapping) else v for k, v in values.items()}
    return {k: v for k, v in inside.items() if k not in PICTURES}


def subjects_named(name: str | None) -> tuple[Pass | System, ...]:
    """The pass or system of that name, or all that have a choice.

    Raises:
        InputError: there is none; the message lists those there are.
    """
    if name is None:
        return (*passes_named(None), *SYSTEMS)
    found = tuple(one for one in SUBJECTS if one.name == name)
    if not found:
        passes, systems = ", ".join(step.name for step in PASSES), ", ".join(system.name for system in SYSTEMS)
        raise InputError(f"there is no pass or system {name!r}; known passes: {passes}; systems: {systems}")
    return found


def measure(
    scene: Scene, *, size: int = SIDE, name: str | None = None, pictures: bool = False, kept: Kept | None = None
) -> SceneCurves:
    """Curves of one pass or system on a scene, or of all that have something to do there.

    Args:
        kept: takes over what an earlier run measured of one.

    Raises:
        InputError: no pass or system of that name.
    """
    views, key = views_of(scene, size), scene_key(scene)
    found = {}
    for subject in subjects_named(name):
        if isinstance(subject, Pass):
            one = partial(pass_data, scene, views, subject, pictures=pictures)
        else:
            one = partial(system_data, scene, size, subject, pictures=pictures)
        data = one() if kept is None else kept(f"{key}, {subject.name}, {size}", one)
        if data is not None:
            found[subject.name] = data
    return SceneCurves(key, size, found)


def pass_data(scene: Scene, views: Sequence[Cameras], step: Pass, *, pictures: bool = False) -> dict[str, Any] | None:
    """Plain values about a pass and its settings, pictures as text; None where it has nothing to do."""
    own = None if step.own is None else step.own.title
    return _data(step.settings.reference.name, own, *measure_pass(scene, views, step, pictures=pictures))


def system_data(scene: Scene, size: int, system: System, *, pictures: bool = False) -> dict[str, Any] | None:
    """The same about a system."""
    return _data(system.reference, system.own, *measure_system(scene, size, system, pictures=pictures))


def _data(
    reference: str, own: str | None, found: Mapping[str, Measured], shown: Tensor | None
) -> dict[str, Any] | None:
    if not found:
        return None
    settings = {name: measured.record() for name, measured in found.items()}
    for name, measured in found.items() if shown is not None else ():
        settings[name] |= {kind: picture_url(getattr(measured, kind)) for kind in PICTURES}
    machine = machine_record()
    return {
        "reference": reference,
        "own_measure": own,
        "frontier": frontier({name: (measured.ms, measured.flip) for name, measured in found.items()}),
        "settings": settings,
        "commit": machine["commit"],
        "date": machine["date"],
        **({"picture": picture_url(shown)} if shown is not None else {}),
    }


def write(folder: Path, curves: SceneCurves) -> list[Path]:
    """``tradeoff-SCENE.json``, ``.md`` and, where matplotlib is installed, ``.png``."""
    base = folder / f"tradeoff-{curves.name.partition('/')[0]}"
    record = {"machine": machine_record(), "scene": curves.name, "size": curves.size, "passes": curves.record()}
    writers: dict[str, Callable[[Path], None]] = {
        ".json": text_writer(json.dumps(record, indent=1) + "\n"),
        ".md": text_writer(table(curves)),
    }
    if _has_matplotlib():
        writers[".png"] = lambda path: plot(path, curves)
    files = []
    for suffix, writer in writers.items():
        path = base.with_name(base.name + suffix)
        write_atomically(path, writer)
        files.append(path)
    return files


def table(curves: SceneCurves) -> str:
    """A Markdown page of the curves; settings on the frontier are marked."""
    lines = [f"# Accuracy against time: {curves.name}", "", machine_line(), "", *kept_lines(curves.passes)]
    lines += [
        f"{curves.size} x {curves.size} pixels. Errors against the pass's reference, all other passes as usual. They",
        "are deterministic: where a row does not say otherwise, making the picture twice gave the same bits. Times are",
        "those of the pass alone: the median of pictures of a sequence with its spread between the quartiles, and what",
        "the first picture took, preparations included. * no other setting is both quicker and closer.",
        "",
        f"Systems of their own, no passes of a picture: {', '.join(one.name for one in SYSTEMS)}.",
        "Times are those of making alone, first and again; what was made is drawn beside the scene by another way.",
        "",
    ]
    for name, record in curves.record().items():
        own = record["own_measure"]
        lines += [f"## {name} (reference: {record['reference']})", ""]
        head = ["setting", "mean FLIP", "PSNR dB", "relative MSE", *([own] if own else []), "ms", "spread", "first ms"]
        lines += [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
        for setting, values in record["settings"].items():
            mark = " *" if setting in record["frontier"] else ""
            note = "" if values["repeats"] else " (differs from run to run)"
            cells = [f"{setting}{mark}{note}", f"{values['flip']:.4f}", f"{values['psnr']:.1f}"]
            cells += [f"{values['relative_mse']:.3g}", *([_own(values["own"])] if own else [])]
            cells += [f"{values['ms']:.1f}", f"{values['spread_ms']:.1f}", f"{values['first_ms']:.1f}"]
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def kept_lines(passes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """What was not measured now, and when it was."""
    now = machine_record()["commit"]
    others = sorted({(str(p["date"]), str(p["commit"])) for p in passes.values() if p["commit"] != now})
    return [
        f"Kept from commit {commit}, {date}: {', '.join(n for n, p in passes.items() if p['commit'] == commit)}.\n"
        for date, commit in others
    ]


def plot(path: Path, curves: SceneCurves) -> None:
    """Error against time, a panel per pass."""
    from matplotlib.figure import Figure

    shown = {name: values["settings"] for name, values in curves.passes.items() if len(values["settings"]) > 1}
    figure = Figure(figsize=(4.2 * min(len(shown), 4), 3.2 * -(-len(shown) // 4)), dpi=100, layout="constrained")
    named = []
    for number, name in enumerate(shown):
        axes = figure.add_subplot(-(-len(shown) // 4), min(len(shown), 4), number + 1)
        points = {s: (max(m["ms"], 1e-2), m["flip"]) for s, m in shown[name].items()}
        best = frontier(points)
        axes.plot([points[s][0] for s in best], [points[s][1] for s in best], color="0.7", zorder=0)
        axes.set(title=name, xlabel="ms", ylabel="mean FLIP", xscale="log")
        axes.margins(0.12, 0.16)
        for setting, (time, error) in points.items():
            axes.plot([time], [error], "o", color="tab:blue" if setting in best else "0.6")
        _time_ticks(axes, [time for time, _ in points.values()])
        named.append((axes, points, best))
    figure.draw_without_rendering()  # names are placed in pixels
    for axes, points, best in named:
        _label(axes, points, best)
    figure.savefig(path, format="png")


def _time_ticks(axes: Any, times: Sequence[float]) -> None:
    """Plain numbers, few enough to stand side by side."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

    ratio = max(times) / min(times)
    subs = (1.0, 2.0, 5.0) if ratio < 30 else (1.0,)
    axes.xaxis.set_major_locator(MaxNLocator(4) if ratio < 4 else LogLocator(subs=subs, numticks=8))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_locator(NullLocator())


def _label(axes: Any, points: Mapping[str, tuple[float, float]], best: Sequence[str]) -> None:
    """Names beside their points, where they cover neither a point nor another name, as near as can be."""
    from matplotlib.transforms import Bbox

    inside = axes.get_window_extent()
    places = {setting: axes.transData.transform(point) for setting, point in points.items()}
    taken = [Bbox.from_extents(x - DOT, y - DOT, x + DOT, y + DOT) for x, y in places.values()]
    for setting, point in sorted(points.items(), key=lambda item: (item[0] not in best, -item[1][0])):
        x, y = places[setting]
        text = axes.annotate(setting, point, xytext=(0, 0), textcoords="offset pixels", fontsize=8)
        width, height = text.get_window_extent().size
        tried = [Bbox.from_bounds(x + right, y + up, width, height) for right, up in label_places(width, height)]
        free = (box for box in tried if inside.x0 < box.x0 and box.x1 < inside.x1 and not box.count_overlaps(taken))
        box = next(free, tried[0])
        text.set_position((box.x0 - x, box.y0 - y))
        taken.append(box)


def label_places(width: float, height: float) -> Iterable[tuple[float, float]]:
    """Offsets of a name's lower left corner from its point, the nearest first: right, left, about the middle."""
    for step in range(LABEL_STEPS):
        for rise in (step, -step - 1):
            for right in (DOT + 1.0, -width - DOT - 1.0, -0.5 * width):
                yield right, rise * 0.5 * height + (DOT if rise >= 0 else -DOT)


def _own(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _has_matplotlib() -> bool:
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None
