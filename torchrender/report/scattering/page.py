"""The page of the study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table, write_text
from torchrender.report.scattering.stage import SUN_FINER, SUN_STEPS

ASKED = {
    "T2 lamp, homogeneous": 50, "T2 sun, homogeneous": 55, "T2 sun, height": 80,
    "T2 lamp, height": 80, "T2 sun, grid": 130, "T2 lamp, grid": 200,
}  # fmt: skip
"""Milliseconds at 800 x 600 that were asked for."""
LIGHT_LOAD = 0.5
"""Load of a machine on which nothing else runs."""


def _percent(value: float) -> str:
    return f"{100 * value:.2f} %"


def write_page(record: Mapping[str, Any], path: Path) -> None:
    """Write the page."""
    write_text(path, lines(record))


def lines(record: Mapping[str, Any]) -> list[str]:
    """The page, line by line."""
    study = record["study"]
    width, height = study["size"]
    out = ["# Light that media scatter", "", machine_line(record["machine"]), ""]
    out += [
        f"`python -m torchrender.report.scattering`. Times are of {width} x {height} pixels with all that the layer",
        "needs anew (slices, pyramids, tables, marks, interpolation, transmittance); G-buffer and light images are",
        f"those of other passes. The candidates of a table took turns, {study['runs']} times. {_busy(record)}",
        "Errors are RMSE over the mean.",
        "",
        "![T1, T2 with a lamp, T2 with the sun; homogeneous, height, grid](scattering.jpg)",
        "",
        "## The source's own way",
        "",
        f"{study['published_steps']} steps of equal angle at lamps, of equal length before the sun, along rays of",
        f"{study['small'][0]} x {study['small'][1]} pixels; errors and speed-up against all rays marched by the same",
        "kernel. Asked of T1: RMSE at most 0.5 % and 2.5 times as quick with 2 x 2, 1.5 % and 4 times with 3 x 3; of",
        "T2: at most 4 %, on edges, too. Pixels are marked by length and lit share where nothing else is said.",
        "",
    ]
    for scene, rows in record["published"].items():
        out += _published(scene, rows)
    out += ["## Ways: errors against the walk, against rays, and times", ""]
    out += [
        f"Errors are those of {study['probes']} pixels of these pictures, and of as many of their edges: the twentieth",
        "of the pixels where light changes most. `to walk`: exact for the texels of the light's images",
        f"({study['map_size']} a side, {SUN_FINER * study['map_size']} of the sun), with four times as many panels;",
        f"`to rays`: {study['rays_steps']} steps at lamps and {SUN_STEPS * study['rays_steps']} before the sun, each",
        "with a shadow ray. In homogeneous media slices lead to closed forms, and all rays are integrated whatever",
        "the block. `64 steps` is the source's way along every ray, with a look-up at each step, run once;",
        "`times` is how much quicker than that.",
        "",
    ]
    out += _ways(record["ways"])
    out += ["## Time against steps, blocks, lights, and rays that meet the medium", ""]
    out += _costs(record["costs"])
    out += ["![Milliseconds by share of rays, steps and lamps](scattering-cost.png)", ""]
    out += ["## Baselines: T1 with shadows, against the mean of 8 jittered rays of 1,024 steps", ""]
    rows = [[k, _percent(v["rmse"]), _percent(v["edge"])] for k, v in record["baselines"].items()]
    out += table(["way", "RMSE", "edges"], rows)
    out += ["## Trends", ""]
    rows = [[k, *(f"{v:.4f}" for v in values)] for k, values in record["trends"].items()]
    out += table(["mean of the picture", "1", "2", "3", "4", "5"], rows)
    return [*out, *_motion(record), *_streamed(record["streamed"]), *_peer(record["peer"])]


def _streamed(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    out = [
        "## In streams",
        "",
        "Keyframes hold the light of a pixel with what media add and take; clients move it with the surface behind it.",
        "After a step, shafts and halos are therefore seen as if painted on what lies behind them, until the next",
        "keyframe. Mean error of the pixels that the keyframe knows, as a share of the mean light, against a picture",
        "from there, and the same without media, which is what reprojection costs anyway.",
        "",
    ]
    cells = [[r["scene"], f"{r['step']:g}", _percent(r["fog"]), _percent(r["clear"])] for r in rows]
    return out + table(["scene", "step to the side, m", "with media", "clear air"], cells)


def _motion(record: Mapping[str, Any]) -> list[str]:
    """The film and the edits."""
    film, frames = record["film"], record["study"]["frames"]
    out = ["## A sun that moves", ""]
    out += [
        f"Variance over {frames} pictures of the error of 3 x 3 blocks: {film['ratio']:.3f} of that of plain",
        "bilinear interpolation of a third of the rows and columns (asked: at most 0.5). From above: the light, the",
        "error of blocks and that of bilinear interpolation, eight times as bright.",
        "",
        "![Five pictures of the film](scattering-film.jpg)",
        "",
        "## Edits",
        "",
        "The layer keeps nothing from picture to picture. Whole pictures of the renderer with its history: the first",
        "one after an edit, and the next; asked: at most 1.05 of it. A light that moves needs new images of its own,",
        "which last for as long as it stays.",
        "",
    ]
    edits = record["edits"]
    rows = [[k, f"{v['first']:.1f}", f"{v['next']:.1f}", f"{v['ratio']:.3f}"] for k, v in edits["pictures"].items()]
    out += table(["edit", "first, ms", "next, ms", "first / next"], rows)
    out += [
        f"Where no medium is in view the planner finds that out in {edits['none in view']:.2f} ms (asked: at most 1),",
        "and nothing else is done.",
        "",
    ]
    return out


def _busy(record: Mapping[str, Any]) -> str:
    """What the machine did beside: told by its load when the study began."""
    load, cores = record["load"], record["machine"]["cores"]
    if load < LIGHT_LOAD:
        return f"Nothing else ran on the machine (load {load:.1f} at the beginning)."
    return f"Other work ran beside (load {load:.1f} on {cores} cores at the beginning): ratios count, not milliseconds."


def _published(scene: str, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    cells = [
        [r["plan"], _percent(r["marched"]), f"{r['ms']:.0f}", f"{r['times']:.1f}", _percent(r["rmse"]),
         _percent(r["edge"]) if "edge" in r else "", _percent(r["p99"]), _percent(r["max"])]
        for r in rows
    ]  # fmt: skip
    return table([scene, "marched", "ms", "times", "RMSE", "edges", "99th percentile", "greatest"], cells)


def _ways(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    full = {r["case"]: r["least_ms"] for r in rows if r["way"] == "64 steps"}
    cells = []
    for r in rows:
        asked = ASKED.get(r["case"]) if r["way"].startswith("slices") else None
        cells.append([
            f"{r['case']}: {r['way']}", f"{r['ms']:.0f}", f"{r['least_ms']:.0f}", "" if asked is None else str(asked),
            f"{full[r['case']] / r['least_ms']:.1f}",
            _percent(r["share"]), _percent(r["walk"]["rmse"]), _percent(r["walk"].get("edge", 0.0)),
            _percent(r["rays"]["rmse"]), _percent(r["rays"].get("edge", 0.0)),
        ])  # fmt: skip
    head = ["case", "ms", "least ms", "asked", "times", "integrated", "to walk", "edges", "to rays", "edges"]
    return table(head, cells)


def _costs(costs: Mapping[str, Any]) -> list[str]:
    out = table(["way", "ms"], [[k, f"{v['median']:.0f}"] for k, v in costs["ways"].items()])
    out += table(["lamps", "ms"], [[k, f"{v['median']:.0f}"] for k, v in costs["lights"].items()])
    return out + table(
        ["share of rays in the medium", "ms"], [[k, f"{v['median']:.1f}"] for k, v in costs["shares"].items()]
    )


def plot(path: Path, costs: Mapping[str, Any]) -> None:
    """Milliseconds by the share of rays that meet the medium, by steps, and by lamps."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.6), layout="constrained")
    axes = figure.subplots(1, 3)
    # "0, behind the camera" is a share, too; steps stand beside blocks, which have none.
    shares = sorted((float(k.partition(",")[0]), v["median"]) for k, v in costs["shares"].items())
    steps = sorted((float(k.split()[0]), v["median"]) for k, v in costs["ways"].items() if k.endswith("steps"))
    lamps = sorted((float(k), v["median"]) for k, v in costs["lights"].items())
    named = (("share of rays in the medium", shares), ("steps along every ray", steps), ("lamps", lamps))
    for axis, (label, points) in zip(axes, named, strict=True):
        axis.plot([x for x, _ in points], [y for _, y in points], "o-", color="tab:blue")
        axis.set(xlabel=label, ylabel="ms", xlim=(0, None), ylim=(0, None))
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=100, format="png")


