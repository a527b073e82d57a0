"""The commands ``plan``, ``tradeoff`` and ``calibrate``: what a picture would do and cost, and how that is known."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import add_size, given, named
from torchrender.cli.output import check_file, check_folder, collect_garbage, image_size, make_folder
from torchrender.errors import ImageFileError, InputError, OptionError

if TYPE_CHECKING:
    from torchrender.planning.plan import Plan
    from torchrender.scene.camera import Cameras
    from torchrender.scene.model import Scene

FindCamera = Callable[["Scene", Sequence[str], int, int], "Cameras"]


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Budget and error bound of a picture."""
    parser.add_argument(
        "--budget-ms",
        type=float,
        metavar="MS",
        help="time that the picture may take; it goes before --max-error where not both can be kept",
    )
    parser.add_argument(
        "--max-error",
        type=float,
        metavar="FLIP",
        help="mean FLIP, in [0,1], that it may be away from the reference; alone: the quickest picture within it",
    )


def say_missed(plan: Plan | None) -> None:
    """One line about a picture whose budget or error bound could not be kept, or whose budget was not."""
    from torchrender.pipeline.pace import TOLERANCE

    if plan is None:
        return
    told = "" if plan.possible else plan.statement
    budget, taken = plan.budget_ms, plan.measured_ms
    if not told and budget is not None and taken is not None and taken > TOLERANCE * budget:
        told = f"the picture took {taken:.0f} ms, its budget was {budget:g} ms"
        told += f" ({plan.note})" if plan.note else ""
    if told:
        sys.stderr.write(f"torchrender: {told}\n")


def add_plan(commands: Any, add_scene: Callable[[argparse.ArgumentParser], None]) -> None:
    """Describe the commands to the parser."""
    plan = commands.add_parser("plan", help="show which passes a picture takes and why, and what they would cost")
    add_scene(plan)
    plan.add_argument("--camera", nargs="+", metavar="CAMERA", help="as for render")
    add_size(plan)
    plan.add_argument("--sequence", action="store_true", help="as one of a sequence of pictures")
    plan.add_argument("--json", action="store_true", help="print JSON")
    add_limits(plan)
    tradeoff = commands.add_parser(
        "tradeoff",
        help="measure error against time of the settings of passes and systems",
        description="Measures error against time of every setting of passes, and of systems that are no pass: sampling "
        "by depth images, reconstruction, reprojection, voxels, points, light of environments. What the page in FOLDER "
        "holds of others stays.",
    )
    tradeoff.add_argument("scene", nargs="?", metavar="SCENE", help="a scene or mesh file, or a built-in scene")
    tradeoff.add_argument("--triangles", type=int, metavar="N", help="size of a built-in scene, in triangles (about)")
    tradeoff.add_argument("--pass", dest="step", metavar="PASS", help="one pass or system (default: all that apply)")
    tradeoff.add_argument("--all", action="store_true", help="all built-in scenes, and one HTML page of them")
    tradeoff.add_argument("--side", type=int, metavar="N", help="pixels of a side (default 512)")
    tradeoff.add_argument(
        "--seconds", type=float, metavar="S", help="begin no pass after so long; run it again to go on"
    )
    tradeoff.add_argument("-o", "--output", default="docs/results", metavar="FOLDER", help="default docs/results")
    calibrate = commands.add_parser("calibrate", help="measure the curves that budgets rely on, on this machine")
    calibrate.add_argument("scenes", nargs="*", metavar="SCENE", help="default: all built-in scenes")
    calibrate.add_argument("--errors", action="store_true", help="measure errors, too, where they are known")
    calibrate.add_argument("--side", type=int, metavar="N", help="pixels of a side (default 512)")
    calibrate.add_argument("-o", "--output", metavar="FILE", help="JSON file (default: where render looks for it)")


