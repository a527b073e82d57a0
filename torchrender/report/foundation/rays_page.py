"""The section on rays of the foundation page."""

from __future__ import annotations

from typing import Any

GOALS = {"primary": 0.75, "shadow": 0.75, "diffuse": 0.65, "reflection": 0.65}
"""Least share of plain Embree's speed that is aimed at, by kind of ray."""
BUILD_GOAL = 1.4
TREE_GOAL = 0.3


def rays_section(rows: list[dict[str, Any]]) -> list[str]:
    """Speed, build times and wrong rays; nothing where nothing was measured."""
    if not rows:
        return []
    lines = [
        "## Rays",
        "",
        "Millions of rays a second beside Embree's own float32 triangles, asked through the same C interface with the",
        f"same rays and threads. Aimed at: {GOALS['primary']} of its speed for primary and shadow rays,",
        f"{GOALS['diffuse']} for diffuse and reflected ones, {TREE_GOAL} for the tree without Embree. Wrong: another",
        "triangle than the float64 tree finds, or another answer to whether there is one.",
        "",
        "| scene | triangles | rays | caster | plain Embree | ratio | tree | ratio | wrong: caster | plain Embree |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        for kind, found in row["kinds"].items():
            speed = found["mrays_per_s"]
            share, tree = speed["caster"] / speed["plain"], speed["tree"] / speed["plain"]
            cells = [
                row["scene"].replace("_", " "),
                f"{row['triangles']:,}",
                kind,
                *(f"{speed[k]:.2f}" for k in ("caster", "plain")),
            ]
            cells += [reached(share, share >= GOALS[kind]), f"{speed['tree']:.2f}", reached(tree, tree >= TREE_GOAL)]
            cells += [f"{found['wrong'][k]:,} of {found['rays']:,}" for k in ("caster", "plain")]
            lines.append("| " + " | ".join(cells) + " |")
    return [*lines, "", *build_lines(rows), *grazing_lines(rows)]


def build_lines(rows: list[dict[str, Any]]) -> list[str]:
    """Build times in milliseconds."""
    lines = [
        f"Building, in ms; at most {BUILD_GOAL} times plain Embree's is aimed at. Moved: the quick tree for other",
        "vertices. Tree: the one without Embree.",
        "",
        "| scene | triangles | caster | plain Embree | ratio | moved | tree |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        ms = {k: v["median"] for k, v in row["build_ms"].items()}
        share = ms["caster"] / ms["plain"]
        cells = [row["scene"].replace("_", " "), f"{row['triangles']:,}", f"{ms['caster']:.0f}", f"{ms['plain']:.0f}"]
        cells += [reached(share, share <= BUILD_GOAL), f"{ms['moved']:.0f}", f"{ms['tree']:.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def grazing_lines(rows: list[dict[str, Any]]) -> list[str]:
    """Rays along surfaces, at their edges."""
    total = sum(r["grazing"]["rays"] for r in rows)
    own, plain = (sum(r["grazing"]["wrong"][k] for r in rows) for k in ("caster", "plain"))
    return [
        "Grazing rays, aimed at edges and just inside them under at most 0.5, 0.05 and 0.005",
        f"rad: {own:,} of {total:,} wrong; plain Embree {plain:,}.",
        "",
    ]


def reached(ratio: float, good: bool) -> str:
    """Bold where the aim is reached."""
    return f"**{ratio:.2f}×**" if good else f"{ratio:.2f}×"
