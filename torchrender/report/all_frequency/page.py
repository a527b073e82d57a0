"""The page of the study of all-frequency shadows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table

PUBLISHED = {
    32: (2.91, 34.45, 31.53, 1.52, 27.16, 22.64),
    64: (1.91, 24.83, 23.62, 1.20, 21.01, 17.87),
    96: (1.42, 18.72, 18.15, 0.98, 16.75, 14.78),
    128: (1.13, 15.50, 15.07, 0.83, 14.10, 12.80),
}
"""Pictures per second by number of spheres: CPU, GPU one level, GPU two levels, at 50 and at 200 terms."""

ASKED_RATE = {64: 10.0, 128: 6.0}
SHIFTED = "ours, table, mean of four shifts, against exact caps"
SMOOTH = ("pisa", "forest")
"""Skies without small sources, where less is asked of spherical harmonics' share: 5 times, elsewhere 8 times."""


def page(record: Mapping[str, Any]) -> list[str]:
    """Lines of Markdown."""
    lines = [
        "# All-frequency shadows of moving objects",
        "",
        f"`python -m torchrender.report.all_frequency{' --quick' if record['quick'] else ''}` on"
        f" {machine_line(record['machine'])}",
        "",
        f"Points: 128 x 128 of a plane under {record['model']}. Skies: grace, pisa, forest, studio; those of the source"
        " (St Peter's, RNL, Galileo) are not to be had. Errors are in percent of the unshadowed light. Times are the"
        " least of several runs that take turns.",
        "",
    ]
    if record["shared"]:
        lines += ["Others used the machine while the times were taken: only ratios of rows within this run count.", ""]
    if record["quick"]:
        lines += ["A quick run: coarse fits, two skies, few samples.", ""]
    lines += _figures(record) + _stored() + _times(record) + _moving(record["moving"])
    lines += _settings(record["settings"])
    return [*lines, *_mitsuba(record["mitsuba"]), *_accuracy(record), *_by_spheres(record), *_fits(record["models"])]


def _figures(record: Mapping[str, Any]) -> list[str]:
    """What was asked for, beside what came out."""
    took, stages = record["times"]["all"], record["times"]["stages"]
    rows = []
    for count, asked in ASKED_RATE.items():
        rate = 1e3 / took[f"{count},200,2"]
        rows.append([f"pictures per second, {count} spheres, 200 terms, II", f"at least {asked:g}", f"{rate:.1f}"])
    growth = (took["128,200,2"] - took["64,200,2"]) / (took["64,200,2"] - took["32,200,2"])
    rows += [
        ["time from 64 to 128 spheres, in that from 32 to 64", "2 (linear)", f"{growth:.2f}"],
        ["a light that turns, ms", "at most 15", f"{stages['light that turns']:.1f}"],
        [
            "plain sum over texels, in our time",
            "at least 6",
            f"{stages['plain sum over texels'] / took['64,200,2']:.1f}",
        ],
        ["picture of a character that moves, ms", "at most 200", f"{record['moving']['ms']['with']['median']:.0f}"],
    ]
    for name, ways in record["accuracy"].items():
        environment, count = name.split(",")
        if count == "64":
            asked_ratio = 5 if environment in SMOOTH else 8
            for told, way in (("exact caps", "ours, exact caps"), ("table, four shifts", SHIFTED)):
                ratio = ways["SHEXP"]["rms"] / max(ways[way]["rms"], 1e-12)
                rows.append(
                    [f"error of SHEXP in ours ({told}), {environment}", f"at least {asked_ratio}", f"{ratio:.1f}"]
                )
    for environment, one in record["mitsuba"].get("skies", {}).items():
        for kind, of in (("spheres", "against spheres"), ("mesh", "against the mesh")):
            ratio = one[kind]["ours"] / max(one[kind]["mitsuba"]["rms_at_our_time"], 1e-12)
            rows.append([f"our error {of} in Mitsuba's at equal time, {environment}", "at most 0.33", f"{ratio:.2f}"])
    for one in record["models"]:
        if one["asked"] is not None:
            rows.append([f"E over volume, {one['name']}", f"at most {one['asked']:.2f}", f"{one['error']:.3f}"])
        elif one["name"].startswith("armadillo"):
            rows.append([f"seconds to fit, {one['name']}", "at most 60", f"{one['s']:.0f}"])
    return ["## Asked for, and found", "", *table(["figure", "asked", "found"], rows)]


