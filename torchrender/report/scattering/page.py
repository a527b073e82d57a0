"""The page of the study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table, write_text

ASKED = {
    "T2 lamp, homogeneous": 50, "T2 sun, homogeneous": 55, "T2 sun, height": 80,
    "T2 lamp, height": 80, "T2 sun, grid": 130, "T2 lamp, grid": 200,
}  # fmt: skip
"""Milliseconds at 800 x 600 that were asked for."""


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
        f"Times are of {width} x {height} pixels with all that a picture needs anew (slices, pyramids, tables, marks,",
        "interpolation, transmittance), medians of a run in which the candidates took turns. The machine was",
        "shared with other work: ratios within a table count, not milliseconds. Errors are RMSE over the mean.",
        "",
        "![T1, T2 with a lamp, T2 with the sun; homogeneous, height, grid](scattering.jpg)",
        "",
        "## The published table: T1 without shadows",
        "",
    ]
    out += _published(record["published"])
    out += ["## Ways: errors against the walk, against rays, and times", ""]
    out += [
        "`walk` is exact for the texels of the light's images, `rays` casts shadow rays; edges are the twentieth of",
        "the pixels where light changes most. `64 steps` is the source's way, with a look-up at each step.",
        "",
    ]
    out += _ways(record["ways"])
    out += ["## Time against steps, blocks, lights, and rays that meet the medium", ""]
    out += _costs(record["costs"])
    out += ["## Baselines, against the mean of 8 jittered pictures of 1,024 steps", ""]
    rows = [[k, _percent(v["rmse"]), _percent(v["p99"])] for k, v in record["baselines"].items()]
    out += table(["way", "RMSE", "99th percentile"], rows)
    out += ["## Trends", ""]
    rows = [[k, *(f"{v:.4f}" for v in values)] for k, values in record["trends"].items()]
    out += table(["mean scattered light", "1", "2", "3", "4", "5"], rows)
    film = record["film"]
    out += ["## A sun that moves", ""]
    out += [
        f"Variance over {study['frames']} pictures of the error of 3 x 3 blocks: {film['ratio']:.3f} of that of plain",
        "bilinear interpolation of a third of the rows and columns (asked: at most 0.5). From above: the light, the",
        "error of blocks and that of bilinear interpolation, eight times as bright.",
        "",
        "![Five pictures of the film](scattering-film.jpg)",
        "",
        "## Edits",
        "",
        "Nothing lasts from picture to picture. Least time of a picture; asked: after an edit at most 1.05 of the",
        "next one, and at most 1 ms where no medium is in view, for which the planner asks nothing but this.",
        "",
    ]
    out += table(["picture of", "ms"], [[k, f"{v:.2f}"] for k, v in record["edits"].items()])
    out += _peer(record["peer"])
    return out


def _published(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    cells = [
        [f"{r['block']} x {r['block']}", str(r["halo_guard_px"]), r["gradient"], _percent(r["marched"]),
         _percent(r["rmse"]), _percent(r["p99"]), _percent(r["max"])]
        for r in rows
    ]  # fmt: skip
    return table(["block", "guard px", "gradient", "marched", "RMSE", "99th percentile", "greatest"], cells)


def _ways(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    cells = []
    for r in rows:
        asked = ASKED.get(r["case"]) if r["way"].startswith("slices") else None
        cells.append([
            f"{r['case']}: {r['way']}", f"{r['ms']:.0f}", f"{r['least_ms']:.0f}", "" if asked is None else str(asked),
            _percent(r["share"]), _percent(r["walk"]["rmse"]), _percent(r["walk"].get("edge", 0.0)),
            _percent(r["rays"]["rmse"]), _percent(r["rays"].get("edge", 0.0)),
        ])  # fmt: skip
    head = ["case", "ms", "least ms", "asked", "integrated", "to walk", "edges", "to rays", "edges"]
    return table(head, cells)


def _costs(costs: Mapping[str, Any]) -> list[str]:
    out = table(["way", "ms"], [[k, f"{v['median']:.0f}"] for k, v in costs["ways"].items()])
    out += table(["lamps", "ms"], [[k, f"{v['median']:.0f}"] for k, v in costs["lights"].items()])
    return out + table(
        ["share of rays in the medium", "ms"], [[k, f"{v['median']:.1f}"] for k, v in costs["shares"].items()]
    )


def _peer(peer: Mapping[str, Any]) -> list[str]:
    out = ["## Beside a path tracer", ""]
    if "missing" in peer:
        return [*out, peer["missing"] + ".", ""]
    out += [
        f"Mitsuba {peer['version']}, {peer['variant']}, `volpath` with one scattering, black surfaces. `at our time`:",
        "its error if it had as long as our picture, by the law of its own noise (asked: ten times ours or more).",
        "",
    ]
    rows = [[r["case"], r["what"], f"{r['ms']:.0f}", _percent(r["rmse"])] for r in peer["rows"]]
    return out + table(["scene", "way", "ms", "RMSE"], rows)
