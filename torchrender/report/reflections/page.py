"""The page of the reflection study: tables beside the published numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table, write_text
from torchrender.report.reflections.race import EMBREE, FLOOR, OWN

PARTS = ("shadow maps", "cube map")
"""What a changed scene makes every way pay for beside its own time."""

FLIP_GOAL = 0.03
NAMES = {"living_room": "living room", "washroom": "washroom"}
PUBLISHED_STEPS = {  # table 14, mean ms of the first path: pass 1 and clusters, cameras, depth images, marching
    "living_room": (0.6, 23, 26, 7),
    "washroom": (0.5, 20, 28, 11),
}
PUBLISHED_PATHS = {  # tables 13, 19 and 21, mean (max): reflective %, clusters, planar %; occlusion error % in text
    "living_room": ("50 (62)", "123 (194)", "41 (52)", "0.62 (1.3)"),
    "washroom": ("45 (55)", "148 (195)", "17 (33)", "2.75 (3.5)"),
}
PUBLISHED_GLOSS = ((112, 1.0, 6.0), (651, 0.4, 1.4), (163, 1.0, 5.0), (814, 0.4, 1.1))  # march ms, fps traced, clusters


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``reflections.md`` in ``folder``."""
    study = record["study"]
    lines = [
        "# Reflections from clustered depth images, measured",
        "",
        f"`python -m torchrender.report.reflections` on {machine_line(record['machine'])}",
        "",
        f"Pictures of {study['size']}² pixels, one sample each, where not said otherwise. Every time is that of the "
        "reflections alone, of a scene that changes with every picture: rays pay for their tree; rows that say "
        "*everything paid* also hold shadow maps and cube map. All ways shade what they find by the same code, with "
        f"textures and shadows. Times are the best of {study['runs']} runs (two of large pictures and scenes); "
        "candidates take turns.",
        "",
        "![Clustered, traced, 50 times their difference](reflections.jpg)",
        "",
        *_quality(record["quality"]),
        *_curved(record["quality"]),
        *metal_section(record["metal"]),
        *_times(record["times"]),
        *_growth(record),
        *_sweeps(record),
        *_choices(record["choices"], study["sweep_size"]),
        *_paths(record["paths"], study["sweep_size"]),
        *_gloss(record["gloss"], study["gloss_size"]),
        *_share(record["share"]),
    ]
    write_text(folder / "reflections.md", lines)


def _percent(value: float) -> str:
    return f"{100 * value:.2f} %"


def _quality(quality: dict[str, Any]) -> list[str]:
    rows = []
    for name, row in quality.items():
        for way in ("clustered", "hybrid", "environment"):
            channels = " / ".join(f"{c:.2f}" for c in row[way]["channels"])
            facts = [str(row["clusters"]), _percent(row["planar"]), _percent(row["occlusion"])]
            shown = facts if way == "clustered" else ["", "", ""]
            rows.append([f"{NAMES.get(name, name)}, {way}", channels, f"{row[way]['psnr']:.1f} dB", *shown])
    return [
        "## Against rays",
        "",
        "Mean absolute error per channel over reflective pixels, scale 255 (published: at most 9), and PSNR of the "
        "whole picture. The occlusion error is the share of reflective pixels whose true hit is not in their depth "
        "image (published means: 0.62 % and 2.75 %). *Hybrid* sends the rays that no depth image answers to the ray "
        "caster.",
        "",
        *table(["", "error R / G / B", "PSNR", "clusters", "planar pixels", "occlusion error"], rows),
    ]


def _curved(quality: dict[str, Any]) -> list[str]:
    rows = []
    for name, row in quality.items():
        for part, label in (("curved", "curved"), ("plane", "plane")):
            found = row[part]
            errors = [f"{found[way]:.2f}" for way in ("clustered", "hybrid", "as published", "environment")]
            rows.append([f"{NAMES.get(name, name)}, {label}", *errors, _percent(found["occlusion"])])
    return [
        "## Curved and plane mirrors apart",
        "",
        "Mean absolute error of the mirrored light itself, 0 to 255, over samples, against rays over two mirrors. At "
        "most 4 is aimed at for curved ones, with an occlusion error of at most 4 %. *Hybrid* draws curved clusters "
        "only where that is quicker than rays; *as published* is the literal algorithm.",
        "",
        *table(["", "clustered", "hybrid", "as published", "environment", "occlusion error"], rows),
    ]


