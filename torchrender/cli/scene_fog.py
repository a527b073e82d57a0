"""``--fog``: a medium around a scene that brings none."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from torchrender.cli.arguments import numbers
from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torchrender.scene.model import Scene


def add_scene_fog(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--fog",
        metavar="FOG",
        help="fog around the scene in place of its media: 'scattering=0.3 [absorption=A] [asymmetry=G] [height=H]"
        " [density=D] [floor=Y] [emission=E]', coefficients per scene unit; 'off' for clear air",
    )


def foggy(scene: Scene, arguments: argparse.Namespace) -> Scene:
    """The scene with the fog that the command line describes.

    Raises:
        OptionError: words that are no ``name=number``, or a name that fog does not have.
    """
    if arguments.fog is None:
        return scene
    if arguments.fog.strip() == "off":
        from dataclasses import replace

        return replace(scene, media=())
    from torchrender.scene.procedural.fog import with_fog

    values: dict[str, float] = {}
    for word in arguments.fog.split():
        name, equals, text = word.partition("=")
        if not equals:
            raise OptionError(f"--fog must be made of name=number, got {word!r}")
        values[name] = numbers(f"--fog {name}", text, 1)[0]
    return with_fog(scene, values)
