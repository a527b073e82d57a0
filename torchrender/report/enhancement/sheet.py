"""A sheet of pictures: objects down, methods across."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from PIL import Image, ImageDraw
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.numerics.color import srgb_from_linear
from torchrender.report.enhancement.objects import Subject

SHOWN = ("plain", "Radiance Scaling", "eye-dome lighting", "ours without projection", "ours", "ours, limited")
TILE, HEAD = 256, 18


def write_sheet(path: Path, rows: Sequence[tuple[Subject, Mapping[str, tuple[Tensor, float]]]]) -> None:
    """Write a JPEG; pictures (1,H,W) in [0,1]."""
    sheet = Image.new("RGB", (TILE * len(SHOWN), HEAD + TILE * len(rows)), "white")
    draw = ImageDraw.Draw(sheet)
    for column, name in enumerate(SHOWN):
        draw.text((TILE * column + 4, 3), name, fill="black")
    for number, (subject, made) in enumerate(rows):
        for column, name in enumerate(SHOWN):
            picture = torch.where(subject.seen.covered, made[name][0].clamp(0, 1), 0.25)[0]
            grey = (255 * srgb_from_linear(picture[..., None].float().expand(-1, -1, 3))).round().to(torch.uint8)
            tile = Image.fromarray(grey.numpy()).resize((TILE, TILE), Image.Resampling.LANCZOS)
            sheet.paste(tile, (TILE * column, HEAD + TILE * number))

    def write(file: Path) -> None:
        sheet.save(file, format="JPEG", quality=88)

    write_atomically(path, write)
