"""The command ``torchrender style``: materials for a scene from the colours of photos."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import add_scene, load_scene, named, numbers
from torchrender.cli.files.kept import beside
from torchrender.cli.output import check_output, image_size
from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torchrender.photo.style.options import StyleOptions
    from torchrender.photo.style.session import Style

SUFFIXES = (".glb", ".toml")
SHEET_SUFFIXES = (".png", ".exr")
_LISTED = 12


def add_style(commands: Any) -> None:
    """Arguments of the command."""
    parser = commands.add_parser("style", help="give a scene materials in the colours of a photo")
    add_scene(parser)
    parser.add_argument(
        "--photo", required=True, action="append", metavar="FILE", help="picture; give it several times for several"
    )
    parser.add_argument(
        "-o", "--output", required=True, metavar="FILE",
        help="scene to write: .glb, or .toml (every kind of light, too) with a .glb beside it, which replaces no other",
    )  # fmt: skip
    parser.add_argument("--sheet", metavar="FILE", help="contact sheet (default: OUTPUT_sheet.png)")
    parser.add_argument("--no-sheet", action="store_true", help="no contact sheet")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="the same seed gives the same result")
    told = "views of the scene, 8 to 15 (default 10); objects that none shows add some"
    parser.add_argument("--views", type=int, default=10, metavar="N", help=told)
    parser.add_argument("--size", default="400x300", metavar="WxH", help="size of each view (default 400x300)")
    parser.add_argument(
        "--lock", action="append", default=[], metavar="OBJECT",
        help="keep the material an object has in the file: its name, #number, or a pattern such as 'chair*'",
    )  # fmt: skip
    parser.add_argument(
        "--pick", action="append", default=[], metavar="OBJECT=L,T,R,B",
        help="take an object's material from this part of the first photo: left, top, right, bottom in pixels",
    )  # fmt: skip
    parser.add_argument("--keep-textures", action="store_true", help="textures stay and take the new mean colours")
    parser.add_argument(
        "--by", choices=("object", "mesh", "material"), default="object",
        help="what gets one material: objects, meshes, or all that shares a material now (default object)",
    )  # fmt: skip
    parser.add_argument("--crop", action="store_true", help="lay the photo's middle over the views, unstretched")
    parser.add_argument(
        "--prior", type=float, default=1.0, metavar="W",
        help="weight of light walls, a middle floor and darker furniture; 0: the photo alone (default 1)",
    )  # fmt: skip
    parser.add_argument("--no-highlights", action="store_true", help="matt materials")
    for name, meaning in (("lightness", "lighter"), ("saturation", "more saturated"), ("warmth", "warmer")):
        parser.add_argument(f"--{name}", type=float, default=0.0, metavar="X", help=f"-1 to 1: {meaning} (default 0)")
    parser.add_argument("--add-light", action="store_true", help="a scene without light gets the one the fit assumes")
    parser.add_argument("--list", action="store_true", help="also list every object with its new colour")


def run_style(arguments: argparse.Namespace) -> None:
    """Style a scene, write it and the contact sheet, and say what took how long."""
    output = Path(arguments.output)
    check_output(output, SUFFIXES)
    sheet = _sheet_path(arguments, output)
    options = _options(arguments)
    pick = _picks(arguments.pick)
    from torchrender.images.files import read_image
    from torchrender.photo.style.transfer import style_scene

    photos = [read_image(path) for path in arguments.photo]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene = load_scene(arguments)
        style = style_scene(
            scene, photos, options, keep=arguments.lock, pick=pick, progress=_Bar.when_watched()
        )  # fmt: skip
        style = style.adjusted(
            lightness=arguments.lightness, saturation=arguments.saturation, warmth=arguments.warmth
        )  # fmt: skip
        files = style.save(output, add_light=arguments.add_light)
    for text in dict.fromkeys(str(w.message) for w in said):
        print(f"torchrender: warning: {text}", file=sys.stderr)
    for line in _report(style, arguments.list):
        print(line)
    for file in files:
        print(file)
    if sheet is not None:
        from torchrender.images.files import write_image
        from torchrender.photo.style.sheet import contact_sheet

        write_image(sheet, contact_sheet(style))
        print(sheet)


def _sheet_path(arguments: argparse.Namespace, output: Path) -> Path | None:
    if arguments.no_sheet:
        if arguments.sheet:
            raise OptionError("--sheet and --no-sheet exclude each other")
        return None
    sheet = Path(arguments.sheet) if arguments.sheet else beside(output, "sheet.png")
    check_output(sheet, SHEET_SUFFIXES)
    return sheet


def _options(arguments: argparse.Namespace) -> StyleOptions:
    from torchrender.photo.style.options import FitOptions, SearchOptions, StyleOptions

    width, height = image_size(arguments.size)
    for name in ("lightness", "saturation", "warmth"):
        if not -1.0 <= getattr(arguments, name) <= 1.0:
            raise OptionError(f"--{name} must be in [-1, 1], got {getattr(arguments, name)}")
    with named(prior_weight="--prior"):
        search = SearchOptions(prior_weight=arguments.prior)
    return StyleOptions(
        views=arguments.views,
        width=width,
        height=height,
        place="crop" if arguments.crop else "stretch",
        cut=arguments.by,
        keep_textures=arguments.keep_textures,
        seed=arguments.seed,
        fit=FitOptions(specular=not arguments.no_highlights),
        search=search,
    )


def _picks(words: Sequence[str]) -> dict[str, list[float]]:
    """Regions by object; names may hold equals signs themselves."""
    out = {}
    for word in words:
        name, equals, region = word.rpartition("=")
        if not equals or not name:
            raise OptionError(f"--pick must look like table=120,80,200,140, got {word!r}")
        out[name] = numbers(f"--pick {name}", region, 4)
    return out


def _report(style: Style, every: bool) -> list[str]:
    before, after, problem = style.before, style.after, style.problem
    share = float(style.candidates.valid.float().mean())
    times = "  ".join(f"{stage} {ms:.0f} ms" for stage, ms in style.timings_ms.items())
    lines = [
        f"{len(style.names)} objects  {len(problem.views)} views  {100 * share:.0f} % of candidates usable",
        f"cost {before.total:.3f} to {after.total:.3f}  (histograms {before.histogram:.3f} to {after.histogram:.3f})"
        f"  {style.result.iterations} moves",
        times,
    ]
    if problem.objects.kept:
        kept = ", ".join(problem.objects.kept[:_LISTED]) + (" ..." if len(problem.objects.kept) > _LISTED else "")
        lines.append(f"light sources keep their material: {kept}")
    if every:
        from torchrender.numerics.color import srgb_from_linear
        from torchrender.photo.style.finish import albedo

        colors = (srgb_from_linear(albedo(style.materials, problem.cosine)) * 255).round().int().tolist()
        unseen = set(style.unseen)
        for index, (name, (r, g, b)) in enumerate(zip(style.names, colors, strict=True)):
            note = "  kept" if index in style.kept else "  not seen" if name in unseen else ""
            lines.append(f"#{index:<4d} #{r:02x}{g:02x}{b:02x}  {name}{note}")
    return lines


class _Bar:
    """Progress on stderr: one bar for the stages, which names the one that runs."""

    STAGES = ("views", "fit", "tables", "search")

    def __init__(self) -> None:
        from tqdm import tqdm

        self._bar = tqdm(total=len(self.STAGES), file=sys.stderr, unit="stage", leave=False)

    @classmethod
    def when_watched(cls) -> Callable[[str, int], None] | None:
        """A callback, if somebody is watching."""
        return cls() if sys.stderr.isatty() else None

    def __call__(self, stage: str, count: int) -> None:
        done = self.STAGES.index(stage)
        self._bar.n = done
        self._bar.set_description(f"{stage} {count}" if stage == "search" else stage)
        self._bar.refresh()
