"""The page of the foundation report: tables in Markdown and plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_line
from torchrender.quality.pages import write_text
from torchrender.report.foundation.rays_page import rays_section

RAYS_AIM, MEAN_AIM, OPENGL_AIM, CHANGING_AIM = 4.0, 7.0, 1.5, 8.0
"""Ratios aimed at: open3d's rays on each scene and in the mean, software OpenGL, changing geometry with its build."""
PEERS = {"open3d": "open3d rays", "open3d_build": "open3d BVH build", "opengl": "software OpenGL"}


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``foundation.md`` and its plots in ``folder``: the parts that the record holds."""
    lines = ["# The rasteriser, measured", ""]
    lines += [
        "Times are medians in milliseconds (smallest to greatest); the candidates of a row take turns in one run."
    ]
    lines += [""]
    if "gbuffer" in record:
        lines += [measured_by(record, "raster"), "", *gbuffer_table(record), *changing_table(record)]
        lines += [*views_lines(record), *cost_lines(record), *agreement_table(record)]
    if "triangles" in record:
        plot_scaling(record, folder / "foundation-scaling.png")
        lines += scaling_tables(record)
    lines += rays_lines(record)
    if "start" in record:
        lines += start_lines(record)
    write_text(folder / "foundation.md", lines)


def measured_by(record: dict[str, Any], part: str) -> str:
    """The command of a part, and where it ran."""
    machine = record.get("machines", {}).get(part) or record["machine"]
    return f"`python -m torchrender.report.foundation --part {part}` on {machine_line(machine)}"


def gbuffer_table(record: dict[str, Any]) -> list[str]:
    """Times beside the peers, with ratios and what was aimed at."""
    size = record["size"]
    lines = [
        f"## G-buffer at {size}²: depth, triangle id, object id, barycentrics",
        "",
        f"Aimed at: {RAYS_AIM:g}× open3d's rays on every scene, {MEAN_AIM:g}× in the mean, {OPENGL_AIM:g}× software",
        "OpenGL. **Bold**: reached.",
        "",
        "| scene | triangles | torchrender | open3d rays | ratio | software OpenGL | ratio "
        "| first image: torchrender | open3d | ratio |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    ratios = []
    for name, row in record["gbuffer"].items():
        ms = row["ms"]
        own = ms["torchrender"]["median"]
        cells = [name, f"{row['triangles']:,}", span(ms["torchrender"])]
        cast, drawn, fresh = ms.get("open3d"), ms.get("opengl"), ms["torchrender_fresh"]
        whole = None if cast is None else cast["median"] + ms["open3d_build"]["median"]
        ratios += [] if cast is None else [cast["median"] / own]
        cells += [span(cast), ratio(cast and cast["median"], own, RAYS_AIM)]
        cells += [span(drawn), ratio(drawn and drawn["median"], own, OPENGL_AIM)]
        cells += [span(fresh), number(whole), ratio(whole, fresh["median"])]
        lines.append("| " + " | ".join(cells) + " |")
    mean = sum(ratios) / len(ratios) if ratios else None
    lines += ["", f"Mean beside open3d: {ratio(mean, 1.0, MEAN_AIM)}."]
    notes = {f"{PEERS[k]}: {v}" for row in record["gbuffer"].values() for k, v in row["notes"].items()}
    lines += ["open3d casts the primary rays of the same camera; software OpenGL draws ids and depth and reads both"]
    lines += ["back, without object ids and barycentrics. " + "; ".join(sorted(notes)) + "."]
    return [*lines, ""]


def changing_table(record: dict[str, Any]) -> list[str]:
    """Geometry whose every vertex moves before each picture."""
    rows = record.get("changing", [])
    if not rows:
        return []
    lines = [
        "## Geometry that changes every picture (city)",
        "",
        "Every vertex moves: clusters are refitted and a picture drawn, beside open3d's build and rays.",
        f"Aimed at: {CHANGING_AIM:g}× with a million triangles. **Bold**: reached.",
        "",
        "| triangles | torchrender | open3d build | open3d rays | ratio |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        ms = row["ms"]
        cast, build = ms.get("open3d"), ms.get("open3d_build")
        whole = None if cast is None else cast["median"] + build["median"]
        cells = [f"{row['triangles']:,}", span(ms["torchrender"]), span(build), span(cast)]
        lines.append("| " + " | ".join([*cells, ratio(whole, ms["torchrender"]["median"], CHANGING_AIM)]) + " |")
    return [*lines, ""]


def views_lines(record: dict[str, Any]) -> list[str]:
    """Many small pictures of one call."""
    rows = record.get("views", [])
    if not rows:
        return []
    count, side = rows[0]["count"], rows[0]["side"]
    lines = [
        f"## {count} cameras at {side}² in one call",
        "",
        "Aimed at: 700 pictures a second of depth, 300 of depth, normals and ids, in at most 600 MB that the call",
        "adds.",
        "",
        "| scene | depth, pictures/s | depth, normals, ids | MB at most |",
        "|---|---|---|---|",
    ]
    for row in rows:
        rate = row["per_second"]
        lines.append(
            f"| {row['scene']} | {rate['depth']:.0f} | {rate['outputs']:.0f} | {number(row.get('added_mb'))} |"
        )
    return [*lines, ""]


def cost_lines(record: dict[str, Any]) -> list[str]:
    """How far from the limit, and where the time goes."""
    floor = record["floor_ms"]
    lines = [
        "## How far from the limit",
        "",
        f"Writing the buffers once ({floor['mib']:.0f} MiB, already mapped) takes {floor['median']:.1f} ms. Memory:",
        "vertices and faces read once and the buffers written once, at the speed of copying. Triangles: a picture of",
        "16², so culling, transforming and setting up what is in view; pixels: the rest, tiles, edge functions, depth",
        "and barycentrics.",
        "",
        "| scene | ms | memory | times memory | triangles | ns per triangle | pixels | ns per pixel |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in record["gbuffer"].items():
        if (cost := row.get("cost")) is None:
            continue
        own = row["ms"]["torchrender"]["median"]
        rest = max(own - cost["triangles"], 0.0)
        few, pixels = cost["triangles"], record["size"] ** 2
        lines.append(
            f"| {name} | {own:.1f} | {cost['memory']:.1f} | {own / cost['memory']:.1f}× | {few:.1f} "
            f"| {1e6 * few / row['triangles']:.0f} | {rest:.1f} | {1e6 * rest / pixels:.1f} |"
        )
    return [*lines, ""]


def agreement_table(record: dict[str, Any]) -> list[str]:
    """Ids and depths against the ray caster."""
    lines = [
        "## Agreement with Embree rays",
        "",
        "Away from edges: every barycentric weight above 0.01.",
        "",
        "| scene | pixels | same triangle | same, edges included | same coverage | largest relative depth error |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in record["gbuffer"].items():
        a = row["agreement"]
        lines.append(
            f"| {name} | {a['pixels']:,} | {100 * a['same_id']:.4f} % | {100 * a['same_id_with_edges']:.3f} % "
            f"| {100 * a['same_coverage']:.4f} % | {a['depth_error_max']:.1e} |"
        )
    return [*lines, ""]


def scaling_tables(record: dict[str, Any]) -> list[str]:
    """Triangles, pixels and share in view."""
    lines = ["## Cost against triangles, pixels and what is in view", "", measured_by(record, "scaling"), ""]
    lines += ["![plots](foundation-scaling.png)", ""]
    lines += ["| triangles (grass) | ms | ns per triangle |", "|---|---|---|"]
    for row in record["triangles"]:
        lines.append(f"| {row['triangles']:,} | {span(row)} | {1e6 * row['median'] / row['triangles']:.0f} |")
    lines += ["", "| image (living room) | ms | ns per pixel |", "|---|---|---|"]
    for row in record["pixels"]:
        lines.append(f"| {row['side']}² | {span(row)} | {1e6 * row['median'] / row['side'] ** 2:.1f} |")
    lines += ["", "| lens (city, 1 M) | share of the clusters in view | ms |", "|---|---|---|"]
    for row in record["in_view"]:
        lines.append(f"| {row['zoom']:.0f}× | {100 * row['share_in_view']:.1f} % | {span(row)} |")
    return [*lines, ""]


def rays_lines(record: dict[str, Any]) -> list[str]:
    """The section on rays, and where it was measured if that was another run."""
    rays = record.get("rays")
    if not rays:
        return []
    lines = rays_section(rays["rows"])
    if lines:
        where = machine_line(rays["machine"])
        lines[2:2] = [f"`python -m torchrender.report.foundation --part rays` on {where}", ""]
    return lines


def start_lines(record: dict[str, Any]) -> list[str]:
    """A whole process from start to picture."""
    start = record["start"]
    lines = [
        "## Start",
        "",
        measured_by(record, "start"),
        "",
        "`torchrender render cornell_box` as a fresh process, 1024 × 768, interpreter start included:",
    ]
    lines += [f"{start['cached']:.1f} s with compiled kernels cached"]
    if "very_first" in start:
        lines[-1] += f", {start['very_first']:.1f} s the very first time, when everything is compiled"
    lines[-1] += "."
    return [*lines, ""]


def plot_scaling(record: dict[str, Any], path: Path) -> None:
    """Three plots side by side, logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    panels = (
        ("triangles", [r["triangles"] for r in record["triangles"]], record["triangles"], "triangles (grass)"),
        ("pixels", [r["side"] ** 2 for r in record["pixels"]], record["pixels"], "pixels (living room)"),
        (
            "view",
            [100 * r["share_in_view"] for r in record["in_view"]],
            record["in_view"],
            "% of 1 M triangles in view",
        ),
    )
    for axis, (_, x, rows, label) in zip(axes, panels, strict=True):
        y = [r["median"] for r in rows]
        axis.loglog(x, y, "o-", label="measured")
        axis.loglog(
            x, [y[-1] * v / x[-1] for v in x] if x[-1] > x[0] else [y[0] * v / x[0] for v in x], ":", label="linear"
        )
        axis.set(xlabel=label, ylabel="ms")
        axis.grid(True, which="both", alpha=0.2)
        axis.legend()
    write_atomically(path, lambda p: figure.savefig(p, dpi=100, format="png"))
    pyplot.close(figure)


def span(timing: dict[str, float] | None) -> str:
    """Median with smallest and greatest."""
    return "–" if timing is None else f"{timing['median']:.1f} ({timing['least']:.1f}–{timing['greatest']:.1f})"


def number(value: float | None) -> str:
    """One decimal, or a dash."""
    return "–" if value is None else f"{value:.0f}"


def ratio(other: float | None, own: float, aim: float | None = None) -> str:
    """How many times slower the other is; bold where that is at least what was aimed at."""
    if other is None:
        return "–"
    text = f"{other / own:.1f}×"
    return f"**{text}**" if aim is not None and other / own >= aim else text
