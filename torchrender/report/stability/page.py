"""The page of the stability suite."""

from __future__ import annotations

import math
from typing import Any

from torchrender.quality.machine import machine_line


def page(record: dict[str, Any]) -> str:
    """The Markdown page of a record of :mod:`torchrender.report.stability.study`."""
    findings = {(f["effect"], f["case"]): f for f in record["findings"]}
    run = [f for f in record["findings"] if f["skipped"] is None]
    bad = [f for f in run if f["faults"]]
    lines = [
        "# Numerical stability, measured",
        "",
        f"`python -m torchrender.report.stability` on {machine_line(record['machine'])}",
        "",
        f"{len(run)} pairs of effect and case: {len(run) - len(bad)} without a fault, {len(bad)} with one. In all of "
        "them without a fault, every value is finite and within its physical bounds (radiance at most that of all "
        "lights at once, visibility in [0, 1]), the result is the same bit by bit when run again with one thread, and "
        "float32 and float64 tensors of the same vertices give the same bit by bit.",
        "",
    ]
    lines += [f"- **{f['effect']}, {f['case']}**: {'; '.join(f['faults'])}" for f in bad] + ([""] if bad else [])
    lines += _laws(record, run)
    lines += _matrix(record, findings)
    lines += _twins(record, findings)
    lines += _numerics(record)
    lines += ["## Cases", ""]
    lines += [f"- **{case['name']}**: {case['why']}." for case in record["cases"]]
    return "\n".join([*lines, ""])


def _laws(record: dict[str, Any], run: list[dict[str, Any]]) -> list[str]:
    lines = ["## Laws", "", "| effect | what must hold: deviation | limit | worst | in case |", "|---|---|---|---|---|"]
    for effect in record["effects"]:
        own = [f for f in run if f["effect"] == effect["name"]]
        if own:
            worst = max(own, key=lambda f: f["law"])
            where = worst["case"] if worst["law"] > 0 else ""
            cells = [effect["name"], effect["law"], f"{effect['limit']:g}", number(worst["law"]), where]
            lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def _matrix(record: dict[str, Any], findings: dict[tuple[str, str], dict[str, Any]]) -> list[str]:
    names = [e["name"] for e in record["effects"]]
    lines = [
        "## Deviations",
        "",
        "Share of values in percent that change by more than a thousandth when vertices are rounded to float32 (it "
        "leaves those of the studio in other views and lights as they are) / deviation from the law above; "
        "a dash: nothing to examine, or the case differs only in what the effect does not depend on.",
        "",
        "| case | " + " | ".join(name.replace("_", " ") for name in names) + " |",
        "|---" * (len(names) + 1) + "|",
    ]
    for case in record["cases"]:
        cells = [_cell(findings.get((name, case["name"]))) for name in names]
        if any(cell != "–" for cell in cells):
            lines.append(f"| {case['name']} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _cell(finding: dict[str, Any] | None) -> str:
    if finding is None or finding["skipped"] is not None:
        return "–"
    rounding = "" if finding["rounding"] is None else f"{number(100 * finding['rounding'])} / "
    text = rounding + number(finding["law"])
    return f"**{text}**" if finding["faults"] else text


def _twins(record: dict[str, Any], findings: dict[tuple[str, str], dict[str, Any]]) -> list[str]:
    cases = [c for c in record["cases"] if c["twin"] is not None]
    lines = [
        "## Cases that must look like the studio",
        "",
        "Share of values in percent that differ by more than a thousandth; effects along the world's axes are not "
        "asked about the turned one.",
        "",
        "| effect | " + " | ".join(c["name"] for c in cases) + " |",
        "|---" * (len(cases) + 1) + "|",
    ]
    for effect in record["effects"]:
        own = [findings.get((effect["name"], c["name"])) for c in cases]
        shown = ["–" if f is None or f["twin"] is None else number(100 * f["twin"]) for f in own]
        if any(cell != "–" for cell in shown):
            lines.append(f"| {effect['name']} | " + " | ".join(shown) + " |")
    return [*lines, ""]


def _numerics(record: dict[str, Any]) -> list[str]:
    lines = [
        "## Numerical functions in float32 and float64",
        "",
        "Largest difference, relative to the result's size.",
        "",
    ]
    lines += ["| function | difference |", "|---|---|"]
    lines += [f"| {name} | {number(value)} |" for name, value in record["numerics"].items()]
    return [*lines, ""]


def number(value: float) -> str:
    """Two digits; plain 0 for nothing at all."""
    if value == 0:
        return "0"
    if not math.isfinite(value):
        return str(value)
    return f"{value:.1e}" if abs(value) < 1e-3 else f"{value:.2g}"
