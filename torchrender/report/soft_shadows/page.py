"""The page of the soft-shadow study: tables beside the published numbers, and plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table, write_text

PUBLISHED = {  # scene, size: mean E_int and E_vis of non-redundant, conventional and peeled images
    ("nest", 512): ((4.73, 8.65, 4.83), (9.57, 11.3, 10.2)),
    ("nest", 1024): ((3.00, 5.62, 3.58), (6.31, 7.72, 7.40)),
    ("nest", 1536): ((2.56, 4.45, 3.20), (5.04, 6.23, 5.95)),
    ("grass", 512): ((3.20, 7.98, 4.57), (7.21, 9.62, 8.34)),
    ("grass", 1024): ((1.71, 5.15, 2.55), (3.70, 6.12, 4.41)),
    ("grass", 1536): ((1.26, 4.24, 1.84), (2.55, 4.94, 3.02)),
    ("city", 512): ((3.54, 7.40, 15.8), (4.74, 7.80, 18.5)),
    ("city", 1024): ((1.60, 3.46, 11.3), (2.07, 3.64, 12.6)),
    ("city", 1536): ((1.10, 2.28, 9.97), (1.36, 2.39, 10.7)),
    ("tree", 512): ((11.2, 16.2, 11.4), (25.2, 28.3, 25.9)),
    ("tree", 1024): ((9.21, 13.7, 10.9), (17.5, 21.1, 18.7)),
    ("tree", 1536): ((8.90, 13.3, 10.8), (14.1, 18.4, 16.0)),
}
PUBLISHED_LIGHT = {  # mean E_int at light ratios 1/4, 1/2, 1, 2, 4: non-redundant (lost at 2), conventional, peeled
    "nest": ((3.22, 6.42, 2.90), (3.23, 6.25, 3.15), (3.00, 5.62, 3.58), (None, 4.94, 5.70), (2.67, 4.13, 11.20)),
    "grass": ((1.53, 3.57, 2.53), (1.62, 4.24, 2.54), (1.71, 5.15, 2.55), (None, 5.55, 2.79), (2.83, 5.95, 3.59)),
    "city": ((2.38, 4.94, 3.95), (2.06, 3.81, 5.98), (1.60, 3.46, 11.36), (None, 2.67, 19.91), (1.95, 6.77, 29.64)),
    "tree": ((5.87, 12.37, 7.31), (6.50, 13.02, 8.81), (9.21, 13.76, 10.99), (None, 16.68, 15.17),
             (24.20, 23.29, 23.32)),
}  # fmt: skip
RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0)


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``soft-shadows.md`` and its plots in ``folder``."""
    _plot(record, folder / "soft-shadows-cost.png")
    study = record["study"]
    lines = [
        "# Soft shadows, measured",
        "",
        f"`python -m torchrender.report.soft_shadows` on {machine_line(record['machine'])}",
        "",
        f"{study['light_samples']}² light samples; images of {study['size']}² pixels unless said otherwise. Errors are",
        f"means over covered pixels of {study['picture']}² pictures, scale 0 to 255, against the original triangles by",
        "the same procedure (A) and by rays (B).",
        "Light, light cameras and picture go by the subject's box, which leaves out the outermost 5 percent of the",
        "triangles at either end of each axis: as large as the light at ratio 1, which hangs 0.75 diagonals above it.",
        "",
        *_resolution(record["errors"]["resolution"]),
        *_light(record["errors"]["light"], study["size"]),
        *_literal(record["errors"]["literal"]),
        *_meshes(record["errors"]["mesh"]),
        *_pictures(record),
        *_times(record),
        *_penumbrae(record),
        *_penumbra(record),
    ]
    write_text(folder / "soft-shadows.md", lines)


def _cells(row: dict[str, Any], reference: str, error: str) -> str:
    return " / ".join(f"{cell[reference][error]:.2f}" for cell in row.values())


def _maxima(row: dict[str, Any]) -> str:
    return " / ".join(f"{cell['A']['int_max']:.0f}" for cell in row.values())


