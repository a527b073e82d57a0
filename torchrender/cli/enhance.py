"""The wish ``--enhance`` of commands that make pictures."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torchrender.effects.enhancement.options import EnhanceOptions

_WORDS = ("magnitude", "curvature", "source")


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
    return EnhanceOptions(**values)


def _value(name: str, text: str) -> Any:
    if name in _WORDS:
        return text
    if name == "terms":
        return tuple(filter(None, text.split("+")))
    if name == "light_gradient":
        if text not in ("yes", "no"):
            raise OptionError(f"--enhance {name} must be yes or no, got {text!r}")
        return text == "yes"
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"--enhance {name} must be a number, got {text!r}") from None
