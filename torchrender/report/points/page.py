"""The page of the study of points: tables beside the published numbers."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import write_text

PUBLISHED = (  # model, mode, points and drawn points in millions, frames per second (512², P4 2.4 GHz, ATI 9800 Pro)
    ("Lucy", "point sprite", 10.073, 3.071, 10.25),
    ("Dragon", "adaptive EWA", 1.28, 0.42, 10.75),
    ("Buddha", "adaptive EWA", 1.06, 0.31, 15.12),
    ("Hip", "adaptive EWA", 0.53, 0.15, 38.12),
    ("Hand", "adaptive EWA", 0.33, 0.11, 55.23),
    ("Lion", "adaptive EWA", 0.18, 0.07, 80.5),
)


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``points.md`` in ``folder``."""
    size = record["study"]["size"]
    lines = [
        "# Large point models, measured",
        "",
        f"`python -m torchrender.report.points` on {machine_line(record['machine'])}",
        f"Pictures of {size}² pixels; times are medians in milliseconds of candidates that take turns in one run. PSNR "
        "and SSIM are over whole pictures in linear light.",
        "",
        *_models(record["models"]),
        *_scaling(record["scaling"], record["one_pixel"]),
        *_peer(record["peer"]),
        *_quality(record["quality"], next(iter(record["models"])), record["study"]["factor"]),
        *_aliasing(record["aliasing"]),
        *_compression(record["compression"]),
    ]
    write_text(folder / "points.md", lines)