def run_plan(arguments: argparse.Namespace, scene: Scene, find_camera: FindCamera) -> str:
    """Text of the command ``plan``."""
    from torchrender.pipeline.history import RenderHistory
    from torchrender.planning.planner import plan

    width, height = image_size(arguments.size)
    made = plan(
        scene,
        find_camera(scene, arguments.camera or [], width, height),
        history=RenderHistory() if arguments.sequence else None,
        budget_ms=arguments.budget_ms,
        max_error=arguments.max_error,
    )
    return json.dumps(made.to_dict(), indent=1) if arguments.json else str(made)


def run_tradeoff(arguments: argparse.Namespace) -> list[Path]:
    """Measure and write; the files."""
    from torchrender.report.common.parts import Unfinished, parts_of
    from torchrender.scene.load import load
    from torchrender.scene.procedural import SCENES
    from torchrender.tuning.measure import SIDE
    from torchrender.tuning.tradeoff import measure, subjects_named, write
    from torchrender.tuning.tradeoff_page import earlier_curves, write_page

    if arguments.all == (arguments.scene is not None):
        raise InputError("tradeoff needs a SCENE, or --all")
    if arguments.seconds is not None and not arguments.seconds >= 0.0:
        raise OptionError(f"--seconds must be >= 0, got {arguments.seconds}")
    subjects_named(arguments.step)
    size = SIDE if arguments.side is None else arguments.side
    if not 32 <= size <= 4096:
        raise InputError(f"--side must be in [32, 4096], got {size}")
    folder = Path(arguments.output)
    page = folder / "tradeoff.html"
    found = earlier_curves(page, size)
    check_folder(folder)
    files = []
    parts = parts_of("tradeoff", arguments.seconds)
    collect_garbage()
    for name in SCENES if arguments.all else (arguments.scene,):
        with named(size="--triangles"):
            scene = load(name, size=arguments.triangles)
        try:
            curves = measure(scene, size=size, name=arguments.step, pictures=True, kept=parts.measured)
        except Unfinished as unfinished:
            raise InputError(f"--seconds: {unfinished}; run it again to go on") from None
        if arguments.step is not None and curves.name in found:
            curves = curves.beside(found[curves.name].passes)
        make_folder(folder)
        if curves.passes:
            files += write(folder, curves)
            found[curves.name] = curves
        tell(f"{name}: measured")
    write_page(page, list(found.values()))
    parts.done()
    return [*files, page]


def run_calibrate(arguments: argparse.Namespace) -> Path:
    """Measure and write the curves; the file."""
    from torchrender.images.files import write_atomically
    from torchrender.planning.curves import ENVIRONMENT, load_curves, parse_curves, user_file
    from torchrender.quality.pages import text_writer
    from torchrender.scene.load import load
    from torchrender.scene.procedural import SCENES
    from torchrender.scene.procedural.anything import anything
    from torchrender.tuning.calibrate import calibrate
    from torchrender.tuning.unseen import HELD_OUT, joint_of

    if arguments.side is not None and not 32 <= arguments.side <= 4096:
        raise InputError(f"--side must be in [32, 4096], got {arguments.side}")
    path = Path(arguments.output) if arguments.output else user_file()
    if arguments.output is None:
        make_folder(path.parent)
    elif path.suffix != ".json":
        raise ImageFileError(path, "curves are written to a .json file")
    check_file(path)
    scenes = [load(name) for name in arguments.scenes or SCENES]
    known = None if arguments.errors else load_curves()
    collect_garbage()
    curves = calibrate(scenes, **given(size=arguments.side), known=known, tell=tell)
    parse_curves(curves, str(path))
    write_atomically(path, text_writer(json.dumps(curves, separators=(",", ":")) + "\n"))
    if known is None:  # how errors of whole pictures compare with these curves
        os.environ[ENVIRONMENT] = str(path)
        curves["joint"] = joint_of(anything(seed) for seed in HELD_OUT)
        write_atomically(path, text_writer(json.dumps(curves, separators=(",", ":")) + "\n"))
    return path


def tell(line: str) -> None:
    """Progress, for who watches."""
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
