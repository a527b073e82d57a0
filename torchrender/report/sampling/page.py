"""The page of the sampling study: tables beside the published numbers, and the resolution plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_line
from torchrender.quality.pages import write_text
from torchrender.report.sampling.published import AVAILABLE, KINDS, TIMES

DEARER = 1.6
"""Times the cost of conventional images that non-redundant ones are to stay below."""
TABLES = {
    "pixel": ("pixel redundancy (table 2 and 3)", "pixel redundancy (table 4)"),
    "visibility": ("visibility redundancy (table 5)", "visibility redundancy (table 6)"),
    "captured": ('pixel redundancy, test "captured" (beyond the thesis)',) * 2,
}
CURVES = (
    ("redundant", "C", "conventional: redundant"),
    ("hidden", "N", "non-redundant: hidden"),
    ("useful", "N", "non-redundant: useful"),
)


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``sampling.md`` and ``sampling-resolution.png`` in ``folder``."""
    effort, scenes = record["effort"], record["scenes"]
    plot_resolution(scenes, folder / "sampling-resolution.png")
    lines = [
        "# Depth-image sampling, measured",
        "",
        *commands(scenes, record["machine"]),
        "Three images from the corners of a triangle that looks at the scene's subject (the box of the middle 90",
        "percent of its triangles along each axis) from its own side. **Bold**: measured here; in brackets: published,",
        "on other scenes of the same size and character, so only directions can be compared. Percent of filled pixels,",
        'V0 / V1 / V2. Test "captured" takes a sample as redundant where an earlier image stores nothing before it: it',
        "finds the repeats of surfaces thinner than a pixel, as visibility redundancy does, without rays.",
        f"Pixel redundancy: {effort['size']}² pixels, every {effort['stride']}th asked along both axes,",
        f"{effort['frames']} views between (test captured: {effort['captured_frames']}).",
        f"Visibility redundancy: {effort['ray_size']}² rays, every second asked,",
        f"{effort['ray_frames']} views between. Standard errors of shares are below one percentage point unless given.",
        "",
    ]
    for redundancy, (kinds, available) in TABLES.items():
        lines += kinds_table(scenes, redundancy, kinds)
        lines += available_table(scenes, redundancy, available)
    lines += [*directions(scenes), *subpixel_table(scenes), *time_table(scenes), *fill_table(scenes)]
    lines += [
        "## Resolution study (figures 13 to 15)",
        "",
        "Dashed: visibility redundancy, which resolution does not enter. Pixel redundancy comes closer as it grows.",
        "",
        "![Metrics against resolution](sampling-resolution.png)",
        "",
        "## What the images hold",
        "",
        "Non-redundant images; grey: a conventional image has the sample, blue: none has, green: and a view between",
        "the viewpoints needs it.",
        "",
        *(f"![{name}](sampling-{name}.png)" for name in scenes),
    ]
    write_text(folder / "sampling.md", lines)


def commands(scenes: dict[str, Any], usual: dict[str, Any]) -> list[str]:
    """What made the page: one command, or one for each scene where they ran on different commits or days."""
    lines: dict[str, list[str]] = {}
    for name, scene in scenes.items():
        lines.setdefault(machine_line(scene.get("machine", usual)), []).append(name)
    return [
        f"`python -m torchrender.report.sampling --scenes {' '.join(names)}` on {where}"
        for where, names in lines.items()
    ]


