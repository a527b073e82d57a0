"""The command ``torchrender fly``: pictures along a camera path, each with what the one before it left to reuse."""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import (
    add_scene,
    add_size,
    given,
    load_scene,
    named,
    named_or_numbered,
    numbers,
    say_unused,
)
from torchrender.cli.files.kept import beside
from torchrender.cli.output import check_file, check_folder, check_output, collect_garbage, image_size, progress
from torchrender.cli.walkthrough import fly_pictures, is_walkthrough
from torchrender.errors import ImageFileError, InputError, OptionError

if TYPE_CHECKING:
    from torch import Tensor

    from torchrender.image import Image
    from torchrender.scene.cameras.path import CameraPath
    from torchrender.scene.model import Scene

FEW = 60
"""Frames of a plot that are drawn as points, too."""
LONG = 4.0
"""Times the usual frame from which on a plot of times is logarithmic."""


def add_fly(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("fly", help="render a camera path, reusing reflections, to a film or a folder")
    add_scene(parser)
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help="film.mp4, .avi or .gif, with film_statistics.json and, where matplotlib is, film_statistics.png; or a"
        " folder for frame_0000.png ... and statistics.json, statistics.png, where frames of an earlier flight go",
    )
    parser.add_argument(
        "--path",
        default="",
        metavar="PATH",
        help="walk1 or walk2 (rooms), orbit, or a TOML or JSON file of poses (default: walk1, else orbit)",
    )
    parser.add_argument("--frames", type=int, default=240, metavar="N", help="number of pictures (default 240)")
    parser.add_argument("--fps", type=float, default=30.0, help="pictures per second of a film (default 30)")
    add_size(parser, "512x512")
    parser.add_argument("--seed", type=int, default=0, help="variation of a walk (default 0: none)")
    parser.add_argument("--threshold", type=float, help="share traced anew that asks for a key frame (default 0.3)")
    parser.add_argument(
        "--animate", action="store_true", help="play the scene's animation, at its own speed and again from its start"
    )
    parser.add_argument(
        "--move",
        action="append",
        default=[],
        metavar="NAME=X,Y,Z[,TURN]",
        help="move an object by so much over the film, and turn it by degrees; or NAME=PATH.toml; may be repeated",
    )
    parser.add_argument("--no-reuse", action="store_true", help="every picture from nothing, for comparison")


