"""Error-against-time curves of the passes of a picture: as JSON, a table, a plot, and one page for all scenes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from torchrender.images.files import write_atomically
from torchrender.passes.contract import Pass
from torchrender.planning.curves import scene_key
from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.pages import text_writer
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.tuning.measure import SIDE, frontier, measure_pass, passes_named, views_of
from torchrender.tuning.picture_url import picture_url

LABEL_WIDTH, LABEL_HEIGHT = 90.0, 13.0  # pixels of a plot that a setting's name may take


PICTURES = ("picture", "difference")


class Kept(Protocol):
    """What was measured under a name is taken over, else measured now."""

    def __call__(self, name: str, measure: Callable[[], Any], /) -> Any:
        """The record, as JSON has it."""


@dataclass(frozen=True, eq=False)
class SceneCurves:
    """The curves of one scene."""

    name: str
    size: int  # pixels of a side
    passes: Mapping[str, Mapping[str, Any]]  # what pass_data tells of those that have something to do

    def record(self) -> dict[str, Any]:
        """Numbers alone."""
        return {name: _plain(values) for name, values in self.passes.items()}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Without pictures, at any depth."""
    inside = {k: _plain(v) if isinstance(v, Mapping) else v for k, v in values.items()}
    return {k: v for k, v in inside.items() if k not in PICTURES}


def measure(
    scene: Scene, *, size: int = SIDE, name: str | None = None, pictures: bool = False, kept: Kept | None = None
) -> SceneCurves:
    """Curves of one pass of a scene, or of all that have something to do there.

    Args:
        kept: takes over what an earlier run measured of a pass.

    Raises:
        InputError: no pass of that name.
    """
    views, key = views_of(scene, size), scene_key(scene)
    found = {}
    for step in passes_named(name):
        one = partial(pass_data, scene, views, step, pictures=pictures)
        data = one() if kept is None else kept(f"{key}, {step.name}, {size}", one)
        if data is not None:
            found[step.name] = data
    return SceneCurves(key, size, found)


def pass_data(scene: Scene, views: Sequence[Cameras], step: Pass, *, pictures: bool = False) -> dict[str, Any] | None:
    """Plain values about a pass and its settings, pictures as text; None where it has nothing to do."""
    found, shown = measure_pass(scene, views, step, pictures=pictures)
    if not found:
        return None
    settings = {name: measured.record() for name, measured in found.items()}
    for name, measured in found.items() if pictures else ():
        settings[name] |= {kind: picture_url(getattr(measured, kind)) for kind in PICTURES}
    return {
        "reference": step.settings.reference.name,
        "own_measure": None if step.own is None else step.own.title,
        "frontier": frontier({name: (measured.ms, measured.flip) for name, measured in found.items()}),
        "settings": settings,
        **({"picture": picture_url(shown)} if pictures else {}),
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
    lines = [f"# Accuracy against time: {curves.name}", "", machine_line(), ""]
    lines += [
        f"{curves.size} x {curves.size} pixels. Errors against the pass's reference, all other passes as usual. They",
        "are deterministic: where a row does not say otherwise, making the picture twice gave the same bits. Times are",
        "those of the pass alone: the median of pictures of a sequence with its spread between the quartiles, and what",
        "the first picture took, preparations included. * no other setting is both quicker and closer.",
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
    """Names beside their points, those on the right half to the left; names that would meet stand above each other."""
    place = axes.transData.transform
    low, high = axes.get_window_extent().intervalx
    taken: list[tuple[float, float]] = []
    for setting, point in sorted(points.items(), key=lambda item: (item[0] not in best, -item[1][0])):
        x, y = place(point)
        beyond = x > (low + high) / 2
        lift = 4.0
        while any(abs(x - u) < LABEL_WIDTH and abs(y + lift - v) < LABEL_HEIGHT for u, v in taken):
            lift += LABEL_HEIGHT
        taken.append((x, y + lift))
        side = {"ha": "right", "xytext": (-5, lift)} if beyond else {"ha": "left", "xytext": (5, lift)}
        axes.annotate(setting, point, textcoords="offset pixels", fontsize=8, **side)


def _own(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _has_matplotlib() -> bool:
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None
