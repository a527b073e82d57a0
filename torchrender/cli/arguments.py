"""Arguments that several commands share: the scene, its camera, lists of numbers."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

from torchrender.cli.output import waiting
from torchrender.errors import InputError, OptionError, TorchRenderError

if TYPE_CHECKING:
    from torchrender.scene.camera import Cameras
    from torchrender.scene.model import Scene

MOST_THREADS = 1024
_CAMERA_KEYS = {"eye": 3, "target": 3, "up": 3, "fov": 1, "near": 1}


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line, and keeps which options of a command were given.

    What begins with a minus and a digit is a value: ``--background -1,0,0``.
    """

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        """Without the usage, which ``--help`` has."""
        self.exit(2, f"torchrender: error: {message}; see {self.prog} --help\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As usual; ``given_options`` of the result are the options that differ from their defaults, by argument."""
        found, rest = super().parse_known_args(args, namespace)
        changed = {
            action.dest: max(action.option_strings, key=len)
            for action in self._actions
            if action.option_strings and getattr(found, action.dest, action.default) != action.default
        }
        found.given_options = getattr(found, "given_options", {}) | changed
        return found, rest


def set_up_threads(count: int | None) -> None:
    """How many threads compute; before torch and numba are imported.

    Raises:
        OptionError: outside [1, MOST_THREADS].
    """
    # On a busy machine threads that spin while they wait made torch several times slower.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    if count is None:
        return
    if not 1 <= count <= MOST_THREADS:
        raise OptionError(f"--threads must be in [1, {MOST_THREADS}], got {count}")
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = str(count)


def say_unused(arguments: argparse.Namespace, used: Collection[str], what: str) -> None:
    """Warn of the options that were given but do nothing here: all but those ``used``, whatever the parser knows."""
    say_idle(arguments, [name for name in arguments.given_options if name not in (*used, "threads")], what)


def say_idle(arguments: argparse.Namespace, names: Collection[str], what: str) -> None:
    """Warn of the options of these names that were given: they do nothing here."""
    unused = [option for name, option in arguments.given_options.items() if name in names]
    if unused:
        verb = "does" if len(unused) == 1 else "do"
        sys.stderr.write(f"torchrender: warning: {', '.join(unused)} {verb} nothing with {what}\n")


def add_scene(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="a scene or mesh file, or the name of a built-in scene")
    parser.add_argument("--triangles", type=int, metavar="N", help="size of a built-in scene, in triangles (about)")
    parser.add_argument("--time", type=float, metavar="S", help="seconds into an animation of a glTF file")
    parser.add_argument("--animation", metavar="NAME", help="name or number of the animation (default: the first)")
    parser.add_argument("--variant", metavar="NAME", help="variant of the materials of a glTF file")
    parser.add_argument("--subscene", metavar="NAME", help="name or number of one of several scenes in a glTF file")
    parser.add_argument(
        "--drop-invalid", action="store_true", help="leave vertices that are NaN or infinite out, with their faces"
    )


def add_size(parser: argparse.ArgumentParser, default: str = "1024x768", what: str = "picture size") -> None:
    help_text = f"{what} in pixels (default {default})"
    parser.add_argument("--size", default=default, metavar="WxH", help=help_text)


def add_shadows(parser: argparse.ArgumentParser) -> None:
    """How shadows are made."""
    parser.add_argument("--no-shadows", action="store_true", help="light reaches everything; as --shadows off")
    parser.add_argument(
        "--shadows",
        choices=("off", "hard", "maps", "sampled", "traced"),
        help="none; hard ones; by maps, with guessed penumbrae (default); area lights sampled; by rays",
    )
    parser.add_argument("--shadow-size", type=int, metavar="N", help="texels of a shadow map's side (default 1024)")
    parser.add_argument(
        "--cascades", type=int, metavar="N", help="shadow maps along the view (default: as many as what is seen needs)"
    )


def add_display(parser: argparse.ArgumentParser, usual: str = "0") -> None:
    """How light is shown."""
    parser.add_argument("--exposure", metavar="EV", help=f"powers of two, or auto (default {usual})")
    parser.add_argument("--tone-map", choices=("none", "reinhard", "aces"), help="default none")


def add_look(parser: argparse.ArgumentParser) -> None:
    """How pictures are made and shown: samples, exposure, shadows, reflections."""
    help_text = "samples per pixel and side: 2 is two by two, 0.5 one for four pixels (default 1)"
    parser.add_argument("--supersample", type=float, metavar="N", help=help_text)
    add_display(parser, "as_lit: auto for lux, else 0")
    parser.add_argument("--background", metavar="R,G,B", help="linear colour of empty pixels")
    add_shadows(parser)
    parser.add_argument(
        "--reflections",
        choices=("auto", "clustered", "traced", "environment", "off"),
        help="how mirrors mirror; auto: the most accurate of the quick ways (default auto)",
    )


_ARGUMENT = re.compile(r"(\w+)(?= must )")


def say_option(error: TorchRenderError, arguments: argparse.Namespace) -> str:
    """What an error says, with the option in place of the argument of the same name that it complains about."""
    text = str(error)
    found = _ARGUMENT.match(text)
    if found is None or not isinstance(error, InputError) or getattr(arguments, found[1], None) is None:
        return text
    return f"--{found[1].replace('_', '-')}{text[found.end() :]}"


@contextmanager
def named(**options: str) -> Iterator[None]:
    """Errors about these arguments are errors about options of the command line: ``named(count="--views")``."""
    try:
        yield
    except InputError as error:
        found = _ARGUMENT.match(str(error))
        if found is None or found[1] not in options:
            raise
        raise type(error)(options[found[1]] + str(error)[found.end() :]) from error


def given(**values: Any) -> dict[str, Any]:
    """Those that the command line names; the others keep the default of the option or function that they are for."""
    return {name: value for name, value in values.items() if value is not None}


def numbers(name: str, text: str, count: int) -> list[float]:
    """``count`` finite numbers, separated by commas; the error names ``name``."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(v) < float("inf") for v in values):
        if count == 1:
            raise OptionError(f"{name} must be a number, got {text!r}")
        raise OptionError(f"{name} must be {count} numbers separated by commas, got {text!r}")
    return values


def exposure(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        return numbers("--exposure", text, 1)[0]
    except OptionError as error:
        raise OptionError(f'--exposure must be a number (EV) or "auto", got {text!r}') from error


def shadows_and_exposure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Those options of pictures, as the command line wants them."""
    from torchrender.pipeline.options import shadow_choices

    shadows = "off" if arguments.no_shadows else arguments.shadows
    with named(size="--shadow-size"):
        made = shadow_choices(shadows, arguments.shadow_size, arguments.cascades)
    return made if arguments.exposure is None else made | {"exposure": exposure(arguments.exposure)}


def load_scene(arguments: argparse.Namespace) -> Scene:
    if arguments.scene.lower().endswith(".trw"):
        from torchrender.walkthrough.file import read_walkthrough

        choices = Parser(add_help=False)
        add_scene(choices)
        of_scenes = {action.dest for action in choices._actions}
        say_unused(arguments, [name for name in vars(arguments) if name not in of_scenes], "a walkthrough")
        return read_walkthrough(arguments.scene).scene()
    from torchrender.scene.load import load

    with waiting(f"reading {arguments.scene}"), named(size="--triangles"):
        return load(
            arguments.scene,
            size=arguments.triangles,
            drop_invalid=arguments.drop_invalid,
            **given(
                time=arguments.time,
                animation=named_or_numbered(arguments.animation),
                variant=arguments.variant,
                subscene=named_or_numbered(arguments.subscene),
            ),
        )


def named_or_numbered(text: str | None) -> str | int | None:
    """A number where the text is one."""
    return int(text) if text is not None and text.isdigit() else text


def camera_of(scene: Scene, words: Sequence[str], width: int, height: int) -> Cameras:
    """The scene's default camera, one of its cameras by name, or one described as ``eye=x,y,z target=x,y,z fov=50``."""
    from torchrender.scene.camera import Cameras

    parts = " ".join(words).split()
    if not any("=" in part for part in parts):
        return scene.camera(" ".join(words) or None, width=width, height=height)
    given: dict[str, list[float]] = {}
    for part in parts:
        key, _, value = part.partition("=")
        if key not in _CAMERA_KEYS:
            raise OptionError(f"--camera: unknown key {key!r}; known keys: {', '.join(_CAMERA_KEYS)}")
        given[key] = numbers(f"--camera {key}", value, _CAMERA_KEYS[key])
    if "eye" not in given:
        raise OptionError("--camera must give eye=x,y,z")
    diagonal = scene.diagonal or 1.0
    target = given.get("target", scene.bounds.mean(dim=0).tolist())
    with named(fov_deg="--camera fov", near="--camera near"):
        return Cameras.look_at(
            given["eye"],
            target,
            width=width,
            height=height,
            fov_deg=given.get("fov", [50.0])[0],
            up=given.get("up", [0.0, 1.0, 0.0]),
            near=given.get("near", [1e-4 * diagonal])[0],
        )
