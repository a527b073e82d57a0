"""One HTML page of all curves: a reader clicks a point and sees the picture and its error beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from torchrender.errors import InputError
from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import text_writer
from torchrender.tuning.tradeoff import SUMMARIES, SceneCurves

BEGIN, END = '<script type="application/json" id="data">', "</script>"


def write_page(path: Path, all_curves: Sequence[SceneCurves]) -> None:
    """The page as one file: nothing is fetched from elsewhere."""
    # In a script element only "</" could end the data early.
    text = json.dumps(page_data(all_curves)).replace("</", "<\\/")
    template = (files("torchrender") / "data" / "tradeoff.html").read_text()
    write_atomically(path, text_writer(template.replace("/*DATA*/", text)))


def page_data(all_curves: Sequence[SceneCurves]) -> dict[str, Any]:
    """The curves of several scenes with their pictures."""
    return {
        "machine": machine_record(),
        "size": all_curves[0].size if all_curves else None,
        "passes": SUMMARIES,
        "scenes": {curves.name: curves.passes for curves in all_curves},
        # Names that are numbers lose their order in JavaScript.
        "order": {curves.name: {p: list(v["settings"]) for p, v in curves.passes.items()} for curves in all_curves},
    }


def earlier_curves(path: Path, size: int) -> dict[str, SceneCurves]:
    """By scene, the curves that a page holds; none where there is no page.

    Raises:
        InputError: they are of pictures of another size, or the file is no such page.
    """
    if not path.exists():
        return {}
    _, _, rest = path.read_text().partition(BEGIN)
    try:
        data = json.loads(rest.partition(END)[0])
        scenes, held, machine = data["scenes"], data["size"], data["machine"]
    except (ValueError, KeyError) as error:
        raise InputError(f"{path}: not a page of curves: move it away") from error
    if held != size:
        raise InputError(f"--side: {path} holds curves of pictures of {held} pixels a side, these are of {size}")
    when = {key: machine[key] for key in ("commit", "date")}
    return {
        name: SceneCurves(name, held, {one: {**when, **values} for one, values in passes.items() if one in SUMMARIES})
        for name, passes in scenes.items()
    }
