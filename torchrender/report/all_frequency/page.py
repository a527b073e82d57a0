"""The page of the study of all-frequency shadows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torchrender.quality.pages import table

PUBLISHED = {
    32: (2.91, 34.45, 31.53, 1.52, 27.16, 22.64),
    64: (1.91, 24.83, 23.62, 1.20, 21.01, 17.87),
    96: (1.42, 18.72, 18.15, 0.98, 16.75, 14.78),
    128: (1.13, 15.50, 15.07, 0.83, 14.10, 12.80),
}
"""Pictures per second by number of spheres: CPU, GPU one level, GPU two levels, at 50 and at 200 terms."""


def page(record: Mapping[str, Any]) -> list[str]:
    """Lines of Markdown."""
    lines = [
        "# All-frequency shadows of moving objects",
        "",
        "`python -m torchrender.report.all_frequency` makes this page. Points: 128 x 128 of a plane under"
        f" {record['model']}. Skies: grace, pisa, forest, studio; those of the source (St Peter's, RNL, Galileo) are"
        " not to be had. Errors are in percent of the unshadowed light.",
        "",
    ]
    if record["shared"]:
        lines += ["Others used the machine while the times were taken: only ratios of rows within this run count.", ""]
    if record["quick"]:
        lines += ["A quick run: coarse fits, two skies.", ""]
    lines += _stored() + _times(record) + _accuracy(record)
    fits = ", ".join(f"{n}: {100 * value:.1f} %" for n, value in record["fits"].items())
    told = f"Volume of spheres outside the model, in the model's volume, by their number: {fits}."
    return [*lines, "## Fit", "", told, "", *_fits(record.get("models", []))]


def _fits(models: Sequence[Mapping[str, Any]]) -> list[str]:
    if not models:
        return []
    rows = [
        [
            m["name"],
            f"{m['error']:.3f}",
            "-" if m["asked"] is None else f"{m['asked']:.2f}",
            f"{m['s']:.0f}",
            str(m["out"]),
        ]
        for m in models
    ]
    head = ["model, spheres", "E over volume", "asked", "seconds (three starts)", "points outside of their spheres"]
    return [*table(head, rows), "Asked for the armadillo: 60 s."]


def _stored() -> list[str]:
    head = ["function", "resolution", "stored here", "in the source"]
    rows = [
        ["light", "6 x 32 x 32, 3 channels", "kept wavelets of the two finest levels", "all, and kept wavelets"],
        [
            "cosine",
            "6 x 32 x 32",
            "means over squares of the kept wavelets, 486 normals",
            "all, and kept wavelets, 384",
        ],
        ["light times cosine", "6 x 8 x 8", "sums over blocks, 486 normals, remade with the light", "-"],
        [
            "visibility",
            "6 x 32 x 32 bits",
            "counts of 6 x 8 x 8 blocks, 4 x 4 look-up",
            "both levels, means at run time",
        ],
    ]
    return ["## What is stored (table 1)", "", *table(head, rows)]


def _times(record: Mapping[str, Any]) -> list[str]:
    took = record["times"]["all"]
    head = ["spheres", "50, I", "50, II", "200, I", "200, II", "source CPU, 200", "source GPU-II, 200"]
    rows = []
    for count, known in PUBLISHED.items():
        if f"{count},50,1" not in took:
            continue
        own = [f"{1e3 / took[f'{count},{terms},{level}']:.1f}" for terms in (50, 200) for level in (1, 2)]
        rows.append([str(count), *own, f"{known[3]:.2f}", f"{known[5]:.2f}"])
    stages = record["times"]["stages"]
    ratio = stages["plain sum over texels"] / took["64,200,2"]
    return [
        "## Pictures per second of 16,384 points (table 2)",
        "",
        *table(head, rows),
        *table(["stage, 64 spheres", "ms"], [[name, f"{value:.1f}"] for name, value in stages.items()]),
        f"The plain sum over texels on the same bits takes {ratio:.1f} times as long as ours at 200 terms and two"
        " levels (asked: 6). Asked for 64 spheres: 10 pictures per second; for 128: 6; for a light that turns: 15 ms.",
        "",
    ]


def _accuracy(record: Mapping[str, Any]) -> list[str]:
    lines = [
        "## Errors",
        "",
        "Without a word of the mesh, errors are against the sum over texels with the same bits; the last column is the"
        " error against rays into the mesh. As published: both functions truncated, and the nearest of 384 normals, of"
        " which the plane's own is as far away as any can be; blended: the same sums with our normals. Snug spheres:"
        " as pictures take them, smaller than those that cover, so that together they hold the model's volume. Their"
        " columns, and that of the spheres for the mesh, are against the mesh. Mitsuba at equal time is not compared"
        " here.",
        "",
    ]
    for name, ways in record["accuracy"].items():
        environment, count = name.split(",")
        rows = []
        for way, found in ways.items():
            mesh = f"{found['mesh']:.2f}" if "mesh" in found else "-"
            rows.append([way, f"{found['rms']:.3f}", f"{found['most']:.2f}", f"{found['psnr']:.1f}", mesh])
        ours = ways["ours, exact caps"]["rms"]
        lines += [f"### {environment}, {count} spheres", ""]
        lines += table(["way", "RMS, %", "largest, %", "PSNR, dB", "RMS against the mesh, %"], rows)
        lines += [
            f"SHEXP errs by {ways['SHEXP']['rms'] / max(ours, 1e-12):.1f} times as much as ours, the best spherical"
            f" harmonics by {ways['best harmonics']['rms'] / max(ours, 1e-12):.1f} times.",
            "",
        ]
    return lines