def _models(models: dict[str, Any]) -> list[str]:
    lines = [
        "## Points drawn and frames per second (table 3.2)",
        "",
        "| model | mode | points | drawn | drawn / points | frames/s | M drawn/s |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, mode, points, drawn, fps in PUBLISHED:
        share = drawn / points
        lines.append(
            f"| {name} (published, 2000s GPU) | {mode} | {points} M | {drawn} M | {share:.2f} | {fps} "
            f"| {drawn * fps:.1f} |"
        )
    for name, row in models.items():
        s = row["statistics"]
        for mode in ("adaptive", "deepest", "squares"):
            ms = row["ms"][mode]["median"]
            drawn = row["drawn_deepest"] if mode == "deepest" else s["drawn"]
            cells = [f"{s['points'] / 1e6:.3f} M", f"{drawn / 1e6:.3f} M", f"{drawn / s['points']:.2f}"]
            cells += [f"{1e3 / ms:.1f}", f"{drawn / ms / 1e3:.1f}"]
            label = {"adaptive": "adaptive EWA", "deepest": "adaptive EWA, no levels", "squares": "squares"}[mode]
            lines.append(f"| {name} | {label} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "| model | patches | outside | back | full / reconstruction / low-pass % "
        "| select | read | project | sort | draw |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in models.items():
        s = row["statistics"]
        steps = " | ".join(f"{s['ms'][k]:.1f}" for k in ("select", "read", "project", "sort", "draw"))
        outside, back = s["patches_outside"], s["patches_back"]
        lines.append(f"| {name} | {s['patches']:,} | {outside:,} | {back:,} | {shares(s)} | {steps} |")
    return [*lines, ""]


def shares(row: dict[str, Any]) -> str:
    """Percent of drawn points by filter."""
    whole = max(row["full"] + row["reconstruction"] + row["low_pass"], 1)
    return " / ".join(f"{100 * row[k] / whole:.0f}" for k in ("full", "reconstruction", "low_pass"))


def _scaling(scaling: dict[str, Any], pixel: dict[str, Any]) -> list[str]:
    lines = [
        "## Up to ten million points",
        "",
        "A synthetic model that fills the picture. Bytes a point: eight for each node, inner ones included, and the "
        "headers of the patches; colours (three a node) beside them.",
        "",
        "| points | build s | compress s | patches | nodes / point | bytes a point | drawn | plain ms | compressed ms "
        "| frames/s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for count, row in scaling.items():
        ms = {k: v["median"] for k, v in row["ms"].items()}
        lines.append(
            f"| {int(count):,} | {row['build_s']:.1f} | {row['compress_s']:.1f} | {row['patches']:,} "
            f"| {row['nodes'] / int(count):.2f} | {row['bytes_per_point']:.1f} | {row['statistics']['drawn']:,} "
            f"| {ms['plain']:.0f} | {ms['compressed']:.0f} | {1e3 / ms['compressed']:.1f} |"
        )
    deep, levels = pixel["deepest"], pixel["levels"]
    lines += [
        "",
        f"{pixel['points']:,} points in one pixel: {levels['ms']:.0f} ms with levels ({levels['drawn']:,} drawn), "
        f"{deep['ms']:.0f} ms without ({deep['drawn']:,} drawn).",
        "",
    ]
    return lines


def _peer(peer: dict[str, Any]) -> list[str]:
    lines = [f"## Beside pyvista: {peer['points']:,} points at {peer['size']}²", ""]
    other = peer["pyvista"]
    own = {k: v["median"] for k, v in peer["ms"].items()}
    if "skipped" in other:
        return [*lines, f"Not measured: {other['skipped']}.", ""]
    slow = median(other["ms"])
    return [
        *lines,
        "| | ms a frame | ratio |",
        "|---|---|---|",
        f"| pyvista `points_gaussian` ({other['renderer']}) | {slow:.0f} | 1 |",
        f"| adaptive EWA | {own['levels']:.1f} | {slow / own['levels']:.1f} |",
        f"| adaptive EWA, no levels | {own['deepest']:.1f} | {slow / own['deepest']:.1f} |",
        "",
    ]


def _quality(quality: dict[str, Any], model: str, factor: int) -> list[str]:
    lines = [
        f"## Filters: {model}",
        "",
        f"Against full EWA, and against the mesh itself with {factor} x {factor} samples a pixel. Outline: pixels "
        "drawn outside the model for each pixel that its outline crosses.",
        "",
    ]
    for case, rows in quality.items():
        whole = rows["full"]["ms"]["median"]
        lines += [
            f"### {case}",
            "",
            "| filter | ms | full / this | weights | full / reconstruction / low-pass % | PSNR to full | PSNR | SSIM "
            "| holes | outline |",
            "|---|---|---|---|---|---|---|---|---|---|",
        ]
        for name, row in rows.items():
            ms = row["ms"]["median"]
            cells = [f"{ms:.1f}", f"{whole / ms:.2f}", f"{row['evaluations']:,}", shares(row)]
            cells += [f"{row['psnr_full']:.1f}" if row["psnr_full"] < 120 else "equal"]
            if "psnr" in row:
                cells += [f"{row['psnr']:.2f}", f"{row['ssim']:.4f}", f"{row['holes']}", f"{row['outline']:.2f}"]
            else:
                cells += ["–"] * 4
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
        lines.append("")
    return [*lines, "Adaptive EWA, squares, and the mesh by supersampling:", "", "![points](points.png)", ""]


def _aliasing(aliasing: dict[str, Any]) -> list[str]:
    lines = [
        "## A minified checkerboard",
        "",
        "Ground plane at 128² against 16 x 16 rays a pixel; far: beyond half the distance, where a pixel holds several "
        "squares.",
        "",
        "| filter | PSNR all | PSNR far | holes | full / reconstruction / low-pass % | weights |",
        "|---|---|---|---|---|---|",
        "| full EWA (published method, numpy check) | 16.40 | 20.50 | | | |",
        "| adaptive (published method, numpy check) | 16.35 | 20.63 | | 25 / 4 / 71 | |",
    ]
    for name, row in aliasing.items():
        cells = [f"{row['all']:.2f}", f"{row['far']:.2f}", str(row["holes"]), shares(row), f"{row['evaluations']:,}"]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return [
        *lines,
        "",
        "Adaptive, full, reconstruction, low-pass, squares, reference:",
        "",
        "![ground](points-ground.png)",
        "",
    ]


def _compression(c: dict[str, Any]) -> list[str]:
    lines = [
        "## Eight bytes a point (table 3.1)",
        "",
        "| field | bits before | published | stored |",
        "|---|---|---|---|",
        "| position | 96 | 32 | 32 |",
        "| normal | 96 | 16 | 16 |",
        "| tangents | 192 | 4 | 8, with the next |",
        "| Gaussian texture coordinate | 64 | 2 | |",
        "| radius | 32 | 8 | 8 |",
        "| total | 480 | 60 (its rows add to 62) | 64: 7.5 times smaller |",
        "",
        "| normals as | position, of the box | normal mean ° | max ° | radius mean % | max % | picture PSNR |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, row in c["normals"].items():
        lines.append(
            f"| {name} | {row['position_max']:.2e} | {row['normal_mean']:.3f} | {row['normal_max']:.3f} "
            f"| {100 * row['radius_mean']:.2f} | {100 * row['radius_max']:.2f} | {row['psnr']:.1f} |"
        )
    ms = {k: v["median"] for k, v in c["ms"].items()}
    return [
        *lines,
        "",
        f"{c['points']:,} points are {c['nodes']:,} nodes and a file of {c['file_bytes']:,} bytes "
        f"({c['file_bytes'] / c['points']:.1f} a point with tree, headers, checksums and colours). A close-up reads "
        f"{c['close_up_bytes']:,} bytes of nodes ({100 * c['close_up_bytes'] / (8 * c['nodes']):.1f} %). A picture "
        f"takes {ms['in memory']:.1f} ms from plain points in memory, {ms['from file']:.1f} ms from the mapped file.",
        "",
    ]