def _peer(peer: Mapping[str, Any]) -> list[str]:
    out = ["## Beside a path tracer", ""]
    if "missing" in peer:
        return [*out, peer["missing"] + ".", ""]
    width, height = peer["size"]
    out += [
        f"Mitsuba {peer['version']}, `{peer['variant']}`, `volpath` with one scattering, at {width} x {height}: the",
        "same triangles, painted black, the same light in the same units, the same homogeneous medium. Ours is timed",
        "with G-buffer and light images; both programs keep their tree of rays. Errors are against many steps along",
        "every ray with a shadow ray at each. That both mean the same: ratio of the means of the picture, and RMSE of",
        "means over 5 x 5 parts of it, of the most samples. `at our time` is the path tracer's error if it had as long",
        "as our picture, by the law of its own noise; asked: ten times ours or more.",
        "",
    ]
    cases = peer["cases"]
    rows = [[c["case"], r["what"], f"{r['ms']:.0f}", _percent(r["rmse"])] for c in cases for r in c["rows"]]
    out += table(["scene", "way", "ms", "RMSE"], rows)
    rows = [
        [c["case"], f"{c['mean']:.4f}", _percent(c["tiles"]), _percent(c["at_our_time"]),
         f"{c['at_our_time'] / c['rows'][0]['rmse']:.0f}"]
        for c in cases
    ]  # fmt: skip
    return out + table(["scene", "its mean / ours", "25 parts", "at our time", "times our error"], rows)
