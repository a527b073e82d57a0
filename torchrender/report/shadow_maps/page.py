"""The page of the shadow-map study."""

from __future__ import annotations

from typing import Any

from torchrender.quality.machine import machine_line
from torchrender.quality.pages import table

MOST_FALSE = 0.003
"""Greatest share of false shadow that is aimed at, of every filter on every built-in scene."""
LEAST_KEPT = {"default": 0.98, "traced": 0.99}
"""Least share of a small box's shadow that is aimed at on large grounds."""


def page(record: dict[str, Any]) -> list[str]:
    """Its lines in Markdown."""
    width, height = record["size"]
    return [
        "# Shadow maps, measured",
        "",
        f"`python -m torchrender.report.shadow_maps` on {machine_line(record['machine'])}",
        "",
        f"Image {width} × {height}; maps 1024² where nothing else is said; times are medians of {record['runs']} runs "
        "in turn. Wrong pixels: shares of the pixels that face the light, dark or lit by over a half against one "
        "shadow ray each; of pcss against 64 rays to the light's area, or to the disc that pcss takes a light without "
        "area for: the sun's 0.53°, lamps a twentieth of the scene's diagonal. Acne: false shadow farther than two "
        "pixels from any true edge. Kept: share of the true shadow that is dark. Penumbra: mean error, 0 to 255, where "
        "those 64 rays neither all reach the light nor all miss it: pcss alone has penumbrae. Contact displacement: "
        "how far the bias of the map alone may move a contact, 95th percentile, share of the diagonal.",
        "",
        "Maps follow the view, and triangles settle their edges, unless a row says otherwise; constant biases are "
        "those that a user would tune.",
        "",
        "![rays and filters](shadow-maps.jpg)",
        "",
        "One row a scene, as below. From the left: many rays to the light; none, bilinear (the default), pcf, poisson, "
        "pcss; bilinear with one map of the whole scene that settles its own edges.",
        "",
        *_everywhere(record["everywhere"], width // 2, height // 2),
        *_grounds(record["grounds"]),
        *(line for case, row in record["cases"].items() for line in _case(case, row)),
    ]


def _percent(share: float, digits: int = 3) -> str:
    return f"{100 * share:.{digits}f} %"


def _everywhere(found: dict[str, Any], width: int, height: int) -> list[str]:
    ways = list(next(iter(found.values())))
    rows = []
    for scene, row in found.items():
        cells = [_reached(row[way]["false_shadow"], row[way]["false_shadow"] <= MOST_FALSE) for way in ways]
        rows.append([scene.replace("_", " "), *cells, *(_percent(row[way]["false_light"]) for way in ways)])
    head = ["", *(f"false shadow: {way}" for way in ways), *(f"false light: {way}" for way in ways)]
    return [
        "## Every filter on every built-in scene",
        "",
        f"The worst of each scene's lights, {width} × {height}, against one ray a pixel. At most "
        f"{100 * MOST_FALSE:g} % of false shadow is aimed at.",
        "",
        *table(head, rows),
    ]


def _grounds(found: list[dict[str, float]]) -> list[str]:
    rows = []
    for row in found:
        cells = [f"{row['side']:,.0f} m", f"{row['place']:,.1f} m"]
        for way, least in LEAST_KEPT.items():
            cells += [_reached(row[f"{way} kept"], row[f"{way} kept"] >= least, 2), _percent(row[f"{way} false"])]
        rows.append(cells)
    ways = [f"{way}: {what}" for way in LEAST_KEPT for what in ("kept", "false shadow")]
    return [
        "## A box of 0.6 m on large grounds",
        "",
        "Seen from three metres away, against the closed form: the sun's line from each point of the ground against "
        "the slabs of the box. Aimed at: "
        + ", ".join(f"{100 * least:g} % kept {way}" for way, least in LEAST_KEPT.items())
        + ".",
        "",
        *table(["ground", "from the origin", *ways], rows),
    ]


def _case(case: str, row: dict[str, Any]) -> list[str]:
    cells = []
    for name, s in row["settings"].items():
        times = [f"{s[step]['median']:.1f}" for step in ("map_ms", "lookup_ms")]
        shares = [_percent(s[kind]) for kind in ("false_shadow", "false_light", "acne")]
        shares += [_percent(s["kept"], 2), f"{s['mean_error']:.4f}"]
        penumbra = f"{255 * s['penumbra']:.1f}" if s["penumbra"] else "–"
        moved = _percent(s["contact_displacement_p95"] / row["diagonal"])
        cells.append([name, *times, *shares, penumbra, moved, str(s["views"]), f"{s['map_mib']:.0f}"])
    head = ["setting", "map ms", "lookup ms", "false shadow", "false light", "acne", "kept", "mean error", "penumbra"]
    pair = ("edges by the map: none", "edges by the map: bilinear")
    none, bilinear = (row["settings"][n]["lookup_ms"]["median"] for n in pair)
    return [
        f"## {case.replace('_', ' ')}",
        "",
        *table([*head, "contact displacement", "views", "map MiB"], cells),
        f"Lookup cost bilinear / none: {bilinear / none:.2f} (published, shader path: 1.45–1.47).",
        "",
    ]


def _reached(share: float, good: bool, digits: int = 3) -> str:
    """Bold where the aim is reached."""
    return f"**{_percent(share, digits)}**" if good else _percent(share, digits)