def _resolution(found: dict[str, Any]) -> list[str]:
    lines = [
        "## By resolution of the images (tables 8 and 9)",
        "",
        "Non-redundant / conventional / peeled. Published scenes share the name, not the triangles.",
        "",
        "| scene, size | intensity A | published | visibility A | published | largest intensity A | intensity B |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, sizes in found.items():
        for size, row in sizes.items():
            known = PUBLISHED.get((name, int(size)))
            said = ["–", "–"] if known is None else [" / ".join(f"{v:g}" for v in values) for values in known]
            cells = [_cells(row, "A", "int"), said[0], _cells(row, "A", "vis"), said[1], _maxima(row)]
            lines.append(f"| {name} {size}² | " + " | ".join([*cells, _cells(row, "B", "int")]) + " |")
    return [*lines, ""]


def _light(found: dict[str, Any], size: int) -> list[str]:
    lines = [
        "## By size of the light (table 10)",
        "",
        f"Images of {size}² pixels; the published ones had 1024².",
        "",
        "| scene, light / scene | intensity A | published | visibility A |",
        "|---|---|---|---|",
    ]
    for name, ratios in found.items():
        for ratio, row in ratios.items():
            said = "–"
            if name in PUBLISHED_LIGHT and float(ratio) in RATIOS:
                values = PUBLISHED_LIGHT[name][RATIOS.index(float(ratio))]
                said = " / ".join("lost" if v is None else f"{v:g}" for v in values)
            lines.append(f"| {name} {ratio} | {_cells(row, 'A', 'int')} | {said} | {_cells(row, 'A', 'vis')} |")
    return [*lines, ""]


def _meshes(found: dict[str, Any]) -> list[str]:
    lines = [
        "## By mesh",
        "",
        "Non-redundant / conventional / peeled. *Triangles* are the scene's own that the images show; the others are",
        "rebuilt from the samples, *grid* and *splat* of non-redundant images alone. The tables above use *hybrid*,",
        "as published.",
        "",
        "| scene, mesh | intensity A | visibility A | triangles |",
        "|---|---|---|---|",
    ]
    for name, meshes in found.items():
        for mesh, row in meshes.items():
            counts = " / ".join(f"{cell['triangles']:,}" for cell in row.values())
            lines.append(f"| {name}, {mesh} | {_cells(row, 'A', 'int')} | {_cells(row, 'A', 'vis')} | {counts} |")
    return [*lines, ""]


def _literal(found: dict[str, Any]) -> list[str]:
    lines = [
        "## Algorithms 3 and 4 to the letter",
        "",
        "The identity test, guessed corners within a ratio of 1.1, no merging and a fixed split; then each of our",
        "changes alone for non-redundant images, and all of them. Non-redundant / conventional / peeled.",
        "",
        "| scene, how | intensity A | visibility A | intensity B |",
        "|---|---|---|---|",
    ]
    for name, rows in found.items():
        for label, row in rows.items():
            cells = " | ".join(_cells(row, *which) for which in (("A", "int"), ("A", "vis"), ("B", "int")))
            lines.append(f"| {name}, {label} | {cells} |")
    return [*lines, ""]


def _pictures(record: dict[str, Any]) -> list[str]:
    lines = ["Reference, approximation, and their difference (green too bright, red too dark; full at 64 of 255):", ""]
    return [*lines, *(f"![{name}](soft-shadows-{name}.png)" for name in record["study"]["scenes"]), ""]


def _times(record: dict[str, Any]) -> list[str]:
    study = record["study"]
    side = study["timed_picture"]
    lines = [
        f"## Time against scene size, {side}² pixels (table 11, figure 20)",
        "",
        "Seconds, one run each, nothing kept between them. Steps: images and meshes + tree + visibility.",
        "Single rays (tree + tracing): one ray from every pixel to every light sample, traced for an even choice of",
        f"{study['ray_pixels']:,} pixels and scaled to all of them, by the ray caster and by plain Embree",
        "through its C interface.",
        "",
        "| scene, triangles | four images, triangles | four images, hybrid | full scene | ray caster | Embree alone "
        "| Embree / full scene | Embree / triangles | Embree / hybrid |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    least: dict[str, int] = {}
    for name, counts in record["times"].items():
        for row in counts.values():
            rays = row["single rays"]
            caster, embree = rays["build"] + rays["trace"], rays.get("embree build", 0.0) + rays.get("embree trace", 0)
            ratios = [
                f"{embree / row[label]['total']:.1f}" if embree else "–"
                for label in ("full scene", "triangles", "hybrid")
            ]
            cells = [_steps(row[label]) for label in ("triangles", "hybrid", "full scene")]
            cells += [f"{caster:.1f}", f"{embree:.1f}" if embree else "–", *ratios]
            lines.append(f"| {name} {row['count']:,} | " + " | ".join(cells) + " |")
            if row["triangles"]["total"] < row["full scene"]["total"]:
                least.setdefault(name, row["count"])
    said = [f"{name}: " + (f"from {least[name]:,} triangles on" if name in least else "at none of these sizes")
            for name in record["times"]]  # fmt: skip
    return [*lines, "", f"Where the approximation beats the full scene: {'; '.join(said)}.", ""]


def _steps(row: dict[str, float]) -> str:
    return f"{row['images']:.2f} + {row['tree']:.2f} + {row['visibility']:.2f} = {row['total']:.2f}"


def _penumbrae(record: dict[str, Any]) -> list[str]:
    study = record["study"]
    rows = []
    for row in record["penumbrae"]:
        error = f"{row['error']:.2f}"
        cells = [row["scene"].replace("_", " "), row["way"], f"**{error}**" if row["error"] <= 1.0 else error]
        rows.append([*cells, f"{row['p99']:.1f}", f"{row['ms']:.0f}", f"{100 * row['share']:.1f} %"])
    head = ["", "way", "mean error", "99th percentile", "ms", "penumbra pixels"]
    return [
        "## Penumbrae against 4,096 rays",
        "",
        f"Visibility, 0 to 255, over penumbra pixels alone ({study['penumbra_pixels']} of them, evenly chosen), of the",
        f"scene's own area light at {study['penumbra_picture']}², against 64 × 64 rays to it from each. At most 1 is",
        "aimed at. *pcss* guesses penumbrae from one map; the others ask as many samples of the light.",
        "",
        *table(head, rows),
    ]


def _penumbra(record: dict[str, Any]) -> list[str]:
    lines = ["## Cost follows the penumbra", "", "A grille over a floor under lights of growing size.", ""]
    lines += ["| light side | penumbra pixels | skipping, ms | tracing all, ms |", "|---|---|---|---|"]
    for row in record["penumbra"]:
        cells = f"{100 * row['share']:.1f} % | {1e3 * row['skipping']:.0f} | {1e3 * row['tracing all']:.0f}"
        lines.append(f"| {row['side']} | {cells} |")
    lines += [
        "",
        "What refining alone where samples disagree changes (default settings, full scene), mean error of 255:",
        "",
    ]
    lines += [f"- {name}: {error:.3f}" for name, error in record["skipping"].items()]
    return [*lines, "", "![time over penumbra share](soft-shadows-cost.png)"]


def _plot(record: dict[str, Any], path: Path) -> None:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    rows = sorted(record["penumbra"], key=lambda row: row["share"])
    for label in ("skipping", "tracing all"):
        left.plot([100 * r["share"] for r in rows], [1e3 * r[label] for r in rows], "o-", label=label)
    left.set(xlabel="penumbra pixels (%)", ylabel="ms", ylim=(0, None), title="grille over a floor")
    left.legend()
    for name, style in zip(record["times"], ("-", "--", ":")):
        times = list(record["times"][name].values())
        counts = [r["count"] for r in times]
        for color, label in zip(("C0", "C1", "C2"), ("triangles", "hybrid", "full scene")):
            right.loglog(counts, [r[label]["total"] for r in times], "o" + style, color=color, label=f"{name}: {label}")
        caster = [r["single rays"]["build"] + r["single rays"]["trace"] for r in times]
        right.loglog(counts, caster, "o" + style, color="C3", label=f"{name}: ray caster")
    right.set(xlabel="triangles", ylabel="s", title="time against scene size")
    right.legend(fontsize=7)
    write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=110))
