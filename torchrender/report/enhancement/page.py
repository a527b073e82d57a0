"""The page of the study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table

PUBLISHED = {
    ("sum", 0): (1.09, 8.03, 1.15, 2.00),
    ("sum", 1): (2.93, 4.41, 3.62, 3.88),
    ("sum", 2): (1.20, 7.89, 1.02, 1.35),
    ("signed_l2", 0): (0.93, 7.15, 0.98, 1.72),
    ("signed_l2", 1): (2.24, 4.49, 2.43, 2.80),
    ("signed_l2", 2): (2.47, 5.64, 2.65, 3.12),
}
"""Section 8: grazing without and with projection, front without and with."""

INTRODUCTION = """\
How the shaded colour changes across the picture, differentiated on the surface and carried through the projection, is
added to it (`RenderOptions(enhance=EnhanceOptions())`, `--enhance`). Objects are white, the light stands to the upper
left of the eye without fall-off; *grazing* are pixels whose normal has a cosine of 0.15 to 0.4 to the eye, *front*
those above 0.7, six pixels and more from the outline. Contrast is the standard deviation of what a blur of 3 pixels
takes away, over that of the plain picture. *Ours* is `I + 0.6 mag` with `signed_l2`, `exponent=1.5`, `centred=True`;
*shift 0.03* rows take the greatest strength up to 1 whose mean level is off by 0.03 at most; the limit is 0.25.
"""


def page(record: Mapping[str, Any]) -> list[str]:
    """Lines of Markdown."""
    machine = machine_line(record["machine"])
    lines = ["# Gradient-enhanced pictures", "", f"`python -m torchrender.report.enhancement` on {machine}", ""]
    lines += [INTRODUCTION, "![objects down, methods across](enhancement.jpg)", ""]
    return [*lines, *_table(record), *_objects(record), *_ablation(record), *_times(record)]


def _table(record: Mapping[str, Any]) -> list[str]:
    rows = []
    for number, row in enumerate(record["table"]):
        wanted = PUBLISHED[row["mag"], number % 3]
        found = (row["without"][0], row["with"][0], row["without"][1], row["with"][1])
        light = "at the eye" if number % 3 == 0 else f"({row['light'][0]:g}, {row['light'][1]:g}, 0)"
        ratio = found[1] / found[0]
        cells = [f"{f:.2f} ({w:.2f})" for f, w in zip(found, wanted, strict=True)]
        rows.append([f"{row['mag']}, {light}", *cells, f"{ratio:.2f}"])
    head = ["mag, light", "grazing, no projection", "grazing", "front, no projection", "front", "gain by projection"]
    return [
        "## The test object of the specification",
        "",
        "Contrast gain, in brackets that of the specification (asked: within 15 %, and a gain by projection of at",
        "least 1.2 in every row). With the light beside the eye the line between lit and unlit runs through both",
        "regions; the step there weighs most in the figures, and with side light in front they differ by more than",
        "asked. The outline is left out by six pixels along rows, columns and diagonals.",
        "",
        *table(head, rows),
    ]


def _objects(record: Mapping[str, Any]) -> list[str]:
    lines = [
        "## Beside what else makes shape readable",
        "",
        "*Shift* is that of the mean level; *overshoot* the 99.9th percentile of the change within 4 pixels of",
        "creases; *ridges* the area under the ROC curve of the change as a detector of the 5 % of the surface with the",
        "strongest principal curvature (libigl). Asked: grazing at least 1.2 times that of Radiance Scaling at a shift",
        "of at most 0.03, ridges 0.05 above it; overshoot with the limit (`overshoot_limit=1/3`) at most a third of",
        "that without, grazing still 1.1.",
        "",
    ]
    for name, rows in record["objects"].items():
        cells = [
            [way, *(_figure(m[k]) for k in ("grazing", "front", "shift", "overshoot", "ridges"))]
            for way, m in rows.items()
        ]
        lines += [f"### {name}", "", *table(["method", "grazing", "front", "shift", "overshoot", "ridges"], cells)]
    return lines


def _figure(value: float) -> str:
    return "–" if value != value else f"{value:.3f}" if abs(value) < 1 else f"{value:.2f}"


def _ablation(record: Mapping[str, Any]) -> list[str]:
    terms = [
        [", ".join(r["terms"]) or "none", f"{r['gain']:.2f}", f"{r['shift']:+.3f}", f"{r['ms']:.0f}"]
        for r in record["terms"]
    ]
    far = [
        [f"{r['cm']:.0f} cm", *(f"{r[k]:.4f}" for k in ("Radiance Scaling", "ours without projection", "plain"))]
        for r in record["distance"]
    ]
    return [
        "## Terms",
        "",
        "Rendered with shadows and the magnitude `sum`; grazing contrast, mean level, milliseconds of the pass.",
        "",
        *table(["terms", "grazing gain", "shift", "ms"], terms),
        "## Distance of the eye",
        "",
        "RMS difference of ours from other pictures, both blurred by a pixel for each 50 cm: it must fall.",
        "",
        *table(["distance", "Radiance Scaling", "without projection", "plain"], far),
    ]


def _times(record: Mapping[str, Any]) -> list[str]:
    times = record["times"]
    ours = times["descriptor"]["ours"]["median"]
    descriptor = [[name, f"{t['median']:.1f}", f"{t['median'] / ours:.1f}"] for name, t in times["descriptor"].items()]
    plain = times["frame"]["plain"]["median"]
    frame = [[name, f"{t['median']:.0f}", f"{t['median'] / plain:.2f}"] for name, t in times["frame"].items()]
    size = times["size"]
    return [
        "## Time",
        "",
        f"The descriptor of {times['vertices']:,} vertices (asked: 15 ms for 100,000, five times as fast as",
        "pymeshlab's principal curvature), in turns within one run, milliseconds:",
        "",
        *table(["", "median", "ratio"], descriptor),
        f"A whole picture of the dragon at {size} x {size} in a sequence (asked: at most 1.5 times the plain one):",
        "",
        *table(["", "median", "ratio"], frame),
    ]
