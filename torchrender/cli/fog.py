"""The command ``torchrender fog``: fog, smoke and shafts of light put into a photo."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import named, numbers
from torchrender.cli.output import check_output, saying_warnings
from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torch import Tensor

    from torchrender.photo.fog import FogMedium, FogOptions, Marks

SUFFIXES = (".png", ".exr")
DEPTH_SUFFIXES = (".exr", ".npz", ".png")
INDOOR, OUTDOOR = 0.08, 0.01
"""Usual scattering, 1/m."""


def add_fog(commands: Any) -> None:
    """Arguments of the command."""
    parser = commands.add_parser("fog", help="put fog, smoke or shafts of light into a photo")
    parser.add_argument("photo", help="picture; with --stereo, the left one is used if this is it")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="picture to write: .png or .exr")
    parser.add_argument("--marks", metavar="FILE", help=".toml or .json with room, lights, windows, regions, lamps")
    medium = parser.add_argument_group("medium")
    medium.add_argument("--visibility", type=float, metavar="M", help="metres: extinction is 3.912 over that")
    medium.add_argument("--scattering", metavar="R[,G,B]", help="1/m (default 0.08 in rooms, 0.01 outdoors)")
    medium.add_argument("--absorption", metavar="R[,G,B]", default="0", help="1/m (default 0)")
    medium.add_argument("--asymmetry", type=float, metavar="G", help="-0.9 to 0.9 (default 0, with shafts 0.3)")
    depth = parser.add_argument_group("depth, where the marks' is not to be used")
    depth.add_argument("--depth", metavar="FILE", help=".png (millimetres), .exr, .npy or .npz (metres)")
    depth.add_argument("--depth-unit", type=float, metavar="M", help="metres of a value of one in --depth")
    depth.add_argument("--stereo", nargs=2, metavar=("LEFT", "RIGHT"), help="rectified pair; LEFT is the photo")
    depth.add_argument("--baseline", type=float, metavar="M", help="metres between the cameras of --stereo")
    depth.add_argument("--focal", type=float, metavar="PX", help="focal length in pixels (default: that of the marks)")
    depth.add_argument("--disparity-offset", type=float, default=0.0, metavar="PX", help="of infinitely far things")
    depth.add_argument("--lidar", nargs=2, metavar=("POINTS", "CALIBRATION"), help="KITTI's .bin and calibration .txt")
    depth.add_argument("--labels", metavar="FILE", help="picture of 0 ground, 1 vertical, 2 sky")
    how = parser.add_argument_group("how")
    how.add_argument("--transmittance", choices=("ratio", "patches", "centroid"), default="ratio")
    how.add_argument("--loss", choices=("absorbed", "single", "none"), default="absorbed",
                     help="what daylight loses in the fog above (default absorbed)")  # fmt: skip
    how.add_argument("--top", type=float, default=100.0, metavar="M", help="height of outdoor fog (default 100)")
    how.add_argument("--light-gain", type=float, default=1.0, metavar="X", help="lights are so much brighter")
    how.add_argument("--shaft-gain", type=float, default=1.0, metavar="X", help="the sun in shafts is so much brighter")
    how.add_argument("--highlights", type=float, default=1.0, metavar="X", help="factor of saturated lamps and sky")
    how.add_argument("--seed", type=int, default=0, metavar="N")
    more = parser.add_argument_group("more to write")
    more.add_argument("--write-transmittance", metavar="FILE", help=".png or .exr")
    more.add_argument("--write-scattered", metavar="FILE", help=".png or .exr")
    more.add_argument("--write-depth", metavar="FILE", help=".exr or .npz in metres, .png for the eye")
    more.add_argument("--json", action="store_true", help="print what was found out as JSON")


def run_fog(arguments: argparse.Namespace) -> None:
    """Put fog into one photo and write what was asked for."""
    wanted = [(arguments.output, SUFFIXES), (arguments.write_transmittance, SUFFIXES),
              (arguments.write_scattered, SUFFIXES), (arguments.write_depth, DEPTH_SUFFIXES)]  # fmt: skip
    for file, suffixes in wanted:
        if file:
            check_output(Path(file), suffixes)
    files = [Path(file).resolve() for file, _ in wanted if file]
    if twice := [file for number, file in enumerate(files) if file in files[:number]]:
        raise OptionError(f"--output and each --write-… need files of their own, got {twice[0].name} twice")
    _check(arguments)
    from torchrender.images.files import read_image, write_image
    from torchrender.photo.fog import FogPhoto, read_marks
    from torchrender.photo.fog.marks.records import Marks

    with saying_warnings():
        marks = read_marks(arguments.marks) if arguments.marks else Marks()
        photo = read_image(arguments.photo)
        fog = FogPhoto(photo, marks, _options(arguments), depth=_depth(arguments, photo, marks),
                       labels=_labels(arguments, marks))  # fmt: skip
        shafts = fog.room is not None and fog.room.shafts is not None
        made = fog.foggy(_medium(arguments, marks, shafts))
        write_image(arguments.output, made.composite)
        if arguments.write_transmittance:
            write_image(arguments.write_transmittance, made.transmittance)
        if arguments.write_scattered:
            write_image(arguments.write_scattered, made.scattered)
        if arguments.write_depth:
            _write_depth(Path(arguments.write_depth), made.depth)
    if arguments.json:
        print(json.dumps({**made.facts, "timings_ms": made.timings_ms}, indent=1))
        return
    for name, value in made.facts.items():
        print(f"{name.replace('_', ' ')}: {value}")
    print("  ".join(f"{stage} {ms:.0f} ms" for stage, ms in made.timings_ms.items()))
    print(arguments.output)


def _check(arguments: argparse.Namespace) -> None:
    ways = [name for name in ("depth", "stereo", "lidar") if getattr(arguments, name)]
    if len(ways) > 1:
        raise OptionError(f"--{ways[0]} and --{ways[1]} exclude each other")
    if not ways and not arguments.marks and not arguments.labels:
        raise OptionError("fog needs --marks, --labels, --depth, --stereo or --lidar: something must tell depth")
    for name in ("baseline", "disparity_offset"):
        if getattr(arguments, name) and not arguments.stereo:
            raise OptionError(f"--{name.replace('_', '-')} goes with --stereo")
    if arguments.depth_unit is not None and not arguments.depth:
        raise OptionError("--depth-unit goes with --depth")
    if arguments.stereo and arguments.baseline is None:
        raise OptionError("--stereo needs --baseline")
    if arguments.focal is not None and not arguments.stereo:
        raise OptionError("--focal goes with --stereo; elsewhere it stands in the marks, under camera")
    if arguments.visibility is not None and arguments.scattering is not None:
        raise OptionError("--visibility and --scattering exclude each other")


def _color(name: str, text: str) -> list[float]:
    return numbers(name, text, 3) if "," in text else numbers(name, text, 1) * 3


def _medium(arguments: argparse.Namespace, marks: Marks, shafts: bool) -> FogMedium:
    from torchrender.photo.fog import FogMedium

    scattering: object = None
    if arguments.scattering is not None:
        scattering = _color("--scattering", arguments.scattering)
    elif arguments.visibility is None:
        scattering = INDOOR if marks.indoor else OUTDOOR
    asymmetry = arguments.asymmetry if arguments.asymmetry is not None else 0.3 if shafts else 0.0
    return FogMedium.of(visibility=arguments.visibility, scattering=scattering, asymmetry=asymmetry,
                        absorption=_color("--absorption", arguments.absorption))  # fmt: skip


def _options(arguments: argparse.Namespace) -> FogOptions:
    from torchrender.photo.fog import FogOptions

    names = ("transmittance", "loss", "top", "light_gain", "shaft_gain", "highlights", "seed")
    return FogOptions(**{name: getattr(arguments, name) for name in names})


def _depth(arguments: argparse.Namespace, photo: Tensor, marks: Marks) -> Tensor | None:
    from torchrender.images.files import read_image
    from torchrender.photo.fog.depth import measured

    if arguments.depth:
        with named(unit="--depth-unit"):
            return measured.read_depth(arguments.depth, arguments.depth_unit)
    if arguments.stereo:
        focal = arguments.focal or marks.camera.focal
        if focal is None:
            raise OptionError("--stereo needs --focal, or a focal length in the marks")
        left, right = (read_image(file) for file in arguments.stereo)
        return measured.depth_from_stereo(
            left, right, focal=focal, baseline=arguments.baseline, offset=arguments.disparity_offset
        )
    if arguments.lidar:
        points, projection = measured.read_lidar(*arguments.lidar)
        sparse = measured.depth_from_points(points, projection, photo.shape[1], photo.shape[0])
        return measured.dense_from_points(sparse)
    return None


def _labels(arguments: argparse.Namespace, marks: Marks) -> Tensor | None:
    file = arguments.labels
    if file is None and marks.labels is not None:
        file = Path(arguments.marks).parent / marks.labels
    if file is None:
        return None
    from torchrender.photo.fog.depth.labels import read_labels

    return read_labels(file)


def _write_depth(path: Path, depth: Tensor) -> None:
    import torch

    from torchrender.images.files import write_image, write_npz

    if path.suffix.lower() == ".npz":
        write_npz(path, {"depth": depth})
    elif path.suffix.lower() == ".exr":
        write_image(path, depth, channels=("Z",))
    else:
        write_image(path, torch.exp(-depth / depth.median().clamp_min(1e-6)))
