"""One HTML page of all curves: a reader clicks a point and sees the picture and its error beside it."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image as Pillow
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.passes.table import PASSES
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import text_writer
from torchrender.tuning.tradeoff import SceneCurves

SHOWN = 240
"""Pixels of a side of the pictures in the page."""


def write_page(path: Path, all_curves: Sequence[SceneCurves]) -> None:
    """The page as one file: nothing is fetched from elsewhere."""
    # In a script element only "</" could end the data early.
    text = json.dumps(page_data(all_curves)).replace("</", "<\\/")
    template = (files("torchrender") / "data" / "tradeoff.html").read_text()
    write_atomically(path, text_writer(template.replace("/*DATA*/", text)))


def page_data(all_curves: Sequence[SceneCurves]) -> dict[str, Any]:
    """The curves of several scenes with their pictures."""
    scenes = {}
    for curves in all_curves:
        record = curves.record()
        for name, values in record.items():
            values["picture"] = picture_url(curves.references.get(name))
            for setting, numbers in values["settings"].items():
                measured = curves.passes[name][setting]
                numbers["picture"] = picture_url(measured.picture)
                numbers["difference"] = picture_url(measured.difference)
        scenes[curves.name] = record
    return {
        "machine": machine_record(),
        "size": all_curves[0].size if all_curves else None,
        "passes": {step.name: step.summary for step in PASSES},
        "scenes": scenes,
    }


def picture_url(picture: Tensor | None) -> str:
    """A picture (H,W,3) or (H,W) in [0,1] as a data URL; an empty one for None."""
    if picture is None:
        return ""
    planes = picture.float()[..., None].expand(*picture.shape, 3) if picture.dim() == 2 else picture.float()
    codes = (planes.clamp(0.0, 1.0) * 255.0 + 0.5).to(torch.uint8).numpy()
    image = Pillow.fromarray(np.ascontiguousarray(codes))
    image.thumbnail((SHOWN, SHOWN), Pillow.Resampling.LANCZOS)
    data = io.BytesIO()
    image.save(data, "JPEG", quality=74)
    return "data:image/jpeg;base64," + base64.b64encode(data.getvalue()).decode()
