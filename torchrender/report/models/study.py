"""Draw test models and twins of well-known ones: ``python -m torchrender.report.models [--quick] [-o docs/results]``.

Writes ``models.md``, ``models.jpg`` (files below ``gltf`` in the folder of ``TORCHRENDER_DATA``, default
``../shared/data``) and ``models-twins.jpg`` (scenes made here). Each stands beside what Mitsuba's path tracer makes of
the same scene, where that is installed, and beside the picture that was published with it.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import torch

from torchrender.errors import TorchRenderError
from torchrender.images.files import read_image
from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.report.common.command import run_study
from torchrender.report.models.path_traced import available
from torchrender.report.models.sheet import Tile, files_of, tile_of_file, tile_of_twin, write_sheet
from torchrender.report.models.twins import TWINS
from torchrender.scene.environment import Environment

SKY = "envmaps/museum.exr"
QUICK = ("SimpleSparseAccessor", "UnlitTest")


def sky_of(data: Path) -> Environment:
    """A museum's, or where data are missing one that is bright above and dim below."""
    if (data / SKY).is_file():
        return Environment(radiance=read_image(data / SKY)[..., :3].contiguous())
    rows = torch.linspace(1.2, 0.2, 32)[:, None, None].expand(32, 64, 3)
    return Environment(radiance=rows.contiguous())


def run(folder: Path, quick: bool) -> list[Path]:
    """Draw and write."""
    data = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))
    sky, size = sky_of(data), {"side": 32, "samples": 4} if quick else {}
    record: dict[str, Any] = {"machine": machine_record(), "failed": [], "models": {}}
    sheets: dict[str, list[Tile]] = {"models": [], "models-twins": []}
    for file in files_of(data / "gltf"):
        if quick and file.stem not in QUICK:
            continue
        try:
            sheets["models"].append(tile_of_file(file, sky, **size))
        except TorchRenderError as error:
            record["failed"].append(f"{file.stem}: {error}")
        sys.stderr.write(f"{file.stem}\n")
    for twin in TWINS:
        if not quick or twin.name in QUICK:
            sheets["models-twins"].append(tile_of_twin(twin, sky, **size))
            sys.stderr.write(f"{twin.name}\n")
    files = []
    for name, tiles in sheets.items():
        if tiles:
            files.append(folder / f"{name}.jpg")
            write_sheet(files[-1], tiles, columns=2 if name == "models" else 3)
            record["models"] |= {tile.name: _compared(tile) for tile in tiles}
    write_record(folder / "models.json", record)
    write_text(folder / "models.md", _page(record, [file.name for file in files]))
    return [folder / "models.json", folder / "models.md", *files]


def _compared(tile: Tile) -> dict[str, float | None]:
    """Mean of the displayed picture, of the path tracer's, and the mean difference between both, in bytes."""
    found = tile.found.float()
    traced = None if tile.traced is None else tile.traced.float()
    return {
        "mean": float(found.mean()),
        "traced": None if traced is None else float(traced.mean()),
        "difference": None if traced is None else float((found - traced).abs().mean()),
    }


def _page(record: dict[str, Any], pictures: list[str]) -> list[str]:
    lines = ["# Test models", "", f"`python -m torchrender.report.models` on {machine_line(record['machine'])}", ""]
    lines += [
        "Each as it comes out here, beside what Mitsuba's path tracer makes of the same meshes, textures and lights",
        "(its `principled` surfaces; light that comes back from surfaces is in its pictures alone), and the picture",
        "published with the file (another viewer, other light: features count, not pixels). What has no light stands",
        "under one sky. The words say what each is to show.",
        "",
    ]
    for name in pictures:
        lines += [f"![{name}]({name})", ""]
    if not available():
        lines += ["Mitsuba is not installed: its pictures are missing.", ""]
    lines += ["Mean of the displayed picture, here and there, and the mean difference, of 255:", ""]
    lines += ["| model | here | path traced | difference |", "|---|---:|---:|---:|"]
    for name, row in record["models"].items():
        cells = ["" if row[k] is None else f"{row[k]:.1f}" for k in ("mean", "traced", "difference")]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return [*lines, ""] + ([f"Not drawn: {'; '.join(record['failed'])}", ""] if record["failed"] else [])


def main() -> None:
    """The command."""
    run_study(__doc__, run, quick="two small pictures")
