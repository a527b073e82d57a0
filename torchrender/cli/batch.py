"""The command ``torchrender batch``: pictures, depth images or a film of thousands of cameras, by several processes."""

from __future__ import annotations

import argparse
import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import (
    add_look,
    add_scene,
    add_size,
    exposure,
    given,
    load_scene,
    named,
    named_or_numbered,
    numbers,
)
from torchrender.cli.output import check_file, check_folder, image_size
from torchrender.errors import InputError, OptionError

if TYPE_CHECKING:
    from torchrender.batch.cameras import CameraRows

EVERY_S = 10.0
"""A line about progress where no terminal shows a bar."""
FRAMES = 240
"""Cameras along a path, where their number is not given."""
FILM = "film.mp4"
MOST_TOLD = 10
"""Bad rows that are written out; the others are counted."""


def add_batch(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("batch", help="pictures, depth images or a film of many cameras, by several processes")
    add_scene(parser)
    parser.add_argument(
        "-o", "--output", required=True, metavar="OUT", help="a folder; a batch that was stopped goes on"
    )
    of = parser.add_mutually_exclusive_group(required=True)
    of.add_argument("--cameras", metavar="FILE", help="JSON or JSON lines: a row for each camera, or transforms.json")
    of.add_argument("--orbit", type=int, metavar="N", help="N cameras on a swing about the scene")
    of.add_argument("--path", metavar="PATH", help="walk1, walk2, orbit or a path file, with --frames")
    of.add_argument("--grid", metavar="XxYxZ", help="four views from each cell of a grid through the scene")
    parser.add_argument("--frames", type=int, metavar="N", help="cameras along --path (default 240)")
    parser.add_argument("--what", default="pictures", metavar="WHAT", help="pictures (default), depth or film")
    parser.add_argument("--format", default="", metavar="KIND", help="png (default), exr or npz; depth: npz")
    parser.add_argument("--shards", action="store_true", help="one tar file for each chunk, as WebDataset reads them")
    parser.add_argument("--outputs", metavar="NAMES", help="arrays of --what depth (default depth,normal,object_id)")
    parser.add_argument("--chunk", type=int, metavar="N", help="cameras that one process makes in a row (default 32)")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: one for each core)")
    parser.add_argument("--ray", metavar="ADDRESS", help="on a Ray cluster: its address, or auto")
    parser.add_argument("--fps", type=float, help="pictures per second of --what film (default 30)")
    add_size(parser, "512x512")
    add_look(parser)


def batch_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from torchrender.batch.job import JOB, Job, SceneSource
    from torchrender.batch.local import run

    _check_together(arguments)
    output = Path(arguments.output)
    check_folder(output)
    if arguments.what == "film" and output.is_dir():
        check_file(output / FILM)
        if (output / FILM).exists() and not (output / JOB).exists():
            raise InputError(f"{output} holds {FILM} that no batch made: give another folder")
    rows = _cameras(arguments)
    if rows.not_used:
        sys.stderr.write(f"torchrender: warning: {arguments.cameras}: not used: {', '.join(rows.not_used)}\n")
    _say_bad(rows)
    choices = given(
        size=arguments.triangles,
        time=arguments.time,
        animation=named_or_numbered(arguments.animation),
        variant=arguments.variant,
        subscene=named_or_numbered(arguments.subscene),
        drop_invalid=arguments.drop_invalid or None,
    )
    outputs = None if arguments.outputs is None else tuple(filter(None, arguments.outputs.split(",")))
    with named(size="--shadow-size", outputs="--outputs"):
        job = Job(
            SceneSource(arguments.scene, choices),
            rows.cameras,
            rows.names,
            what=arguments.what,
            format=arguments.format,
            shards=arguments.shards,
            wishes=_wishes(arguments),
            **given(chunk=arguments.chunk, outputs=outputs),
        )
    progress = _Progress()
    begin = time.monotonic()
    with named(size="--triangles"):  # the scene is loaded there
        if arguments.ray is None:
            outcome = run(job, output, workers=arguments.workers, tell=progress)
        else:
            from torchrender.batch.on_ray import run_on_ray

            outcome = run_on_ray(job, output, address=arguments.ray, workers=arguments.workers, tell=progress)
    progress.end()
    took = time.monotonic() - begin
    rate = f", {outcome.made / took:.1f}/s" if outcome.made else ""
    print(f"{output}  {outcome.cameras} of {len(job.cameras)} cameras, {outcome.made} made in {took:.0f} s{rate}")
    if job.what == "film" and not outcome.failed:
        print(_film(output, job.names, 30.0 if arguments.fps is None else arguments.fps))
    _complain(rows, outcome.failed)


