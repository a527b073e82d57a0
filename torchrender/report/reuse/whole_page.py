"""The section on whole walks in large pictures."""

from __future__ import annotations

import statistics
from typing import Any

Frames = list[dict[str, Any]]


def whole_section(walks: dict[str, dict[str, Any]], study: dict[str, Any]) -> list[str]:
    """Whole walks in large pictures."""
    lines = [
        f"## Whole walks at {study['whole_size']}²",
        "",
        f"{study['whole_frames']} frames, one after the other; every {study['whole_step']}th is traced, too, for time "
        "and error. Key frames count in times and shares.",
        "",
        "| Walk | Key frames | Traced %, with key frames | Tracing ms | Reuse ms | Less time | Error over the picture "
        "| greatest of a frame | over reflective pixels |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for label, walk in walks.items():
        frames: Frames = walk.get("whole", [])
        if not frames:
            continue
        known = [f for f in frames if "trace_ms" in f]
        tracing, reuse = mean(known, "trace_ms"), mean(frames, "reuse_ms")
        cells = [label, str(sum(f["key_frame"] for f in frames)), f"{100 * mean(frames, 'traced_share'):.1f}"]
        cells += [f"{tracing:.0f}", f"{reuse:.0f}", f"{tracing / reuse:.2f}×", f"{mean(known, 'image_error'):.2f}"]
        cells += [f"{max(f['image_error'] for f in known):.2f}", f"{mean(known, 'error'):.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def mean(frames: Frames, name: str) -> float:
    """Mean of an entry."""
    return statistics.fmean([float(f[name]) for f in frames])
