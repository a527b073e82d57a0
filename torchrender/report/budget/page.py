"""The page of the budget study: tables in Markdown and a plot."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.report.common.tables import share

Records = Sequence[dict[str, Any]]

ABOUT = 1.02
"""Times and errors of two pictures that differ by less count as the same."""


def page(record: dict[str, Any]) -> str:
    """``budget.md``."""
    study = record["study"]
    lines = [
        "# Budgets, measured",
        "",
        f"`python -m torchrender.report.budget` on {machine_line(record['machine'])}",
        "",
        f"{study['size']}² pixels, sequences of {study['frames']} pictures along paths through built-in scenes.",
        "Errors are mean FLIP against every pass at its reference, of nine windows of each picture. The first one of a",
        "sequence pays for everything that lasts: shadow maps, ray caster.",
        "",
        *budget_table(record["budgets"], study["tolerance"]),
        *path_table(record["budgets"]),
        "![times and errors](budget.png)",
        "",
        *apart(record, "presets", preset_table(record["presets"], study["tolerance"])),
        *apart(record, "deleted", deleted_table(record["deleted"])),
    ]
    return "\n".join(lines) + "\n"


def apart(record: dict[str, Any], part: str, lines: list[str]) -> list[str]:
    """A section, with where it was measured, if that was another run than that of the page."""
    where = record.get("machines", {}).get(part, record["machine"])
    if where == record["machine"]:
        return lines
    return [*lines[:2], f"`python -m torchrender.report.budget --part {part}` on {machine_line(where)}", "", *lines[2:]]


def budget_table(records: Records, tolerance: float) -> list[str]:
    """Kept, said to be impossible, complete, and errors beside the predicted ones."""
    lines = [
        "## Kept?",
        "",
        f"Kept: within {round(100 * (tolerance - 1))} % of the budget. Said: the plan called it impossible. Error",
        "ratio: measured by predicted error, of the pictures that were checked.",
        "",
        "| budget ms | pictures | kept % | kept or said % | first pictures kept | median ms | complete % "
        "| error: measured | predicted | ratio, median | within 1.5× % |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for budget in sorted({r["budget_ms"] for r in records}):
        rows = [r for r in records if r["budget_ms"] == budget]
        first = [r for r in rows if r["frame"] == 0]
        checked = [r for r in rows if "error" in r and r["predicted_error"]]
        ratios = [r["error"] / r["predicted_error"] for r in checked]
        near = [q for q in ratios if 1 / 1.5 <= q <= 1.5]
        lines.append(
            f"| {budget} | {len(rows)} | {share((r['kept'] for r in rows), 1)} "
            f"| {share((r['kept'] or not r['possible'] for r in rows), 1)} "
            f"| {sum(r['kept'] for r in first)} of {len(first)} "
            f"| {statistics.median(r['ms'] for r in rows):.0f} | {share((r['complete'] >= 1.0 for r in rows), 1)} "
            f"| {_mean(r['error'] for r in checked):.4f} | {_mean(r['predicted_error'] for r in checked):.4f} "
            f"| {statistics.median(ratios) if ratios else math.nan:.2f} | {100 * len(near) / max(len(ratios), 1):.0f} |"
        )
    return [*lines, ""]


def path_table(records: Records) -> list[str]:
    """Where budgets are missed."""
    budgets = sorted({r["budget_ms"] for r in records})
    lines = ["## By path", "", "Median ms after the first picture, and pictures over the budget without a word.", ""]
    lines += [f"| path | {' | '.join(f'{b} ms' for b in budgets)} |", f"|{'---|' * (len(budgets) + 1)}"]
    for path in dict.fromkeys(r["path"] for r in records):
        cells = []
        for budget in budgets:
            rows = [r for r in records if r["path"] == path and r["budget_ms"] == budget]
            over = sum(not r["kept"] and r["possible"] for r in rows)
            cells.append(f"{statistics.median(r['ms'] for r in rows[1:]):.0f}, {over} over")
        lines.append(f"| {path} | {' | '.join(cells)} |")
    return [*lines, ""]


def preset_table(records: Records, tolerance: float) -> list[str]:
    """Fixed settings beside the planner's choice."""
    lines = [
        "## Beside fixed settings",
        "",
        "A preset turns all knobs alike. The planner gets its time as budget, then its error as bound; times are",
        "medians of a still sequence, planning included. Same: it chose the preset's own settings, so that planning",
        "alone differs.",
        "",
        "| scene, preset | ms | error | at its time: ms | error | at its error: ms | error |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in records:
        time, bound = r["at_its_time"], r["at_its_error"]
        lines.append(
            f"| {r['scene']}, {r['preset']} | {r['ms']:.0f} | {r['error']:.4f} "
            f"| {time['ms']:.0f} | {time['error']:.4f}{_told(time)} "
            f"| {bound['ms']:.0f}{_told(bound)} | {bound['error']:.4f} |"
        )
    total = len(records)
    in_time = [r for r in records if r["at_its_time"]["ms"] <= tolerance * r["ms"]]
    better = [r for r in in_time if r["at_its_time"]["error"] <= ABOUT * r["error"]]
    met = [r for r in records if r["at_its_error"]["error"] <= ABOUT * r["error"]]
    faster = [r for r in met if r["at_its_error"]["ms"] <= ABOUT * r["ms"]]
    again = [r for r in met if r not in faster and r["at_its_error"]["same"]]
    return [
        *lines,
        "",
        f"At its time, which {len(in_time)} keep within {round(100 * (tolerance - 1))} %, at least as accurate: "
        f"{len(better)} of {total} (26). At its error, which {len(met)} meet, faster: {len(faster)} of {total} (26); "
        f"{len(again)} more are slower by planning alone, with the same settings.",
        "",
    ]


def _told(record: dict[str, Any]) -> str:
    return " same" if record["same"] else ""


def deleted_table(records: Records) -> list[str]:
    """What passes cost that do not apply."""
    lines = [
        "## Nothing is paid for what does not apply",
        "",
        "Diffuse scenes with the whole pass table, and with the passes deleted that do not apply there. Medians.",
        "",
        "| scene | all passes, ms | deleted, ms | ratio |",
        "|---|---|---|---|",
    ]
    lines += [f"| {r['scene']} | {r['all_ms']:.1f} | {r['few_ms']:.1f} | {r['ratio']:.3f} |" for r in records]
    return lines


def plot(path: Path, record: dict[str, Any]) -> None:
    """Times by budget, and measured by predicted errors."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    records = record["budgets"]
    budgets = sorted({r["budget_ms"] for r in records})
    for column, budget in enumerate(budgets):
        rows = [r for r in records if r["budget_ms"] == budget]
        for possible, color in ((True, "tab:blue"), (False, "tab:orange")):
            shown = [r["ms"] / budget for r in rows if r["possible"] == possible]
            spread = [column + 0.3 * math.sin(97.0 * i) for i in range(len(shown))]
            label = None if column else ("chosen for the budget" if possible else "said to be impossible")
            left.plot(spread, shown, ".", color=color, markersize=4, label=label)
    left.axhline(1.1, color="0.5", linewidth=0.8)
    left.set(xticks=range(len(budgets)), xticklabels=[f"{b} ms" for b in budgets], ylabel="time / budget", ylim=(0, 3))
    left.legend(fontsize=8)
    checked = [r for r in records if "error" in r and r["predicted_error"]]
    right.loglog([r["predicted_error"] for r in checked], [r["error"] for r in checked], ".", color="tab:blue")
    ends = [1e-3, 0.5]
    right.plot(ends, ends, color="0.5", linewidth=0.8)
    for factor in (1.5, 1 / 1.5):
        right.plot(ends, [factor * e for e in ends], "--", color="0.7", linewidth=0.8)
    right.set(xlabel="predicted error (mean FLIP)", ylabel="measured")
    figure.savefig(path, dpi=100, format="png")


def _mean(values: Any) -> float:
    found = list(values)
    return statistics.fmean(found) if found else math.nan