def subpixel_table(scenes: dict[str, Any]) -> list[str]:
    """Pixel redundancy where triangles are about as small as pixels, as in the thesis's tree."""
    rows = {name: scene["subpixel"] for name, scene in scenes.items() if "subpixel" in scene}
    if not rows:
        return []
    lines = [
        "## Triangles about as small as pixels",
        "",
        "The same viewpoints with smaller pictures: pixel redundancy by test identity then finds few repeats, for two",
        "images seldom hit the same triangle, and neither does a view between: what is available falls for all.",
        "",
        "| scene | pixels | pixels per triangle | conventional: redundant | available: conventional | non-redundant "
        "| peeling |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        table = row["table"]
        cells = [name, f"{row['size']}²", f"{row['median_triangle_pixels']:.1f}", shares(table["C"]["redundant"])]
        cells += ["{:.1f} / {:.1f}".format(table[m]["available"][0], table[m]["least"]) for m in ("C", "N", "P")]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def kinds_table(scenes: dict[str, Any], redundancy: str, number: str) -> list[str]:
    """Redundant, hidden and useful samples."""
    lines = [
        f"## Redundant, hidden and useful samples, {number}",
        "",
        "| scene | conventional: redundant | non-redundant: hidden | useful of hidden "
        "| peeling: hidden | useful of hidden |",
        "|---|---|---|---|---|---|",
    ]
    columns = (
        ("C", "redundant", "C"),
        ("N", "hidden", "N"),
        ("N", "useful", "Nu"),
        ("P", "hidden", "P"),
        ("P", "useful", "Pu"),
    )
    for name, scene in scenes.items():
        measured = scene["tables"][redundancy]
        cells = [
            f"**{shares(measured[method][metric])}**{_kinds_published(redundancy, name, key)}"
            for method, metric, key in columns
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def available_table(scenes: dict[str, Any], redundancy: str, number: str) -> list[str]:
    """Available samples."""
    lines = [
        f"## Available samples, {number}: mean ± standard error / minimum",
        "",
        "| scene | conventional | non-redundant | peeling |",
        "|---|---|---|---|",
    ]
    for name, scene in scenes.items():
        cells = []
        for method in ("C", "N", "P"):
            row = scene["tables"][redundancy][method]
            mean, error = row["available"]
            cells.append(
                f"**{mean:.2f} ± {error:.2f} / {row['least']:.2f}**{_available_published(redundancy, name, method)}"
            )
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _kinds_published(table: str, scene: str, key: str) -> str:
    """The thesis's numbers in brackets, where it has any."""
    return f" ({' / '.join(map(str, KINDS[table][scene][key]))})" if table in KINDS else ""


def _available_published(table: str, scene: str, method: str) -> str:
    return " ({} / {})".format(*AVAILABLE[table][scene][method]) if table in AVAILABLE else ""


def directions(scenes: dict[str, Any]) -> list[str]:
    """The acceptance list of the specification, row by row."""
    lines = ["## Do the published directions hold?", "", "| claim | " + " | ".join(scenes) + " |"]
    lines.append("|---|" + "---|" * len(scenes))
    for redundancy in TABLES:
        rows = [s["tables"][redundancy] for s in scenes.values()]
        mean = [r["N"]["available"][0] > r["C"]["available"][0] for r in rows]
        least = [r["N"]["least"] > r["P"]["least"] for r in rows]
        more = [all(product(r["N"], k) > product(r["P"], k) for k in (1, 2)) for r in rows]
        total = [found(r["N"]) > found(r["P"]) for r in rows]
        hidden = [all(value(r["N"], "hidden", k) > value(r["P"], "hidden", k) for k in (1, 2)) for r in rows]
        for claim, answers in (
            ("mean available: non-redundant > conventional", mean),
            ("least available: non-redundant > peeling", least),
            ("hidden × useful, images 1 and 2: non-redundant > peeling", more),
            ("hidden × useful of all pixels, images 1 and 2 together: non-redundant > peeling", total),
            ("hidden, images 1 and 2: non-redundant > peeling", hidden),
        ):
            lines.append(f"| {redundancy}: {claim} | " + " | ".join("yes" if a else "no" for a in answers) + " |")
    lines += [
        "",
        "Shares of hidden samples favour peeling here: behind the first surface of these scenes little is seen from",
        "any of the viewpoints, whereas non-redundant images also store first hits that image 0 lacks, which are never",
        "hidden. The rows over all pixels compare what the images find in all. Test identity loses a rim around each",
        "triangle: where hidden samples are of little use (city) or hardly more than the rim (grass), it falls behind",
        "conventional images by that; the two other tests do not.",
    ]
    return [*lines, ""]


def value(row: dict[str, Any], metric: str, image: int) -> float:
    """A share in percent; nothing counts as zero."""
    share = row[metric][image][0]
    return 0.0 if share is None else float(share)


def product(row: dict[str, Any], image: int) -> float:
    """Share of the filled pixels that is hidden and useful."""
    return value(row, "hidden", image) * value(row, "useful", image) / 100.0


def found(row: dict[str, Any]) -> float:
    """Hidden and useful samples of images 1 and 2, percent of the pixels of one image."""
    return sum(value(row, "hidden_of_all", k) * value(row, "useful", k) / 100.0 for k in (1, 2))


def time_table(scenes: dict[str, Any]) -> list[str]:
    """Times, and ratios to conventional images."""
    lines = [
        "## Time for three images, pixel redundancy (table 7)",
        "",
        f"Median milliseconds and ratio to conventional, **bold** where non-redundant images cost at most {DEARER:g}",
        "times as much, which is aimed at; published ratios, of a GeForce GTX 570, in brackets.",
        "",
        "| scene | triangles | conventional | non-redundant | ratio | peeling | ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, scene in scenes.items():
        ms, published = scene["ms"], TIMES[name]
        base = ms["C"]["median"]
        cells = [name, f"{scene['triangles']:,}", f"{base:.0f}"]
        for method in ("N", "P"):
            ratio, theirs = ms[method]["median"] / base, published[method] / published["C"]
            text = f"**{ratio:.2f}**" if method == "P" or ratio <= DEARER else f"{ratio:.2f}"
            cells += [f"{ms[method]['median']:.0f}", f"{text} ({theirs:.1f})"]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def fill_table(scenes: dict[str, Any]) -> list[str]:
    """How full the images are."""
    lines = [
        "## Filled pixels, percent of all, and median projected triangle area in image 0",
        "",
        "Below about two pixels, pixel redundancy misses most repeats.",
        "",
        "| scene | conventional | non-redundant | peeling | truncated | pixels per triangle |",
        "|---|---|---|---|---|---|",
    ]
    for name, scene in scenes.items():
        table = scene["tables"]["pixel"]
        cells = [shares(table[m]["filled"]) for m in ("C", "N", "P")]
        cells += [shares(table["N"]["truncated"]), f"{scene['median_triangle_pixels']:.1f}"]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def shares(row: list[tuple[float | None, float]]) -> str:
    """Percent for each image, with the standard error where it is not small."""
    cells = []
    for share, error in row:
        text = "–" if share is None else f"{share:.0f}"
        cells.append(f"{text} ± {error:.1f}" if error >= 1.0 else text)
    return " / ".join(cells)


def plot_resolution(scenes: dict[str, Any], path: Path) -> None:
    """Metrics 1 to 3 against image size, image 2, a panel per scene."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(
        1, len(scenes), figsize=(3.4 * len(scenes), 3.6), layout="constrained", squeeze=False
    )
    for axis, (name, scene) in zip(axes[0], scenes.items(), strict=True):
        study = scene["resolution"]
        sizes = [int(size) for size in study["pixel"]]
        for color, (metric, method, label) in zip(("C3", "C0", "C2"), CURVES, strict=True):
            values = [value(row[method], metric, 2) for row in study["pixel"].values()]
            axis.plot(sizes, values, "o-", color=color, label=label)
            axis.axhline(value(study["visibility"][method], metric, 2), color=color, linestyle="--", linewidth=1)
        axis.set_xscale("log", base=2)
        axis.set_xticks(sizes, [str(size) for size in sizes])
        axis.set(title=name, xlabel="pixels per side", ylim=(0, 100))
        axis.grid(True, alpha=0.2)
    axes[0][0].set_ylabel("percent, image V2")
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    write_atomically(path, lambda p: figure.savefig(p, dpi=100, format="png"))
    pyplot.close(figure)
