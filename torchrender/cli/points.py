"""The subcommand ``torchrender points``: draws point models, and compresses them."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import add_display, add_size, camera_of, exposure, named, numbers, say_idle, say_unused
from torchrender.cli.output import check_output, image_size, sharing, waiting
from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torchrender.points.cloud import PointCloud
    from torchrender.points.options import PointImage, SplatOptions
    from torchrender.points.tree import PatchSet
    from torchrender.scene.camera import Cameras

COMPRESSED = ".trp"
LARGE = 256_000_000
"""Bytes of a file of points from which on it is not read as a whole."""

DISPLAY = ("exposure", "tone_map")
PICTURE = ("filter", "radius", "two_sided", "background", "camera", "size", *DISPLAY)
"""Options of pictures alone."""

CameraOf = Callable[[Any, list[str], int, int], "Cameras"]


def add_points(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("cloud", metavar="CLOUD", help="points (.ply, .trp), or a mesh or scene, which is sampled")
    parser.add_argument(
        "-o", "--output", required=True, metavar="FILE", help="picture (.png, .exr) or compressed points (.trp)"
    )
    parser.add_argument("--drop-invalid", action="store_true", help="leave points that are NaN or infinite out")
    parser.add_argument(
        "--memory",
        type=float,
        metavar="MB",
        help="pack the points on disk within that much memory; files of 256 MB and more always are (default 1024)",
    )
    parser.add_argument("--samples", type=int, metavar="N", help="points to sample a mesh by (default 1,000,000)")
    parser.add_argument(
        "--filter",
        choices=("adaptive", "full", "reconstruction", "low_pass", "squares"),
        default="adaptive",
        help="the cheapest EWA filter that is good enough, always one of them, or opaque squares (default adaptive)",
    )
    parser.add_argument("--radius", type=float, metavar="PX", help="greatest radius of a drawn point (default 2)")
    parser.add_argument("--two-sided", action="store_true", help="draw points seen from behind, too")
    parser.add_argument("--background", default="0,0,0", metavar="R,G,B", help="linear colour of empty pixels")
    parser.add_argument("--camera", nargs="+", metavar="CAMERA", help="as for render")
    add_size(parser)
    add_display(parser)


def run_points(
    arguments: argparse.Namespace, size: tuple[int, int], background: list[float], camera_of: CameraOf
) -> Iterator[str]:
    """Draw or compress; yields a line about what was written."""
    output = Path(arguments.output)
    check_output(output, (".png", ".exr", COMPRESSED))
    from torchrender.points.file import open_points, write_points
    from torchrender.points.tree import PatchSet

    source, kind = Path(arguments.cloud), output.suffix.lower()
    say_idle(arguments, {COMPRESSED: PICTURE, ".exr": DISPLAY}.get(kind, ()), f"{kind} files")
    large = _is_large(source, arguments.memory)
    if source.suffix.lower() == COMPRESSED:
        say_idle(arguments, ("drop_invalid", "memory"), f"points of {COMPRESSED} files")
    elif not large:
        say_idle(arguments, ("memory",), "what is no PLY file of points")
    if kind == COMPRESSED:
        if large:
            written, count = _pack(source, output, arguments), open_points(output).point_count
            yield f"{output}  {count:,} points  {written:,} bytes  {written / count:.1f} a point, tree included"
            return
        patches = _patches(arguments)
        if not isinstance(patches, PatchSet):
            raise OptionError(f"{COMPRESSED} files hold opaque discs: {arguments.cloud} has opacity or ellipsoids")
        written = write_points(output, patches)
        share = written / patches.point_count
        yield f"{output}  {patches.point_count:,} points  {written:,} bytes  {share:.1f} a point, tree included"
        return
    from torchrender.points.draw import render_points

    options = _options(arguments, background)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        if large:
            packed = Path(folder) / f"{source.stem}{COMPRESSED}"
            _pack(source, packed, arguments)
            model: Any = open_points(packed)
        else:
            model = _patches(arguments)
            if not isinstance(model, PatchSet):
                say_idle(arguments, ("filter", "radius", "two_sided"), "ellipsoids and points that let light through")
        camera = camera_of(model, arguments.camera or [], *size)
        drawn = render_points(model, camera, options)
        found = drawn.statistics[0]
        if not found.drawn and (found.back or found.patches_back) and not arguments.camera:
            sys.stderr.write(f"{source}: all points face away: drawn from both sides\n")
            drawn = render_points(model, camera, replace(options, two_sided=True))
        del model  # closes the file
    _displayed(drawn, arguments, deep=output.suffix.lower() == ".exr").save(output)
    found = drawn.statistics[0]
    steps = "  ".join(f"{step} {elapsed:.0f} ms" for step, elapsed in found.ms.items())
    yield f"{output}  {size[0]}x{size[1]}  {found.points:,} points, {found.drawn:,} drawn  {steps}"


def _displayed(drawn: PointImage, arguments: argparse.Namespace, *, deep: bool) -> PointImage:
    """The pictures as a display shows them, exposed and tone mapped; those of ``deep`` files stay light as it is."""
    from torchrender.numerics.tonemap import auto_exposure, tone_map

    if deep:
        return drawn
    ev = 0.0 if arguments.exposure is None else exposure(arguments.exposure)
    if ev is None:
        ev = auto_exposure(drawn.image, mask=drawn.mask if bool(drawn.mask.any()) else None)
    with named(exposure="--exposure"):
        shown = tone_map(drawn.image, arguments.tone_map or "none", exposure=ev)
    return replace(drawn, image=shown)


def _options(arguments: argparse.Namespace, background: list[float]) -> SplatOptions:
    """How the command line wants points to be drawn."""
    from torchrender.points.options import SplatOptions
    from torchrender.points.select import SelectionOptions

    selection = SelectionOptions()
    if arguments.radius is not None:  # the finer one keeps its ratio, within its range
        ratio = selection.fine_radius / selection.coarse_radius
        fine = max(0.3, min(2.0, ratio * arguments.radius))
        with named(coarse_radius="--radius"):
            selection = replace(selection, coarse_radius=arguments.radius, fine_radius=fine)
    return SplatOptions(
        filter=arguments.filter,
        selection=selection,
        two_sided=True if arguments.two_sided else None,
        background=(background[0], background[1], background[2]),
    )


def draws_points(arguments: argparse.Namespace) -> bool:
    """Draw a file of points that was given to ``render``; False where it is none."""
    path = Path(arguments.scene)
    if not path.suffix:
        return False  # a built-in scene
    from torchrender.points.load import holds_points

    if path.suffix.lower() != COMPRESSED and not holds_points(path):
        return False
    sys.stderr.write(f"{path}: holds points: drawn as by the command points\n")
    known = ("output", "camera", "size", "background", "exposure", "tone_map", "drop_invalid")
    say_unused(arguments, known, "points")
    if len(arguments.camera or []) > 1:
        raise OptionError("points are drawn for one --camera at a time")
    like = argparse.Namespace(
        cloud=arguments.scene,
        output=arguments.output,
        samples=None,
        filter="adaptive",
        memory=None,
        radius=None,
        two_sided=False,
        camera=(arguments.camera or [None])[0],
        drop_invalid=arguments.drop_invalid,
        exposure=arguments.exposure,
        tone_map=arguments.tone_map,
        given_options={name: option for name, option in arguments.given_options.items() if name in known},
    )
    background = numbers("--background", arguments.background or "0,0,0", 3)
    for line in run_points(like, image_size(arguments.size), background, camera_of):
        sys.stdout.write(line + "\n")
    return True


def _patches(arguments: argparse.Namespace) -> PatchSet | PointCloud:
    from torchrender.points.file import open_points
    from torchrender.points.gaussians import is_blended
    from torchrender.points.load import load_points
    from torchrender.points.tree import build_patches

    if Path(arguments.cloud).suffix.lower() == COMPRESSED:
        if arguments.samples is not None:
            raise OptionError("--samples is for meshes only")
        return open_points(arguments.cloud)
    with waiting(f"reading {arguments.cloud}"):
        cloud = load_points(arguments.cloud, samples=arguments.samples, drop_invalid=arguments.drop_invalid)
        return cloud if is_blended(cloud) else build_patches(cloud)


def _is_large(path: Path, memory_mb: float | None) -> bool:
    """Whether a file of points is packed on disk, not read as a whole."""
    if path.suffix.lower() != ".ply" or not path.is_file() or (memory_mb is None and path.stat().st_size < LARGE):
        return False
    from torchrender.points.load import holds_points

    return holds_points(path)


def _pack(source: Path, target: Path, arguments: argparse.Namespace) -> int:
    from torchrender.points.pack import PackOptions, pack_points

    memory = PackOptions.memory_mb if arguments.memory is None else arguments.memory
    if arguments.samples is not None:
        raise OptionError("--samples is for meshes only")
    with named(memory_mb="--memory"):
        options = PackOptions(memory_mb=memory, drop_invalid=arguments.drop_invalid)
    with sharing(str(source)) as show:
        return pack_points(source, target, options, progress=show)


def point_info(name: str, *, drop_invalid: bool = False) -> dict[str, Any] | None:
    """What a file of points holds, as plain values; None for anything else."""
    path = Path(name)
    if path.suffix.lower() == COMPRESSED:
        from torchrender.points.file import open_points

        patches = open_points(path)
        headers = patches.headers
        return {
            "name": patches.name,
            "points": patches.point_count,
            "patches": len(headers),
            "levels": headers.levels,
            "nodes": len(patches.nodes),
            "bytes_per_node": patches.nodes.node_bytes,
            "bytes": path.stat().st_size,
            "colors": patches.nodes.has_color,
            "two_sided": patches.two_sided,
            "radius": [float(headers.radius[:, -1, 0].min()), float(headers.radius[:, -1, 2].max())],
            "bounds": patches.bounds.tolist(),
            "diagonal": patches.diagonal,
        }
    from torchrender.points.load import holds_points, load_points

    if not holds_points(path):
        return None
    if _is_large(path, None):
        return _survey_info(path)
    cloud = load_points(path, drop_invalid=drop_invalid)
    size = cloud.radius
    if cloud.spread is not None:
        size = cloud.spread.diagonal(dim1=1, dim2=2).amax(1).sqrt()
    assert size is not None
    return {
        "name": cloud.name,
        "points": len(cloud),
        "gaussians": cloud.spread is not None,
        "colors": cloud.color is not None,
        "opacity": cloud.opacity is not None,
        "two_sided": cloud.two_sided,
        "radius": [float(size.min()), float(size.max())],
        "bounds": cloud.bounds.tolist(),
        "diagonal": cloud.diagonal,
    }


def _survey_info(path: Path) -> dict[str, Any]:
    """What one look through a large file tells."""
    from torchrender.points.pieces import PointPieces

    pieces = PointPieces(path)
    with waiting(f"reading {path}"):
        survey = pieces.survey(1)
    return {
        "name": path.stem,
        "points": survey.count,
        "invalid": survey.invalid,
        "bytes": path.stat().st_size,
        "colors": pieces.has_color,
        "normals": pieces.has_normals,
        "bounds": survey.bounds.tolist(),
        "diagonal": float(((survey.bounds[1] - survey.bounds[0]) ** 2).sum() ** 0.5),
    }