def fly(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from torchrender.effects.reflections.reuse_options import ReuseOptions
    from torchrender.images.film import FILMS
    from torchrender.pipeline.history import RenderHistory
    from torchrender.pipeline.options import RenderOptions
    from torchrender.renderer import render

    output = Path(arguments.output)
    if not 1.0 <= arguments.fps <= 240.0:
        raise OptionError(f"--fps must be in [1, 240], got {arguments.fps}")
    if arguments.frames < 1:
        raise OptionError(f"--frames must be >= 1, got {arguments.frames}")
    if output.suffix:
        check_output(output, FILMS)
        check_file(beside(output, "statistics.json"))
    else:
        check_folder(output)
        _check_own(output, arguments.frames)
    width, height = image_size(arguments.size)
    if is_walkthrough(arguments.scene):
        say_unused(arguments, ("output", "path", "frames", "fps", "size"), "a walkthrough")
        _fly_walkthrough(arguments, (width, height))
        return
    with named(key_frame_threshold="--threshold"):
        options = RenderOptions(reuse=ReuseOptions(**given(key_frame_threshold=arguments.threshold)))
    scene = load_scene(arguments)
    times = _times(scene, arguments)
    moves = _moves(scene, arguments)
    collect_garbage()
    path = _path(scene, arguments.path, arguments.seed)
    cameras = path.cameras(arguments.frames, width=width, height=height, near=1e-3 * (scene.diagonal or 1.0))
    history = None if arguments.no_reuse else RenderHistory()
    records: list[dict[str, Any]] = []

    def pictures() -> Iterator[Tensor]:
        nonlocal history
        for number in progress(range(len(cameras)), "frames"):
            begin = perf_counter()
            now = scene if times is None else scene.at(times[number], named_or_numbered(arguments.animation))
            for name, matrices in moves:
                now = now.moved(name, matrices[number])
            moved = 1e3 * (perf_counter() - begin)
            image = render(now, cameras[number], options=options, history=history)
            history = image.history
            records.append(
                _record(number, image) | ({"moved_ms": round(moved, 2)} if moves or times is not None else {})
            )
            yield image.displayed()[0]

    _write(output, pictures(), records, arguments)


def _fly_walkthrough(arguments: argparse.Namespace, size: tuple[int, int]) -> None:
    """A flight through planes and points from photos."""
    records: list[dict[str, Any]] = []

    def pictures() -> Iterator[Tensor]:
        for picture, record in fly_pictures(arguments, size):
            records.append(record)
            yield picture

    _write(Path(arguments.output), pictures(), records, arguments)


def _write(
    output: Path, pictures: Iterator[Tensor], records: list[dict[str, Any]], arguments: argparse.Namespace
) -> None:
    """The film and its statistics; ``records`` fills while it is drawn."""
    from torchrender.images.film import write_film

    if not output.suffix:
        pictures = _clearing(output, pictures, arguments.frames)
    files = write_film(output, pictures, arguments.fps)
    files += _write_statistics(output, records)
    for line in (*(str(f) for f in files[-3:]), _summary(records)):
        sys.stdout.write(line + "\n")


def _clearing(folder: Path, pictures: Iterator[Tensor], count: int) -> Iterator[Tensor]:
    """Once there is a frame, take away what an earlier, longer flight left: its statistics tell how many frames.

    Those of this one stand for its frames until they are all there.
    """
    from torchrender.images.files import write_bytes
    from torchrender.images.film import frame_name

    for number, picture in enumerate(pictures):
        yield picture
        if number == 0:
            statistics = beside(folder, "statistics.json")
            for earlier in range(count, _frames_of(statistics)):
                (folder / frame_name(earlier)).unlink(missing_ok=True)
            write_bytes(statistics, json.dumps([{"frame": one} for one in range(count)]).encode())


def _check_own(folder: Path, count: int) -> None:
    """Refuse a folder whose frames or statistics no flight made, as a folder of photos.

    Raises:
        ImageFileError: names the first.
    """
    from torchrender.images.film import frame_name

    statistics = beside(folder, "statistics.json")
    own = _frames_of(statistics)
    others = [folder / frame_name(number) for number in range(own, count)] + ([] if own else [statistics])
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    for path in others:
        if path.name in there:
            raise ImageFileError(path, "is there, and no flight made it: give another folder")


def _frames_of(statistics: Path) -> int:
    """How many frames statistics of an earlier flight are of; none where there are no such."""
    try:
        records = json.loads(statistics.read_text())
        return len(records) if [r["frame"] for r in records] == list(range(len(records))) else 0
    except (OSError, ValueError, LookupError, TypeError):
        return 0


def _times(scene: Scene, arguments: argparse.Namespace) -> list[float] | None:
    """Seconds into the animation of each picture; None where nothing is to move."""
    if not arguments.animate:
        return None
    if not scene.animations:
        raise InputError(f"--animate: {arguments.scene} has no animation")
    chosen = named_or_numbered(arguments.animation)
    durations = [m.animation(chosen) for m in scene.motions if m.animations]
    length = max((a.duration for a in durations if a is not None), default=0.0)
    start = arguments.time or 0.0
    steps = (start + number / arguments.fps for number in range(arguments.frames))
    return [step % length if length > 0 else 0.0 for step in steps]


def _moves(scene: Scene, arguments: argparse.Namespace) -> list[tuple[str, Tensor]]:
    """Names of objects and their matrices (frames,4,4), from where they stand at the start."""
    from torchrender.scene.model import Scene
    from torchrender.scene.motion.along import load_object_path, straight

    found = []
    for text in arguments.move:
        name, sign, way = text.partition("=")
        if not sign or not name:
            raise OptionError(f"--move must look like NAME=X,Y,Z[,TURN] or NAME=PATH.toml, got {text!r}")
        if Path(way).suffix.lower() in (".toml", ".json"):
            path = load_object_path(way)
        else:
            words = numbers("--move", way, 4 if way.count(",") == 3 else 3)
            path = straight(words[:3], *words[3:])
        bounds = Scene(meshes=scene.parts(name), materials=scene.materials).bounds
        found.append((name, path.matrices(arguments.frames, bounds)))
    return found


def _path(scene: Scene, name: str, seed: int) -> CameraPath:
    from torchrender.scene.cameras.path import built_in_path, load_path, walks_of

    if Path(name).suffix.lower() in (".toml", ".json"):
        return load_path(name)
    return built_in_path(scene, name or (*walks_of(scene), "orbit")[0], seed)


def _record(number: int, image: Image) -> dict[str, Any]:
    """What a picture cost, for the statistics."""
    from torchrender.passes.mirrors.key_frame import reuse_report

    record: dict[str, Any] = {"frame": number, "ms": round(image.timings_ms["total"], 2)}
    record["steps_ms"] = {k: round(v, 2) for k, v in image.timings_ms.items() if k != "total"}
    report = reuse_report(image.history)
    if report is not None:
        record |= {
            "key_frame": report.key_frame,
            "reflective": report.reflective,
            "reused_share": round(1.0 - report.traced_share, 4),
            "search_steps": round(report.search_steps, 3),
            "matches": dict(report.matches),
            "pixels": dict(report.pixels),
            "reflection_ms": {k: round(v, 2) for k, v in report.times_ms.items()},
        }
    return record


def _summary(records: list[dict[str, Any]]) -> str:
    mean = sum(r["ms"] for r in records) / len(records)
    line = f"{len(records)} frames, {mean:.0f} ms each"
    reused = [r for r in records if r.get("reflective")]
    if reused:
        keys = sum(r["key_frame"] for r in reused)
        share = sum(r["reused_share"] for r in reused) / len(reused)
        line += f"; {100 * share:.0f} % of reflective pixels reused, {keys} key frames"
    return line


def _write_statistics(output: Path, records: list[dict[str, Any]]) -> list[Path]:
    """Statistics of every frame as JSON, and as a plot where matplotlib is installed."""
    from torchrender.images.files import write_atomically

    described, plot = beside(output, "statistics.json"), beside(output, "statistics.png")
    text = json.dumps(records, indent=1) + "\n"

    def write(path: Path) -> None:
        path.write_text(text)

    write_atomically(described, write)
    if importlib.util.find_spec("matplotlib") is None:
        return [described]
    write_atomically(plot, lambda path: _plot(path, records))
    return [described, plot]


def _plot(path: Path, records: list[dict[str, Any]]) -> None:
    from matplotlib.figure import Figure

    mirrors = [r for r in records if "reused_share" in r]
    figure = Figure(figsize=(8, 4.5 if mirrors else 2.6), layout="constrained")
    top, *below = figure.subplots(2 if mirrors else 1, 1, sharex=True, squeeze=False)[:, 0]
    marker = "." if len(records) <= FEW else None
    times = [r["ms"] for r in records]
    top.plot([r["frame"] for r in records], times, color="0.2", marker=marker)
    top.set_ylabel("ms")
    usual = sorted(times)[len(times) // 2]
    if max(times) > LONG * usual > 0:  # the first picture prepares the scene: a plain axis would hide the others
        top.set_yscale("log")
    else:
        top.set_ylim(0, 1.1 * max(max(times), 1e-3))
    if below:
        bottom = below[0]
        reused = [100 * r["reused_share"] for r in mirrors]
        bottom.plot([r["frame"] for r in mirrors], reused, color="tab:blue", marker=marker)
        for r in mirrors:
            if r["key_frame"]:
                bottom.axvline(r["frame"], color="tab:red", linewidth=0.8)
        bottom.set_ylabel("reused, % (red: key frames)")
        bottom.set_ylim(-3, 103)
    lowest = (below or [top])[0]
    lowest.set_xlabel("frame")
    lowest.xaxis.get_major_locator().set_params(integer=True)
    figure.savefig(path, dpi=110)