def _fits(models: Sequence[Mapping[str, Any]]) -> list[str]:
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
    head = ["model, spheres", "E over volume", "asked", "seconds", "points outside of their spheres"]
    return ["## Fits", "", *table(head, rows), "The specification measured 0.29, 0.085 and 0.088.", ""]


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
    head = ["spheres", "50, I", "50, II", "200, I", "200, II"]
    head += [f"source {kind}, {n}" for n in (50, 200) for kind in ("CPU", "GPU-I", "GPU-II")]
    rows = []
    for count, known in PUBLISHED.items():
        own = [f"{1e3 / took[f'{count},{terms},{level}']:.1f}" for terms in (50, 200) for level in (1, 2)]
        rows.append([str(count), *own, *(f"{rate:.2f}" for rate in known)])
    stages = record["times"]["stages"]
    rest = took["64,200,2"] - stages["caps by table"]
    named = [[name, f"{value:.1f}"] for name, value in stages.items()]
    named.insert(1, ["light of what is left (all less caps by table)", f"{rest:.1f}"])
    return [
        "## Pictures per second of 16,384 points (table 2)",
        "",
        *table(head, rows),
        *table(["stage, 64 spheres", "ms"], named),
        "The table of caps takes 144 MiB on disk, which processes share. The source's processors are of 2008.",
        "",
    ]


def _moving(film: Mapping[str, Any]) -> list[str]:
    names = {
        "with": "picture with all shadows",
        "without": "the same without shadows and ambient visibility",
        "sky_shadow": "of which the pass sky_shadow",
        "move": "the scene at its next time (`Scene.at`)",
    }
    rows = [[told, f"{film['ms'][n]['median']:.0f}", f"{film['ms'][n]['least']:.0f}"] for n, told in names.items()]
    return [
        "## A character that moves",
        "",
        f"CesiumMan on a floor under grace, 512 x 512, {film['frames']} moments of its walk, each picture with the"
        " history of the one before:",
        "",
        *table(["", "median ms", "least ms"], rows),
        "![four moments](all-frequency-shadows.jpg)",
        "",
    ]


