"""The page of the voxel study: tables beside the published numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table, write_text

PUBLISHED = (  # model, triangles, vertices, rasterise, texelize, synthesise, classify: milliseconds at 256 cubed
    ("Duck", 1_254, 947, 9.0, 8.0, 10.0, 0.8),
    ("Hugo", 16_928, 8_634, 9.7, 8.3, 10.0, 7.0),
    ("Bunny", 69_451, 34_834, 12.0, 8.0, 11.0, 27.0),
    ("Dragon", 871_326, 439_370, 38.0, 8.0, 11.0, 330.0),
    ("Buddha", 1_087_514, 550_868, 47.0, 7.8, 10.0, 415.0),
    ("Blade", 1_765_388, 898_796, 75.0, 8.0, 12.0, 660.0),
)
PUBLISHED_GRIDS = {  # side: bits, memory, voxelize ms, voxels, draw ms (Wagner, 60,246 triangles)
    512: (1, "16 MB", 500, 620_381, 240),
    256: (8, "16 MB", 30, 151_347, 10),
    128: (16, "4 MB", 24, 38_012, 6),
    64: (8, "256 KB", 21, 9_379, 4),
}
STAGES = ("rasterise", "texelize", "synthesise")
IMPLICIT = {64: (36_104, 8_928), 128: (290_408, 37_184), 256: (2_326_240, 150_208)}


def write_page(record: dict[str, Any], folder: Path) -> None:
    """``voxels.md`` in ``folder``."""
    lines = [
        "# Voxels, measured",
        "",
        f"`python -m torchrender.report.voxels` on {machine_line(record['machine'])}",
        "",
        "Milliseconds are medians; candidates of one table row take turns within one run.",
        "",
        "![Voxels](voxels.jpg)",
        "",
        *_models(record),
        *_grids(record["grids"]),
        *_peers(record["peers"]),
        *_baselines(record["baselines"], record["study"]["side"]),
        *_solids(record),
        *_scaling(record["scaling"], record["study"]["side"]),
        *_uses(record),
    ]
    write_text(folder / "voxels.md", lines)


def _percent(share: float, digits: int = 2) -> str:
    return f"{100 * share:.{digits}f} %"


def _ms(row: dict[str, Any], key: str) -> str:
    return f"{row['ms'][key]['median']:.1f}"


def _models(record: dict[str, Any]) -> list[str]:
    side = record["study"]["side"]
    rows = [
        [
            m["name"],
            f"{m['triangles']:,}",
            f"{m['vertices']:,}",
            *(_ms(m, k) for k in ("classify", "thin", "conservative", "solid")),
            " / ".join(f"{m['sheets'][k]:.0f}" for k in ("rasterise_ms", "texelize_ms", "synthesise_ms")),
            f"{m['pairs']:,.0f}",
            f"{m['thin_cells']:,} / {m['surface_cells']:,}",
            _percent(m["leaking"]) if not m["closed"] else "closed",
        ]
        for m in record["models"]
    ]
    published = [
        [n, f"{t:,}", f"{v:,}", f"{r:g}", f"{x:g}", f"{s:g}", f"{r + x + s:g}", f"{c:g}"]
        for n, t, v, r, x, s, c in PUBLISHED
    ]
    equal = all(m["sheets_equal_thin"] for m in record["models"])
    return [
        f"## Table 2.1: models at {side}³",
        "",
        "The compiled passes rasterise, texelize and synthesise at once. Beside them the source's three stages, each",
        f"on its own in torch; their cells {'equal' if equal else 'DIFFER FROM'} those of the thin pass.",
        "",
        *table(
            ["model", "triangles", "vertices", "classify ms", "thin ms", "conservative ms", "solid ms",
             "torch stages ms", "pairs", "cells thin / conservative", "leaking columns"],
            rows,
        ),
        "Published (P4 2.4 GHz, ATI 9800 Pro, milliseconds):",
        "",
        *table(["model", "triangles", "vertices", *STAGES, "sum", "classify"], published),
    ]  # fmt: skip


def _grids(grids: dict[str, Any]) -> list[str]:
    rows = []
    for g in grids["rows"]:
        published = PUBLISHED_GRIDS.get(g["side"])
        rows.append(
            [
                f"{g['side']}³",
                f"{g['cells']:,}",
                "–" if g["ratio"] is None else f"{g['ratio']:.2f}",
                f"{g['packed_bytes'] / 2**20:g} MiB",
                f"{g['sheet_bits']} bit, {g['sheet_bytes'] / 2**20:g} MiB, {g['sheets']} sheets",
                *(_ms(g, k) for k in ("surface", "solid", "sides")),
                "–" if published is None else "{} bit, {}, {} ms, {:,}, {} ms".format(*published),
            ]
        )
    return [
        f"## Table 2.2: grids, {grids['triangles']:,} triangles",
        "",
        *table(
            ["grid", "surface cells", "× previous", "packed", "worksheets", "surface ms", "solid ms",
             "sides as mesh ms", "published: bits, memory, voxelize, voxels, draw"],
            rows,
        ),
    ]  # fmt: skip


def _peers(peers: dict[str, Any]) -> list[str]:
    out = [
        f"## Other programs: {peers['triangles']:,} triangles, {peers['side']} cells along the longest side",
        "",
        "Missing and extra cells against the exact set on each program's own grid (surface: closed boxes that meet a",
        "triangle; solid: centres inside).",
        "",
    ]
    for kind in ("surface", "solid"):
        rows = [["torchrender", f"{peers['own_ms'][kind]['median'] / 1e3:.3f}", "1", "0 %", "0 %"]]
        for name, row in peers[kind].items():
            if row["why"]:
                rows.append([name, row["why"], "–", "–", "–"])
            else:
                shares = [_percent(row["missing"], 3), _percent(row["extra"], 3)]
                rows.append([name, f"{row['seconds']:.3f}", f"{row['ratio']:.1f}", *shares])
        out += [f"{kind.capitalize()}:", "", *table(["program", "seconds", "× torchrender", "missing", "extra"], rows)]
    return out


def _baselines(row: dict[str, Any], side: int) -> list[str]:
    ms = {k: v["median"] for k, v in row["ms"].items()}
    rows = [
        ["slices, the thin kernel once per slice", f"{ms['slices']:.0f}", f"{ms['slices'] / ms['thin']:.1f} × thin"],
        [
            "three sheets in torch",
            f"{ms['three sheets, torch']:.0f}",
            f"{ms['three sheets, torch'] / ms['thin']:.1f} × thin",
        ],
        ["thin", f"{ms['thin']:.1f}", "1"],
        ["layered depths by rays", f"{ms['layered depths']:.0f}", f"{ms['layered depths'] / ms['solid']:.1f} × solid"],
        ["solid", f"{ms['solid']:.1f}", "1"],
    ]
    same = "the same cells as" if row["slices_equal_thin"] else "OTHER CELLS THAN"
    return [
        f"## Baselines: {row['triangles']:,} triangles at {side}³",
        "",
        f"Slices find {same} the thin pass. Layered depths differ from the solid in {row['layered_differs']} cells,"
        " where snapping moves a centre across the surface.",
        "",
        *table(["method", "ms", "ratio"], rows),
    ]


def _solids(record: dict[str, Any]) -> list[str]:
    sides = [str(s) for s in record["study"]["sides"]]
    rows = []
    for s in record["solids"]:
        errors = ["–" if s["error"][n] is None else f"{100 * s['error'][n]:+.3f} %" for n in sides]
        state = "closed" if s["closed"] else f"open, {_percent(s['leaking'])} leak"
        rows.append([s["name"], state, *errors, *(_percent(s[m], 3) for m in ("winding", "parity", "vote", "toggle"))])
    return [
        "## Solids",
        "",
        f"Error of the volume by cells along the longest side, and cells wrong against rays"
        f" ({record['study']['rays']:,} cells at {sides[-2]}, majority of three rays).",
        "",
        *table(["model", "mesh", *sides, "winding", "parity", "vote", "toggle (source)"], rows),
    ]


def _scaling(rows: list[dict[str, float]], side: int) -> list[str]:
    lines = [
        [
            f"{r['triangles']:,}",
            f"{r['cells']:,}",
            f"{r['pairs']:,}",
            f"{r['ms']:.1f}",
            f"{1e6 * r['ms'] / r['triangles']:.0f}",
        ]
        for r in rows
    ]
    return [
        f"## Time by triangles, conservative at {side}³",
        "",
        *table(["triangles", "cells", "pairs of triangle and cell", "ms", "ns per triangle"], lines),
    ]


def _uses(record: dict[str, Any]) -> list[str]:
    uses = record["uses"]
    rows = []
    for r in uses["implicit"]:
        solid, surface = IMPLICIT.get(r["side"], (None, None))
        wanted = "–" if solid is None else f"{solid:,} / {surface:,}"
        rows.append([f"{r['side']}³", f"{r['solid']:,} / {r['surface']:,}", wanted, f"{r['ms']:.0f}"])
    ball, hit = uses["parametric"], uses["collision"]
    pictures = ", ".join(f"{name} {ms:.0f} ms" for name, ms in record["pictures"].items()) or "no real data found"
    return [
        "## Functions, collision, transparent pictures",
        "",
        *table(["grid", "implicit: solid / surface cells", "expected", "solid ms (published 25)"], rows),
        f"A parametric sphere at 64³ took {ball['samples']:,} samples for {ball['cells']:,} cells; the largest gap",
        f"between neighbours is {ball['largest_gap']:.2f} cells. Two rings of {hit['triangles']:,} triangles share"
        f" {hit['shared']:,} voxels, found in {hit['ms']['median']:.1f} ms.",
        "",
        f"Transparent pictures of {record['study']['picture']}² pixels: {pictures} (published: 100 ms for a brain mesh",
        "in a 128³ volume).",
    ]
