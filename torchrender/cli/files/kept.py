"""Files that a command reads are never written over; by-products have names of their own."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from torchrender.errors import ImageFileError

INPUTS = (
    *("scene", "scenes", "cloud", "photo", "path", "move", "cameras", "marks", "depth", "stereo", "lidar", "labels"),
    "capture",
)
"""Arguments of commands that name files to read."""
OUTPUTS = ("output", "sheet", "glb", "ply", "trp", "write_transmittance", "write_scattered", "write_depth")
"""Arguments that name files to write."""
BY_PRODUCTS = {
    "fly": ("statistics.json", "statistics.png"),
    "depth": ("cameras.json", "kinds.png"),
    "spheres": ("spheres.png",),
    "style": ("sheet.png",),
}
"""What commands write beside their output, see :func:`beside`."""


def beside(output: Path, what: str) -> Path:
    """A by-product: ``walk_statistics.json`` beside ``walk.mp4``, ``statistics.json`` in a folder."""
    return output.with_name(f"{output.stem}_{what}") if output.suffix else output / what


def keep_inputs(arguments: argparse.Namespace) -> None:
    """Refuse to write over a file that the command reads, or that such a file names.

    Raises:
        ImageFileError: names the file.
    """
    given = vars(arguments)
    outputs = [Path(given[name]) for name in OUTPUTS if given.get(name)]
    outputs += [beside(Path(arguments.output), what) for what in BY_PRODUCTS.get(arguments.command, ())]
    if arguments.command == "render" and len(arguments.camera or ()) > 1:
        from torchrender.images.files import numbered

        count = len(arguments.camera)
        outputs += [numbered(outputs[0], number, count) for number in range(count)]
    inputs: list[str] = []
    for name in INPUTS:
        value = given.get(name) or ()
        words = [value] if isinstance(value, str) else value
        inputs += [word.partition("=")[2] if name == "move" else word for word in words]
    there = [path for path in outputs if os.path.isfile(path)]
    if there:
        from torchrender.scene.files.named import names_file

        for path in there:
            if any(names_file(Path(source), path) for source in inputs):
                raise ImageFileError(path, "is read by this command, too: give another output")