def metal_section(rows: list[dict[str, Any]]) -> list[str]:
    """Closed metal objects."""
    ways = ("auto", "traced", "hybrid", "clustered", "environment")
    cells = []
    for row in rows:
        errors = [f"**{row[way]:.4f}**" if row[way] <= FLIP_GOAL else f"{row[way]:.4f}" for way in ways]
        cells.append([f"{row['object']}, {row['finish']}", f"{row['triangles']:,}", *errors])
    return [
        "## Closed metal objects",
        "",
        "On a floor under a sky: mean FLIP over the pixels that mirror, against 64 rays a rough pixel and eight "
        f"mirrors in each other; at most {FLIP_GOAL:g} is aimed at. *Auto* is what is taken when nobody says; it and "
        "*traced* send four rays from a rough pixel and follow two mirrors.",
        "",
        *table(["object", "triangles", *ways], cells),
    ]


def _times(times: dict[str, Any]) -> list[str]:
    names = list(next(iter(times.values()))["candidates"])
    rows = []
    for name, room in times.items():
        found = {n: room["candidates"][n]["least"] for n in names}
        extra = room["preparations"]
        for label, beside in (("", 0.0), (", everything paid", sum(extra.values()))):
            whole = {n: ms + beside for n, ms in found.items()}
            row = [f"{NAMES.get(name, name)}{label}", *(f"{whole[n]:.0f}" for n in names)]
            row += [f"{extra[part]:.0f}" for part in PARTS]
            quickest = min(whole[way] for way in OWN)
            plain = whole.get(EMBREE)
            rows.append([*row, "–" if plain is None else f"{plain / quickest:.2f} ×"])
    steps = []
    for name, room in times.items():
        made = room["clustered"]
        first = made["clusters"], made["cameras"], made["depth images"], made.get("marching", 0.0), made["shading"]
        published = " / ".join(str(x) for x in PUBLISHED_STEPS.get(name, ()))
        rays = " / ".join(f"{room['traced'][k]:.0f}" for k in ("tree", "rays"))
        steps.append([NAMES.get(name, name), *(f"{x:.0f}" for x in first), published, rays])
    return [
        "## Time",
        "",
        "Milliseconds. *Traced* is this project's ray caster, which settles every hit in float64; *plain Embree* is "
        "float32 Embree with nothing around it, shaded by the same code; all are one mirror deep here, as it is "
        "(published: 15 frames a second against 1.1 for ray tracing). A changed scene makes every way pay for shadow "
        "maps, which light the hits, and for the cube map, which stands in where light is not followed any further: "
        "*everything paid* holds both, once a picture. The last column sets plain Embree against the quickest of "
        "clustered, hybrid and traced. *Shading alone* is what every way pays once hits are known: rays cost so little "
        "beside it that depth images of clusters cannot win, and nobody's choice takes them.",
        "",
        *table(["", *names, *PARTS, "Embree / quickest"], rows),
        "Steps (table 14). Shading the hits is the same work for every way, and bounds the ratio.",
        "",
        *table(
            ["", "clusters", "cameras", "depth images", "marching", "shading", "published", "rays: tree / casting"],
            steps,
        ),
    ]


def _growth(record: dict[str, Any]) -> list[str]:
    out = []
    for key, label, title in (
        ("triangles", "triangles", "## Triangles (table 18; published: 63 k to 289 k, 15 to 10 frames a second)"),
        ("output", "pixels a side", "## Picture size (table 16; published: 29, 23, 15, 7.5 fps at 256² to 2048²)"),
    ):
        rows = []
        for row in record[key]:
            first = f"{row['triangles']:,}" if key == "triangles" else str(row["size"])
            plain = row.get("plain Embree")
            cells = [first, f"{row['pixels']:,}", *(f"{row[w]:.0f}" for w in (*OWN, FLOOR))]
            quickest, beside = min(row[w] for w in OWN), sum(row["preparations"].values())
            cells.append("–" if plain is None else f"{plain:.0f}")
            cells += [f"{row['preparations'][part]:.0f}" for part in PARTS]
            cells.append("–" if plain is None else f"{plain / quickest:.2f} ×")
            cells.append("–" if plain is None else f"{(plain + beside) / (quickest + beside):.2f} ×")
            rows.append([*cells, f"{row['picked']}, {row[row['picked']] / quickest:.2f} ×"])
        head = [label, "reflective pixels", *(f"{way} ms" for way in (*OWN, FLOOR, EMBREE)), *PARTS]
        text = (
            "Living room, one mirror deep. *Shading alone* is the floor of every way, plain "
            "Embree included: the hits are known. *The planner's* is what nobody's choice takes, and its time over the "
            "quickest; it may be a quarter slower where it is more accurate. *Everything paid*: with the shadow maps "
            "and the cube map of a changed scene on both sides."
        )
        ratios = ["Embree / quickest", "everything paid", "the planner's"]
        out += [title, "", text, "", *table([*head, *ratios], rows)]
    return out