def _settings(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    names = ("all", "shaded", "close")
    head = ["setting", "ms", "the floor, %", "in shadow, %", "close to the figure, %"]
    return [
        "## What each setting costs and brings",
        "",
        "The same character at one time: least milliseconds of the shares of light of all pixels, and RMS against rays"
        " into its mesh at pixels of the floor, in percent of the unshadowed light; of these, those that miss at least"
        " 2 % of the light, and those within 8 % of the figure's height of it. One setting differs from the usual in"
        " each row. `torchrender tradeoff` draws the curve of terms, levels and points; it leaves the spheres alone,"
        " as another number of them is another shape, which would be seen to change from picture to picture.",
        "",
        *table(head, [[r["name"], f"{r['ms']:.1f}", *(f"{r[n]:.2f}" for n in names)] for r in rows]),
    ]


def _mitsuba(found: Mapping[str, Any]) -> list[str]:
    head = ["## Beside Mitsuba at equal time", ""]
    if "missing" in found:
        return [*head, str(found["missing"]) + ".", ""]
    rows = []
    for name, one in found["skies"].items():
        for kind in ("spheres", "mesh"):
            row, peer = one[kind], one[kind]["mitsuba"]
            rows.append(
                [
                    f"{name}, {kind}",
                    f"{row['noise']:.2f}",
                    f"{row['agree']:.2f}",
                    f"{one['ms']:.0f}",
                    f"{row['ours']:.2f}",
                    f"{peer['samples']}",
                    f"{peer['ms']:.0f}",
                    f"{peer['rms']:.2f}",
                    f"{peer['rms_at_our_time']:.2f}",
                    f"{row['ours'] / max(peer['rms_at_our_time'], 1e-12):.2f}",
                ]
            )
    columns = ["sky, what hides it", "noise of the reference", "sums over texels", "our ms", "our RMS, %"]
    columns += ["samples", "Mitsuba's ms", "its RMS, %", "scaled to our time", "ours in that"]
    return [
        *head,
        f"Mitsuba {found['version']}, `{found['variant']}`, integrator `direct`. The reference of both is its own"
        f" picture of {found['samples']} samples per pixel; the sky is the picture itself there, and means of 6 x 32 x"
        " 32 texels here. First whether both mean the same: RMS of sums over texels (exact caps; rays into the mesh)"
        " against that picture. The reference's noise, told by its two halves, is taken off all errors against it but"
        " Mitsuba's (squares subtracted). Then ours at 64 spheres, 200 terms, two levels, against spheres and against"
        " the mesh, and Mitsuba with as many samples as fit into our time. Where spheres come through the plane"
        " nothing is compared.",
        "",
        *table(columns, rows),
    ]


def _accuracy(record: Mapping[str, Any]) -> list[str]:
    lines = [
        "## Errors",
        "",
        "Without a word of the mesh, errors are against the sum over texels with the same bits; the last column is the"
        " error against rays into the mesh. In the dark: points from which the mesh hides at least a fifth of the"
        " light. Pictures take the table, and of four neighbouring points each rounds directions and sizes differently:"
        " the mean of four shifts. As published: both functions truncated, and the nearest of 384 normals, of which the"
        " plane's own is as far away as any can be; blended: the same sums with our normals. Snug spheres: as pictures"
        " take them, smaller than those that cover, so that together they hold the model's volume. Their columns, and"
        " that of the spheres for the mesh, are against the mesh.",
        "",
    ]
    for name, ways in record["accuracy"].items():
        environment, count = name.split(",")
        rows = []
        for way, found in ways.items():
            mesh = f"{found['mesh']:.2f}" if "mesh" in found else "-"
            rows.append(
                [
                    way,
                    f"{found['rms']:.3f}",
                    f"{found['dark']:.3f}",
                    f"{found['most']:.2f}",
                    f"{found['psnr']:.1f}",
                    mesh,
                ]
            )
        ours = ways["ours, exact caps"]["rms"]
        lines += [f"### {environment}, {count} spheres", ""]
        lines += table(
            ["way", "RMS, %", "RMS in the dark, %", "largest, %", "PSNR, dB", "RMS against the mesh, %"], rows
        )
        lines += [
            f"SHEXP errs by {ways['SHEXP']['rms'] / max(ours, 1e-12):.1f} times as much as ours with exact caps, the"
            f" best spherical harmonics by {ways['best harmonics']['rms'] / max(ours, 1e-12):.1f} times.",
            "",
        ]
    return lines


def _by_spheres(record: Mapping[str, Any]) -> list[str]:
    rows = [
        [f"{name}, {count}", f"{one['outside']:.3f}", f"{one['covering']:.2f}", f"{one['snug']:.2f}"]
        for name, found in record["by_spheres"].items()
        for count, one in found.items()
    ]
    return [
        "## What the fit costs",
        "",
        "RMS against rays into the mesh, of the exact visibility of spheres: as they were fitted (they cover the model)"
        " and snug. Points inside of spheres lie under a half-space.",
        "",
        *table(["sky, spheres", "E over volume", "covering, %", "snug, %"], rows),
    ]