def _check_together(arguments: argparse.Namespace) -> None:
    """Refuse options that would do nothing with the others that were given."""
    what = arguments.what
    for option, value, needs, met in (
        ("--outputs", arguments.outputs, "--what depth", what == "depth"),
        ("--fps", arguments.fps, "--what film", what == "film"),
        ("--frames", arguments.frames, "--path", arguments.path is not None),
    ):
        if value is not None and not met:
            raise OptionError(f"{option} does nothing without {needs}")


def _cameras(arguments: argparse.Namespace) -> CameraRows:
    from torchrender.batch.cameras import CameraRows, check_count, grid_cameras, read_cameras
    from torchrender.scene.cameras.path import built_in_path, load_path

    for name in ("orbit", "frames"):
        if (count := getattr(arguments, name)) is not None and count < 1:
            raise OptionError(f"--{name} must be >= 1, got {count}")
        check_count(count or 0, f"--{name}")
    width, height = image_size(arguments.size)
    if arguments.cameras is not None:
        return read_cameras(arguments.cameras, width=width, height=height)
    scene = load_scene(arguments)
    if arguments.grid is not None:
        match = re.fullmatch(r"(\d{1,4})[xX](\d{1,4})[xX](\d{1,4})", arguments.grid.strip())
        if match is None:
            raise OptionError(f"--grid must look like 4x1x4, got {arguments.grid!r}")
        return grid_cameras(scene, (int(match[1]), int(match[2]), int(match[3])), width=width, height=height)
    name = arguments.path or "orbit"
    path = load_path(name) if Path(name).suffix.lower() in (".toml", ".json") else built_in_path(scene, name)
    count = arguments.orbit or arguments.frames or FRAMES
    cameras = path.cameras(count, width=width, height=height, near=1e-3 * (scene.diagonal or 1.0))
    return CameraRows(cameras, tuple(f"{number:06d}" for number in range(count)), (), ())


def _wishes(arguments: argparse.Namespace) -> dict[str, Any]:
    wishes = given(
        reflections=arguments.reflections,
        supersample=arguments.supersample,
        tone_map=arguments.tone_map,
        shadows="off" if arguments.no_shadows else arguments.shadows,
        shadow_size=arguments.shadow_size,
        cascades=arguments.cascades,
    )
    if arguments.exposure is not None:
        wishes["exposure"] = exposure(arguments.exposure)
    if arguments.background is not None:
        wishes["background"] = numbers("--background", arguments.background, 3)
    return wishes


def _film(folder: Path, names: tuple[str, ...], fps: float) -> Path:
    from torchrender.images.files import read_image
    from torchrender.images.film import write_film

    return write_film(folder / FILM, (read_image(folder / f"{name}.png") for name in names), fps)[0]


def _say_bad(rows: CameraRows) -> None:
    """Tell which rows are left out before the first picture is made, which may be hours before the last."""
    for line in rows.bad[:MOST_TOLD]:
        sys.stderr.write(f"torchrender: warning: left out: {line}\n")
    if len(rows.bad) > MOST_TOLD:
        sys.stderr.write(f"torchrender: warning: left out: {len(rows.bad) - MOST_TOLD} more rows\n")


def _complain(rows: CameraRows, failed: dict[int, str]) -> None:
    """Tell what is missing; the exit code is that of wrong input."""
    for chunk, why in list(failed.items())[:MOST_TOLD]:
        sys.stderr.write(f"torchrender: warning: chunk {chunk}: {why}\n")
    told = []
    if rows.bad:
        told.append(f"{len(rows.bad)} of {len(rows.bad) + len(rows.names)} rows were left out")
    if failed:
        told.append(f"{len(failed)} chunks could not be made; the same command tries them again")
    if told:
        raise InputError("; ".join(told))


class _Progress:
    """How many are done, the rate and the time left: a bar on a terminal, else a line now and then."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._first: tuple[float, int] | None = None
        self._said = 0.0

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if self._first is None:
            self._first, self._said = (now, done), now
        if sys.stderr.isatty():
            if self._bar is None:
                from tqdm import tqdm

                self._bar = tqdm(total=total, initial=done, desc="cameras", file=sys.stderr, leave=False)
            self._bar.update(done - self._bar.n)
        elif now - self._said >= EVERY_S:
            self._said = now
            rate = (done - self._first[1]) / (now - self._first[0])
            left = f", {(total - done) / rate:.0f} s left" if rate > 0 else ""
            sys.stderr.write(f"{done:,} of {total:,} cameras, {rate:.1f}/s{left}\n")

    def end(self) -> None:
        if self._bar is not None:
            self._bar.close()