def _row(label: str, row: dict[str, Any]) -> list[str]:
    return [label, str(row["clusters"]), f"{row['ms']:.0f}", _percent(row["occlusion"]), f"{row['psnr']:.1f} dB"]


def _sweeps(record: dict[str, Any]) -> list[str]:
    head = ["clusters", "ms", "occlusion error", "PSNR"]
    return [
        "## Number of clusters (table 15; published: 156 to 32 clusters, 12 to 20 frames a second)",
        "",
        f"Living room at {record['study']['sweep_size']}², bins scaled by m; one run each. More clusters cost more and "
        "miss less.",
        "",
        *table(["factor m on bins", *head], [_row(str(r["bin_factor"]), r) for r in record["clusters"]]),
        "## Size of the depth images (table 17; published: 15, 15, 14 frames a second)",
        "",
        f"Living room at {record['study']['sweep_size']}²; one run each.",
        "",
        *table(["scale per side", *head], [_row(str(r["scale"]), r) for r in record["scale"]]),
    ]


def _choices(choices: dict[str, Any], size: int) -> list[str]:
    out = ["## What each step beyond the thesis brings", "", f"At {size}²; one run each.", ""]
    for name, ways in choices.items():
        head = [NAMES.get(name, name), "clusters", "ms", "occlusion error", "PSNR"]
        out += table(head, [_row(label, row) for label, row in ways.items()])
    return out


def _paths(paths: dict[str, Any], size: int) -> list[str]:
    rows = []
    for name, row in paths.items():
        own = [f"{100 * row[k]['mean']:.1f} ({100 * row[k]['max']:.1f})" for k in ("reflective", "planar", "occlusion")]
        clusters = f"{row['clusters']['mean']:.0f} ({row['clusters']['max']:.0f})"
        time = f"{row['ms']['mean']:.0f} ({row['ms']['max']:.0f})"
        rows.append([NAMES.get(name, name), own[0], clusters, own[1], own[2], time])
        published = PUBLISHED_PATHS[name]
        rows.append(["published", published[0], published[1], published[2], published[3], ""])
    head = ["mean (max)", "reflective %", "clusters", "planar %", "occlusion error %", "ms"]
    return ["## Along a path (tables 13, 19 and 21)", "", f"At {size}².", "", *table(head, rows)]


def _gloss(gloss: list[dict[str, Any]], size: int) -> list[str]:
    rows = []
    for row, (march, traced, clustered) in zip(gloss, PUBLISHED_GLOSS, strict=True):
        published = f"{march} ms; {traced} and {clustered} fps"
        cells = [f"{row['gloss']}, {row['rays']} rays", f"{row['marching']:.0f}", f"{row['clustered']:.0f}"]
        rows.append([*cells, f"{row['traced']:.0f}", f"{row['psnr']:.1f} dB", published])
    return [
        "## Gloss (table 20)",
        "",
        f"Every reflector of the living room with the same gloss, at {size}², against the same rays by the caster.",
        "",
        *table(["gloss", "marching ms", "clustered ms", "traced ms", "PSNR", "published march; fps"], rows),
    ]


def _share(share: list[dict[str, Any]]) -> list[str]:
    rows = [[f"{row['pixels']:,}", f"{row['ms']:.1f}"] for row in share]
    return [
        "## Cost follows the reflective pixels in view",
        "",
        "The last room; a part of its reflective pixels, from the left border on.",
        "",
        *table(["reflective pixels", "clustered ms"], rows),
    ]
