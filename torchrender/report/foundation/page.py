"""The page of the foundation report: tables in Markdown and plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_line
from torchrender.quality.pages import write_text
from torchrender.report.foundation.rays_page import rays_section

PEERS = {"open3d": "open3d rays", "open3d_build": "open3d BVH build", "opengl": "software OpenGL"}


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``foundation.md`` and its plots in ``folder``."""
    plot_scaling(record, folder / "foundation-scaling.png")
    lines = [
        "# The rasteriser, measured",
        "",
        f"`python -m torchrender.report.foundation` on {machine_line(record['machine'])}",
        "Times are medians in milliseconds (smallest to greatest); the candidates of a row take turns in one run.",
        "",
        *gbuffer_table(record),
        *views_lines(record),
        *floor_lines(record),
        *agreement_table(record),
        *scaling_tables(record),
        *rays_lines(record),
        *start_lines(record),
    ]
    write_text(folder / "foundation.md", lines)


def gbuffer_table(record: dict[str, Any]) -> list[str]:
    """Times beside the peers, with ratios."""
    size = record["size"]
    rows = {**record["gbuffer"], f"city, {record['million']['triangles']:,} triangles": record["million"]}
    lines = [
        f"## G-buffer at {size}²: depth, triangle id, object id, barycentrics",
        "",
        "| scene | triangles | torchrender | open3d rays | ratio | software OpenGL | ratio "
        "| first image: torchrender | open3d | ratio |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        ms = row["ms"]
        own = ms["torchrender"]["median"]
        cells = [name, f"{row['triangles']:,}", span(ms["torchrender"])]
        cast, drawn, fresh = ms.get("open3d"), ms.get("opengl"), ms["torchrender_fresh"]
        whole = None if cast is None else cast["median"] + ms["open3d_build"]["median"]
        cells += [span(cast), ratio(cast and cast["median"], own)]
        cells += [span(drawn), ratio(drawn and drawn["median"], own)]
        cells += [span(fresh), number(whole), ratio(whole, fresh["median"])]
        lines.append("| " + " | ".join(cells) + " |")
    notes = {f"{PEERS[k]}: {v}" for row in rows.values() for k, v in row["notes"].items()}
    lines += [
        "",
        "open3d casts the primary rays of the same camera; software OpenGL draws ids and depth and reads both",
    ]
    lines += ["back, without object ids and barycentrics. " + "; ".join(sorted(notes)) + "."]
    return [*lines, ""]


def views_lines(record: dict[str, Any]) -> list[str]:
    """Many small pictures of one call."""
    rows = record.get("views", [])
    if not rows:
        return []
    count, side = rows[0]["count"], rows[0]["side"]
    lines = [f"## {count} cameras at {side}² in one call", "", "| scene | depth, pictures/s | depth, normals, ids |"]
    lines += ["|---|---|---|"]
    for row in rows:
        rate = row["per_second"]
        lines.append(f"| {row['scene']} | {rate['depth']:.0f} | {rate['outputs']:.0f} |")
    return [*lines, ""]


def floor_lines(record: dict[str, Any]) -> list[str]:
    """How far from the limit."""
    floor = record["floor_ms"]
    own = {name: row["ms"]["torchrender"]["median"] for name, row in record["gbuffer"].items()}
    times = ", ".join(f"{name} {t / floor['median']:.1f}×" for name, t in own.items())
    return [
        "## How far from the limit",
        "",
        f"Writing the buffers once ({floor['mib']:.0f} MiB, already mapped) takes {floor['median']:.1f} ms: the",
        f"memory-bandwidth floor. The rasteriser takes {times} that long.",
        "",
    ]


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
    for name, row in {**record["gbuffer"], "large city": record["million"]}.items():
        a = row["agreement"]
        lines.append(
            f"| {name} | {a['pixels']:,} | {100 * a['same_id']:.4f} % | {100 * a['same_id_with_edges']:.3f} % "
            f"| {100 * a['same_coverage']:.4f} % | {a['depth_error_max']:.1e} |"
        )
    return [*lines, ""]


def scaling_tables(record: dict[str, Any]) -> list[str]:
    """Triangles, pixels and share in view."""
    lines = ["## Cost against triangles, pixels and what is in view", "", "![plots](foundation-scaling.png)", ""]
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
    if lines and rays["machine"] != record["machine"]:
        lines[2:2] = [
            f"Measured apart: `python -m torchrender.report.foundation --rays` on {machine_line(rays['machine'])}",
            "",
        ]
    return lines


def start_lines(record: dict[str, Any]) -> list[str]:
    """A whole process from start to picture."""
    start = record["start"]
    lines = [
        "## Start",
        "",
        "`torchrender render cornell_box` as a fresh process, 1024 × 768, interpreter start included:",
    ]
    lines += [f"{start['cached']:.1f} s with compiled kernels cached"]
    if "very_first" in start:
        lines[-1] += f", {start['very_first']:.1f} s the very first time, when everything is compiled"
    lines[-1] += "."
    return [*lines, f"Peak memory of this whole report: {record['peak_memory_mib']:,} MiB.", ""]


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


def ratio(other: float | None, own: float) -> str:
    """How many times slower the other is."""
    return "–" if other is None else f"**{other / own:.1f}×**"
