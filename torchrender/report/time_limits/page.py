"""The page of the study of time limits."""

from __future__ import annotations

from typing import Any

from torchrender.quality.machine import machine_line

KEPT = 1.1
"""A limit counts as kept if the picture took at most this share of it."""


def page(record: dict[str, Any]) -> str:
    """The Markdown page of a record of :mod:`torchrender.report.time_limits.study`."""
    size = record["size"]
    lines = [
        "# Time limits",
        "",
        f"`python -m torchrender.report.time_limits` on {machine_line(record['machine'])}",
        "",
        f"Pictures of {size} x {size} pixels. The scenes are the built-in ones with one diffuse colour per mesh, so "
        "that all renderers see the same surfaces, lights and camera; each is loaded before its time is taken, and one "
        "picture is made beforehand. torchrender computes direct and ambient light, the others trace paths of up to "
        f"six segments and are asked for {record['samples']} samples per pixel: errors are against each renderer's own "
        "picture without a limit, with the same samples, and tell how far the limit took it from that, not who is "
        "nearer to nature. Cycles builds its scene anew for every picture; for the others that is done before. In each "
        f"cell: median ms of {record['runs']} runs (longest), the share of pixels with an answer, mean FLIP. **Bold**: "
        f"the median is within {100 * (KEPT - 1):.0f} % of the limit and every pixel has an answer.",
        "",
    ]
    for name, scene in record["scenes"].items():
        lines += [f"## {name} ({scene['triangles']:,} triangles)", ""]
        limits = [str(limit) for limit in record["limits_ms"]]
        head = ["", *(f"{limit} ms" for limit in limits), "no limit"]
        lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        for renderer, row in scene["renderers"].items():
            version = f" {row['version']}" if "version" in row else ""
            if "missing" in row:
                lines.append(f"| {renderer} | not measured: {_plain(row['missing'])} " + "| " * len(limits) + "|")
                continue
            cells = [_cell(row["limits"][limit], float(limit)) for limit in limits]
            cells.append(f"{row['free_ms']:.0f}")
            lines.append(f"| {renderer}{version} | " + " | ".join(cells) + " |")
        notes = scene["renderers"]["torchrender"].get("notes", {})
        lines += ["", *(f"- torchrender at {limit} ms says: {_plain(text)}" for limit, text in notes.items())]
        lines += [""] if notes else []
    shown = list(record["scenes"])[-1]
    measured = [name for name, row in record["scenes"][shown]["renderers"].items() if "missing" not in row]
    lines += [
        f"{shown}; rows: {', '.join(measured)}; columns: the limits from left to right, then no limit.",
        "",
        "![pictures](time-limits.png)",
        "",
    ]
    return "\n".join(lines)


def _cell(row: dict[str, float], limit: float) -> str:
    share = 100 * row["complete"]
    whole = f"{share:.0f} %" if share in (0.0, 100.0) else f"{share:.1f} %"
    text = f"{row['ms']:.0f} ({row['most_ms']:.0f}), {whole}, {row['flip']:.3f}"
    return f"**{text}**" if row["ms"] <= KEPT * limit and row["complete"] == 1.0 else text


def _plain(text: str) -> str:
    return text.replace("|", "/").replace("\n", " ")
