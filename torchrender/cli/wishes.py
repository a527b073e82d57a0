"""Wishes for pictures that take words of their own: ``--enhance`` and ``--fog``."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import named, numbers
from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torchrender.effects.enhancement.options import EnhanceOptions
    from torchrender.scene.camera import Cameras
    from torchrender.scene.model import Scene

_WORDS = ("magnitude", "curvature", "source")
_FLAGS = ("centred", "light_gradient")


def add_enhance(parser: argparse.ArgumentParser) -> None:
    """The argument."""
    parser.add_argument(
        "--enhance",
        nargs="?",
        const="",
        metavar="WISH",
        help="make shape easier to read; WISH: a weight (default 0.4), or name=value pairs with commas between them,"
        " such as gradient_weight=0.6,range_limit=0.25,terms=geometry+projection",
    )


def enhance_wish(text: str | None) -> EnhanceOptions | None:
    """What the argument says; None: nothing.

    Raises:
        OptionError: an unknown name, or a value out of range; names it.
    """
    if text is None:
        return None
    from dataclasses import fields

    from torchrender.effects.enhancement.options import EnhanceOptions

    known = [field.name for field in fields(EnhanceOptions)]
    values: dict[str, Any] = {}
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if not equals:
            name, value = "gradient_weight", part
        if name not in known:
            raise OptionError(f"--enhance: unknown name {name!r}; known names: {', '.join(known)}")
        values[name] = _value(name, value)
    with named(**{name: f"--enhance {name}" for name in known}):
        return EnhanceOptions(**values)


def _value(name: str, text: str) -> Any:
    if name in _WORDS:
        return text
    if name == "terms":
        return tuple(filter(None, text.split("+")))
    if name in _FLAGS:
        if text not in ("yes", "no"):
            raise OptionError(f"--enhance {name} must be yes or no, got {text!r}")
        return text == "yes"
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"--enhance {name} must be a number, got {text!r}") from None


def add_scene_fog(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--fog",
        nargs="?",
        const="",
        metavar="FOG",
        help="fog in a box around scene and cameras, in place of its media; alone a thin one, or 'scattering=0.3"
        " [absorption=A] [asymmetry=G] [height=H] [density=D] [floor=Y] [emission=E]', coefficients per scene unit;"
        " what glows needs absorption, too: 'absorption=0.2 emission=5';"
        " 'off' for clear air",
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
            how = f"scattering={word}" if _is_number(word) else "scattering=0.3 height=2"
            raise OptionError(f"--fog must be made of name=number, such as --fog '{how}', got {word!r}")
        values[name] = numbers(f"--fog {name}", text, 1)[0]
    return with_fog(scene, values)


def say_outside(scene: Scene, cameras: list[Cameras], arguments: argparse.Namespace) -> None:
    """Say that a camera stands outside of the box that ``--fog`` fills: its sides show before the background."""
    if arguments.fog is None or not scene.media:
        return
    fog = scene.media[0]
    for number, camera in enumerate(cameras):
        eye = camera.eye[0]
        if bool(((eye < fog.low) | (eye > fog.high)).any()):
            low, high = (", ".join(f"{v:.3g}" for v in corner.tolist()) for corner in (fog.low, fog.high))
            sys.stderr.write(
                f"torchrender: view {number} looks at the fog from outside: it fills a box around the scene, from "
                f"({low}) to ({high}), whose sides show; a camera in it (--camera eye=X,Y,Z) stands in the fog\n"
            )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
