"""The page of the study of unseen scenes: tables in Markdown."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.report.common.tables import share

Records = Sequence[dict[str, Any]]
CLOSE, FAR = 1.5, 2.5
"""Factors within which a measured error is of the predicted one."""

SEEN = 5e-4
"""Errors below are called zero: nobody sees them, and their ratios mean nothing."""


def page(record: dict[str, Any]) -> str:
    """``unseen.md``."""
    records = record["records"]
    names = list(dict.fromkeys(r["scene"] for r in records))
    lines = [
        "# Predictions on scenes that nobody measured",
        "",
        f"`python -m torchrender.report.unseen` on {machine_line(record['machine'])}",
        "",
        f"{len(names)} scenes that calibration never saw ({', '.join(names)}), on other paths and at other sizes.",
        "Errors are mean FLIP of the last picture of a short sequence against every pass at its reference.",
        "",
        *predictions(records),
        *bounds(records),
        *budgets(records, record["tolerance"]),
        *by_scene(records),
    ]
    return "\n".join(lines) + "\n"


def ratio_of(record: dict[str, Any]) -> float:
    """Measured by predicted error."""
    return float(max(record["error"], SEEN) / max(record["predicted"] or 0.0, SEEN))


def predictions(records: Records) -> list[str]:
    """How far off predicted errors are."""
    lines = [
        "## Predicted errors",
        "",
        "| pictures | count | measured / predicted, median | within 1.5× % (85) | within 2.5× % (97) "
        "| interval holds % (90) |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    kinds = {
        "under a budget, last of a sequence": ("budget",),
        "under a bound, last of a sequence": ("bound", "rung"),
        "under a bound, alone": ("bound alone",),
        "all": ("budget", "bound", "rung", "bound alone"),
    }
    for title, chosen in kinds.items():
        rows = [r for r in records if r["kind"] in chosen and r["predicted"] is not None]
        if not rows:
            continue
        ratios = [ratio_of(r) for r in rows]
        held = [r["interval"][0] - SEEN <= r["error"] <= r["interval"][1] + SEEN for r in rows]
        lines.append(
            f"| {title} | {len(rows)} | {statistics.median(ratios):.2f} "
            f"| {share(1 / CLOSE <= q <= CLOSE for q in ratios)} | {share(1 / FAR <= q <= FAR for q in ratios)} "
            f"| {share(held)} |"
        )
    return [*lines, ""]


def bounds(records: Records) -> list[str]:
    """Whether bounds are met, and what that costs beside the quickest of all bounds tried that meets it."""
    lines = [
        "## Error bounds",
        "",
        "Cheapest: of the settings that any bound chose for the same scene, the quickest whose measured error meets",
        "the bound. Times are medians of the pictures after the first.",
        "",
        "| bound | pictures | met % (95) | met or said % | median error / bound "
        "| time / cheapest, median | within 1.3× % |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for kind, title in (("bound", "in a sequence"), ("bound alone", "alone")):
        for bound in sorted({r["wish"] for r in records if r["kind"] == kind}, reverse=True):
            rows = [r for r in records if r["kind"] == kind and r["wish"] == bound]
            met = [r["error"] <= bound for r in rows]
            costs = [cost for cost in (_over_cheapest(r, records) for r in rows) if cost is not None]
            told = f"{statistics.median(costs):.2f} | {share(c <= 1.3 for c in costs)}" if costs else "– | –"
            lines.append(
                f"| {bound:g}, {title} | {len(rows)} | {share(met)} "
                f"| {share(m or not r['possible'] for m, r in zip(met, rows, strict=True))} "
                f"| {statistics.median(r['error'] / bound for r in rows):.2f} | {told} |"
            )
    return [*lines, ""]


def _over_cheapest(record: dict[str, Any], records: Records) -> float | None:
    """Time of a choice by that of the quickest that meets the same bound; None alone, or where none does."""
    rungs = [r for r in records if r["scene"] == record["scene"] and r["kind"] in ("bound", "rung") and r["late_ms"]]
    good = [statistics.median(r["late_ms"]) for r in rungs if r["error"] <= record["wish"]]
    if not good or not record["late_ms"]:
        return None
    return float(statistics.median(record["late_ms"]) / min(good))


def budgets(records: Records, tolerance: float) -> list[str]:
    """Whether budgets are kept after the first picture."""
    lines = [
        "## Budgets",
        "",
        f"Kept: within {round(100 * (tolerance - 1))} % of the budget, from the second picture on. Said: the plan"
        " called it impossible.",
        "",
        "| budget ms | pictures | kept % (95) | kept or said % | median ms |",
        "|---:|---:|---:|---:|---:|",
    ]
    for budget in sorted({r["wish"] for r in records if r["kind"] == "budget"}):
        rows = [(ms, r) for r in records if r["kind"] == "budget" and r["wish"] == budget for ms in r["late_ms"]]
        kept = [ms <= tolerance * budget for ms, _ in rows]
        said = [k or not r["possible"] for k, (_, r) in zip(kept, rows, strict=True)]
        middle = statistics.median(ms for ms, _ in rows)
        lines.append(f"| {budget:g} | {len(rows)} | {share(kept)} | {share(said)} | {middle:.0f} |")
    return [*lines, ""]


def by_scene(records: Records) -> list[str]:
    """The worst of each scene."""
    lines = [
        "## By scene",
        "",
        "| scene | side | measured / predicted: least | median | most | with the settings of the most |",
        "|---|---:|---:|---:|---:|---|",
    ]
    for name in dict.fromkeys(r["scene"] for r in records):
        rows = sorted((r for r in records if r["scene"] == name and r["predicted"] is not None), key=ratio_of)
        if not rows:
            continue
        told = ", ".join(f"{k} {v}" for k, v in rows[-1]["settings"].items())
        middle = statistics.median(ratio_of(r) for r in rows)
        least, most = ratio_of(rows[0]), ratio_of(rows[-1])
        lines.append(f"| {name} | {rows[0]['side']} | {least:.2f} | {middle:.2f} | {most:.2f} | {told} |")
    return [*lines, ""]
