"""The command ``torchrender`` and its subcommands.

Everything heavy is imported inside functions, after the environment of the thread pools is set.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from torchrender import __version__
from torchrender.cli.arguments import (
    Parser,
    add_look,
    add_scene,
    add_size,
    camera_of,
    given,
    load_scene,
    numbers,
    say_option,
    say_unused,
    set_up_threads,
    shadows_and_exposure,
)
from torchrender.cli.batch import add_batch, batch_command
from torchrender.cli.files.depth import add_depth, depth_command
from torchrender.cli.files.kept import keep_inputs
from torchrender.cli.fly import add_fly, fly
from torchrender.cli.fog import add_fog, run_fog
from torchrender.cli.output import (
    Terminated,
    check_output,
    collect_garbage,
    ending_when_told,
    image_size,
    in_words,
    plain,
    progress,
    saying_warnings,
)
from torchrender.cli.plan import add_limits, add_plan, run_calibrate, run_plan, run_tradeoff, say_missed
from torchrender.cli.points import add_points, draws_points, point_info, run_points
from torchrender.cli.serve import add_load_test, add_serve, load_test_command, serve_command
from torchrender.cli.spheres import add_spheres, run_spheres
from torchrender.cli.style import add_style, run_style
from torchrender.cli.voxelize import add_voxelize, run_voxelize, voxel_info
from torchrender.cli.walkthrough import (
    add_walkthrough,
    is_walkthrough,
    render_walkthrough,
    run_walkthrough,
    walkthrough_info,
)
from torchrender.cli.warm_up import ColdStart, add_warm_up, warm_up_command
from torchrender.cli.wishes import add_enhance, add_scene_fog, enhance_wish, foggy, say_outside
from torchrender.errors import TorchRenderError
from torchrender.kernels.hooks import before_compiling

COLD = ColdStart()
"""What is told, and done side by side, when kernels are not compiled yet."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 2 wrong input (said in one line on stderr)."""
    arguments = _parser().parse_args(argv)
    try:
        set_up_threads(arguments.threads)
        COLD.start(arguments.command)
        keep_inputs(arguments)
        with ending_when_told(arguments.command), before_compiling(COLD), saying_warnings():
            try:
                _COMMANDS[arguments.command](arguments)
            finally:
                COLD.stop()
    except TorchRenderError as error:
        print(f"torchrender: error: {plain(say_option(error, arguments))}", file=sys.stderr)
        return 2
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "allocate memory" not in str(error):  # as torch says it
            raise
        print(f"torchrender: error: out of memory: {plain(str(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:
        told, code = ("terminated", 143) if isinstance(error, Terminated) else ("interrupted", 130)
        print(f"torchrender: {told}", file=sys.stderr)
        return code
    except BrokenPipeError:
        # The reader of our output is gone (for instance ``head``); keep Python from complaining at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return 0


# ------------------------------------------------------------------ commands


def _render(arguments: argparse.Namespace) -> None:
    if is_walkthrough(arguments.scene):
        render_walkthrough(arguments)
        return
    if draws_points(arguments):
        return
    reads_file = Path(arguments.scene).exists()
    if reads_file or not Path(arguments.scene).suffix:
        COLD.begin(reads_file=reads_file)
    from torchrender.image import SUFFIXES
    from torchrender.images.files import numbered
    from torchrender.pipeline.options import RenderOptions
    from torchrender.renderer import render

    output = Path(arguments.output)
    check_output(output, SUFFIXES)
    options = RenderOptions(
        **shadows_and_exposure(arguments),
        background=None if arguments.background is None else numbers("--background", arguments.background, 3),
        **given(reflections=arguments.reflections, supersample=arguments.supersample, tone_map=arguments.tone_map),
        **given(enhance=enhance_wish(arguments.enhance)),
    )
    width, height = image_size(arguments.size)
    scene = foggy(load_scene(arguments), arguments)
    if scene.photometric and arguments.exposure is None:
        print(f"{arguments.scene}: lights in candela and lux: exposure auto", file=sys.stderr)
        options = replace(options, exposure=None)
    cameras = [camera_of(scene, words, width, height) for words in arguments.camera or [[]]]
    say_outside(scene, cameras, arguments)
    COLD.plan = lambda: _planned(scene, cameras[0], options, arguments)
    if len(cameras) > 1:
        collect_garbage()
    for number, camera in enumerate(progress(cameras, "views")):
        image = render(scene, camera, options=options, budget_ms=arguments.budget_ms, max_error=arguments.max_error)
        file = numbered(output, number, len(cameras))
        image.save(file)
        steps = "  ".join(f"{step} {elapsed:.0f} ms" for step, elapsed in image.timings_ms.items())
        print(f"{file}  {width}x{height}  {scene.geometry.triangle_count:,} triangles  {steps}")
        if arguments.explain:
            print(image.plan)
        else:
            say_missed(image.plan)


def _planned(scene: Any, camera: Any, options: Any, arguments: argparse.Namespace) -> list[str]:
    """Names of the passes that a picture will run, and of what the scene needs from the kernel that shades."""
    from torchrender.planning.planner import plan
    from torchrender.shading.needs import shading_needs

    made = plan(scene, camera, options=options, budget_ms=arguments.budget_ms, max_error=arguments.max_error)
    return [*(row.name for row in made.running), *shading_needs(scene)]


def _plan(arguments: argparse.Namespace) -> None:
    print(run_plan(arguments, load_scene(arguments), camera_of))


def _tradeoff(arguments: argparse.Namespace) -> None:
    for file in run_tradeoff(arguments):
        print(file)


def _calibrate(arguments: argparse.Namespace) -> None:
    print(run_calibrate(arguments))


def _info(arguments: argparse.Namespace) -> None:
    from torchrender.scene.info import scene_info

    name = arguments.scene
    drop = arguments.drop_invalid
    info = voxel_info(name) if name.endswith(".npz") else walkthrough_info(name) or point_info(name, drop_invalid=drop)
    if info:
        say_unused(arguments, ("json", "drop_invalid") if name.endswith(".ply") else ("json",), f"{name}, no scene")
    info = info or scene_info(load_scene(arguments))
    if arguments.json:
        print(json.dumps(info, indent=2))
        return
    warnings = info.pop("warnings", [])
    for key, value in info.items():
        print(f"{key.replace('_', ' '):22s} {in_words(value)}")
    for warning in warnings:
        print(f"warning: {warning}")


def _voxelize(arguments: argparse.Namespace) -> None:
    run_voxelize(arguments, image_size(arguments.size))


def _points(arguments: argparse.Namespace) -> None:
    background = numbers("--background", arguments.background, 3)
    for line in run_points(arguments, image_size(arguments.size), background, camera_of):
        print(line)


def _scenes(arguments: argparse.Namespace) -> None:
    from torchrender.scene.procedural import SCENES

    del arguments
    for name, builder in SCENES.items():
        print(f"{name:14s} {builder.usual:>9,} triangles (at least {builder.fewest:,})")


_COMMANDS = {
    "render": _render,
    "batch": batch_command,
    "fly": fly,
    "plan": _plan,
    "tradeoff": _tradeoff,
    "calibrate": _calibrate,
    "info": _info,
    "depth": depth_command,
    "voxelize": _voxelize,
    "points": _points,
    "spheres": run_spheres,
    "fog": run_fog,
    "style": run_style,
    "walkthrough": run_walkthrough,
    "scenes": _scenes,
    "serve": serve_command,
    "load-test": load_test_command,
    "warm-up": warm_up_command,
}

# ----------------------------------------------------------------- arguments


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="torchrender", description="Real-time approximation of complex 3D scenes by depth images, on the CPU."
    )
    parser.add_argument("--version", action="version", version=f"torchrender {__version__}")
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads to use (default: all)")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_render(commands.add_parser("render", help="render a scene to a PNG, EXR or NPZ file"))
    add_fly(commands)
    add_plan(commands, add_scene)
    info = commands.add_parser("info", help="show what a scene, a cloud of points or a voxel file holds")
    add_scene(info)
    info.add_argument("--json", action="store_true", help="print JSON")
    add_depth(commands)
    add_voxelize(commands.add_parser("voxelize", help="write a model as voxels, or a picture of them"))
    add_points(commands.add_parser("points", help="draw or compress a cloud of points"))
    add_batch(commands)
    add_spheres(commands)
    add_style(commands)
    add_fog(commands)
    add_walkthrough(commands)
    commands.add_parser("scenes", help="list the built-in scenes")
    add_serve(commands)
    add_load_test(commands)
    add_warm_up(commands)
    return parser


def _add_render(parser: argparse.ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="picture to write: .png, .exr or .npz")
    parser.add_argument(
        "--camera",
        nargs="+",
        action="append",
        metavar="CAMERA",
        help="name of one of the scene's cameras, or eye=x,y,z [target=x,y,z] [up=x,y,z] [fov=DEGREES] [near=Z];"
        " give it several times for several pictures",
    )
    add_size(parser)
    add_limits(parser)
    add_scene_fog(parser)
    parser.add_argument("--explain", action="store_true", help="say which passes ran, which did not, and why")
    add_enhance(parser)
    add_look(parser)
