"""The command ``torchrender depth``: depth images of a scene, their cameras, and pictures of them."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import add_scene, add_size, camera_of, given, load_scene, named
from torchrender.cli.files.kept import beside
from torchrender.cli.output import check_folder, check_output, image_size, progress
from torchrender.errors import ImageFileError, OptionError

if TYPE_CHECKING:
    from torchrender.buffers import DepthImages
    from torchrender.depth.kinds import SampleKinds

MOST_PIXELS = 2**30
"""Of all images together, which are in memory at a time: each takes about 50 bytes."""
_CHANNELS = ("Z", "id.triangle", "id.object", "layer")
_ARRAYS = ("depth", "triangle", "object_id", "barycentric", "normal", "layer", "truncated")


def add_depth(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("depth", help="write depth images of a scene from several viewpoints")
    add_scene(parser)
    told = "folder, .npz file, or .exr files; their cameras are in cameras.json, or OUT_cameras.json"
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=told)
    parser.add_argument("--views", type=int, default=3, metavar="N", help="number of viewpoints (default 3)")
    parser.add_argument("--spread", type=float, help="their distance in scene diagonals (default 0.2)")
    parser.add_argument(
        "--method",
        choices=("nonredundant", "conventional", "depth_peeling"),
        help="only what earlier views do not have; first hits; or layer after layer from the middle"
        " (default nonredundant)",
    )
    parser.add_argument(
        "--redundancy",
        choices=("pixel", "visibility"),
        help="what earlier views have: what their pixels store, or what they could see (default pixel)",
    )
    parser.add_argument("--two-sided", action="store_true", help="sample back faces, too")
    parser.add_argument(
        "--show",
        action="store_true",
        help="also write pictures, kinds.png or OUT_kinds.png: redundant samples red, hidden ones blue, useful ones"
        " among them green",
    )
    parser.add_argument("--camera", nargs="+", metavar="CAMERA", help="middle of the viewpoints, as for render")
    add_size(parser, "1024x1024", "size of each image")


def depth_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from torchrender.depth.kinds import sample_kinds
    from torchrender.depth.options import SamplingOptions
    from torchrender.depth.sample import sample_depth_images
    from torchrender.depth.viewpoints import viewpoints_around

    output = Path(arguments.output)
    if output.suffix:
        check_output(output, (".npz", ".exr"))
    else:
        check_folder(output)
    if output.suffix.lower() != ".npz":
        _check_own(output)
    options = SamplingOptions(
        cull_backfaces=not arguments.two_sided,
        **given(method=arguments.method, redundancy=arguments.redundancy),
    )
    width, height = image_size(arguments.size)
    if arguments.views * width * height > MOST_PIXELS:
        told = f"{arguments.views} images of {width}x{height} have more than {MOST_PIXELS:,} pixels"
        raise OptionError(f"--views and --size: {told}: take fewer, or smaller ones")
    scene = load_scene(arguments)
    camera = camera_of(scene, arguments.camera or [], width, height)
    with named(count="--views"):
        cameras = viewpoints_around(scene, camera, arguments.views, **given(spread=arguments.spread))
    images = sample_depth_images(scene, cameras, options)
    for file in write_depth(output, images):
        print(file)
    if arguments.show:
        kinds = sample_kinds(scene, cameras, images)
        for line in write_kinds(output, images, kinds):
            print(line)


def write_depth(output: Path, images: DepthImages) -> list[Path]:
    """Depth images: one NPZ file, or an EXR file per image with ``cameras.json``; what that lists of an earlier run and
    is not written anew goes."""
    from torchrender.image import camera_arrays
    from torchrender.images.files import new_folder, write_npz

    if output.suffix.lower() == ".npz":
        write_npz(output, {**{name: getattr(images, name) for name in _ARRAYS}, **camera_arrays(images.cameras)})
        return [output]
    if output.suffix:
        return _write_planes(output, images)
    with new_folder(output):
        return _write_planes(output, images)


def _pattern(output: Path) -> Path:
    """What the files of images are called after."""
    return output if output.suffix else output / "depth.exr"


def _check_own(output: Path) -> None:
    """Refuse to write over cameras of somebody else.

    Raises:
        ImageFileError: names the file.
    """
    described = beside(output, "cameras.json")
    if described.exists() and not _earlier(described, _pattern(output)):
        raise ImageFileError(described, "is there, and not of an earlier run of this command: give another output")


def _write_planes(output: Path, images: DepthImages) -> list[Path]:
    import torch

    from torchrender.image import camera_arrays
    from torchrender.images.files import numbered, write_bytes, write_image

    described, pattern = beside(output, "cameras.json"), _pattern(output)
    files = [numbered(pattern, number, len(images)) for number in range(len(images))]
    earlier = _earlier(described, pattern)
    for number, file in enumerate(progress(files, "files")):
        planes = [images.depth, images.triangle, images.object_id, images.layer]
        write_image(file, torch.stack([p[number].float() for p in planes], dim=-1), channels=_CHANNELS)
    lists = {name: value.tolist() for name, value in camera_arrays(images.cameras).items()}
    # JSON knows no infinity: a missing far plane is null.
    lists["far"] = [None if far == float("inf") else far for far in lists["far"]]
    write_bytes(described, (json.dumps({"files": [f.name for f in files], **lists}, indent=1) + "\n").encode())
    pictures = [numbered(beside(output, "kinds.png"), number, earlier) for number in range(earlier)]
    for file in [*(numbered(pattern, number, earlier) for number in range(earlier)), *pictures]:
        if file not in files:
            file.unlink(missing_ok=True)
    return [*files, described]


def _earlier(described: Path, pattern: Path) -> int:
    """How many images an earlier run wrote here."""
    from torchrender.images.files import numbered

    try:
        names = json.loads(described.read_text())["files"]
        ours = [numbered(pattern, number, len(names)).name for number in range(len(names))]
    except (OSError, ValueError, LookupError, TypeError):
        return 0
    return len(ours) if names == ours else 0


def write_kinds(output: Path, images: DepthImages, kinds: SampleKinds) -> Iterator[str]:
    """Pictures of the images coloured by kind of sample, beside the depth files; yields a line about each."""
    from torchrender.depth.picture import kinds_picture
    from torchrender.images.files import numbered, write_image

    pattern = beside(output, "kinds.png")
    for number, picture in enumerate(kinds_picture(images, kinds)):
        file = numbered(pattern, number, len(images))
        write_image(file, picture)
        counts = {name: int(getattr(kinds, name)[number].sum()) for name in ("redundant", "hidden", "useful")}
        filled = max(int(images.covered[number].sum()), 1)
        shares = ", ".join(f"{name} {100 * count / filled:.1f} %" for name, count in counts.items())
        yield f"{file}  filled {100 * filled / picture[..., 0].numel():.1f} %; of these {shares}"
