"""The directive ``curves``: error against time of a pass's settings, as measured and shipped with the package."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

FILE = Path(__file__).resolve().parents[2] / "torchrender" / "data" / "curves.json"
COLORS = ("#2a6fb0", "#c8553d", "#3c8d53", "#8a5a9e", "#b8860b", "#4d4d4d", "#008b8b")
FINEST = 1e-5
"""Error below which a setting counts as the reference."""
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 720, 300, 60, 190, 14, 40


def points_of(name: str) -> dict[str, list[tuple[str, float, float]]]:
    """By scene: setting, milliseconds, mean FLIP against the reference."""
    scenes = json.loads(FILE.read_text())["scenes"]
    return {
        scene: [(setting, row["ms"], row["flip"]) for setting, row in known["passes"][name].items()]
        for scene, known in scenes.items()
        if name in known["passes"]
    }


class Curves(SphinxDirective):
    """A drawing and a table of the curves of one pass."""

    required_arguments = 1
    has_content = False

    def run(self) -> list[nodes.Node]:
        """Called by Sphinx."""
        self.env.note_dependency(str(FILE))
        curves = points_of(self.arguments[0])
        if not curves:
            raise self.error(f"no curves were measured for {self.arguments[0]!r}")
        return [nodes.raw("", drawing(curves) + table(curves), format="html")]


def drawing(curves: dict[str, list[tuple[str, float, float]]]) -> str:
    """Both axes logarithmic; what equals the reference stands on the lowest line."""
    times = [max(ms, 0.1) for rows in curves.values() for _, ms, _ in rows]
    errors = [flip for rows in curves.values() for _, _, flip in rows if flip > 0] or [0.001]
    low, high = _decades(min(times), max(times))
    bottom, top = _decades(max(min(errors), FINEST), max(errors))
    bottom -= 1  # the line of the reference

    def x(ms: float) -> float:
        return LEFT + (math.log10(max(ms, 0.1)) - low) / (high - low) * (WIDTH - LEFT - RIGHT)

    def y(flip: float) -> float:
        at = math.log10(flip) if flip >= FINEST else bottom
        return TOP + (top - at) / (top - bottom) * (HEIGHT - TOP - BOTTOM)

    out = [f'<svg class="curves" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="error against time">']
    for decade in range(low, high + 1):
        at = x(10.0**decade)
        out.append(f'<path d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="currentColor" opacity="0.15"/>')
        out.append(f'<text x="{at:.1f}" y="{HEIGHT - BOTTOM + 14}" text-anchor="middle">{10.0**decade:g}</text>')
    for decade in range(bottom, top + 1):
        at, label = y(10.0**decade) if decade > bottom else y(0.0), f"{10.0**decade:g}" if decade > bottom else "0"
        out.append(f'<path d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}" stroke="currentColor" opacity="0.15"/>')
        out.append(f'<text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{label}</text>')
    for number, (scene, rows) in enumerate(curves.items()):
        color = COLORS[number % len(COLORS)]
        places = [(x(ms), y(flip)) for _, ms, flip in rows]
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b in places)
        out.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="1.5" opacity="0.7"/>')
        for (a, b), (setting, ms, flip) in zip(places, rows, strict=True):
            told = f"{scene}, {setting}: {ms:.0f} ms, {flip:.4f}"
            out.append(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.5" fill="{color}"><title>{told}</title></circle>')
        out.append(f'<text x="{WIDTH - RIGHT + 16}" y="{TOP + 12 + 16 * number}" style="fill:{color}">{scene}</text>')
    out.append(f'<text x="{(WIDTH - RIGHT + LEFT) / 2}" y="{HEIGHT - 6}" text-anchor="middle">milliseconds</text>')
    out.append(f'<text x="12" y="{HEIGHT / 2}" transform="rotate(-90 12 {HEIGHT / 2})" text-anchor="middle">')
    out.append("mean FLIP</text></svg>")
    return "".join(out)


def table(curves: dict[str, list[tuple[str, float, float]]]) -> str:
    """Milliseconds and error of every setting, a column for each scene."""
    settings = list(dict.fromkeys(setting for rows in curves.values() for setting, _, _ in rows))
    head = "".join(f"<th>{scene}</th>" for scene in curves)
    body = ""
    for setting in settings:
        cells = ""
        for rows in curves.values():
            row = next((row for row in rows if row[0] == setting), None)
            cells += "<td></td>" if row is None else f"<td>{row[1]:.1f} ms, {row[2]:.4f}</td>"
        body += f"<tr><td>{setting}</td>{cells}</tr>"
    return (
        '<div class="table-wrapper"><table class="docutils"><thead><tr><th>setting</th>'
        f"{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _decades(low: float, high: float) -> tuple[int, int]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    return first, max(last, first + 1)


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("curves", Curves)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
