"""One HTML page of all curves: a reader clicks a point and sees the picture and its error beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from torchrender.images.files import write_atomically
from torchrender.passes.table import PASSES
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import text_writer
from torchrender.tuning.tradeoff import SceneCurves


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
        "passes": {step.name: step.summary for step in PASSES},
        "scenes": {curves.name: curves.passes for curves in all_curves},
    }
