"""The command ``torchrender walkthrough``, and what ``render``, ``fly``, ``info`` and ``serve`` do with its files."""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchrender.cli.arguments import camera_of, exposure, numbers, say_unused
from torchrender.cli.output import check_output, image_size
from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torchrender.scene.camera import Cameras
    from torchrender.scene.cameras.path import CameraPath
    from torchrender.walkthrough.model import Walkthrough

SUFFIX = ".trw"
GAP_PIXELS = 3
"""Widest gap between points, about, that pictures and films close."""


def is_walkthrough(name: str | Path) -> bool:
    """Whether a name is that of a walkthrough's file."""
    return Path(name).suffix.lower() == SUFFIX


def add_walkthrough(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("walkthrough", help="make planes and points from a folder of RGB-D photos with poses")
    parser.add_argument(
        "capture", metavar="FOLDER", help="TUM, 7-Scenes, Redwood or Open3D (.log) folder, pose files, or a .json file"
    )
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="walkthrough to write: .trw")
    parser.add_argument("--hold-out", type=int, default=8, metavar="N",
                        help="leave out every Nth photo and compare with it (default 8; 0: use all)")  # fmt: skip
    parser.add_argument("--intrinsics", metavar="FX,FY,CX,CY", help="pixels, where the folder does not say")
    parser.add_argument("--depth-scale", type=float, metavar="N", help="codes of depth per scene unit")
    parser.add_argument("--max-frames", type=int, default=200, metavar="N", help="photos to use (default 200)")
    parser.add_argument("--n-min", type=int, default=400, metavar="PX", help="least plane in a photo (default 400)")
    parser.add_argument("--tau-z", type=float, default=0.01, help="share of depth within which photos agree (0.01)")
    parser.add_argument("--rho-scale", type=float, default=1.0, metavar="F", help="texels per unit, factor (default 1)")
    parser.add_argument("--size-share", type=float, metavar="F",
                        help="keep to this share of the photos' raw size (0.25 if it hardly shows)")  # fmt: skip
    parser.add_argument("--fill", choices=("exemplar", "inpaint", "off"), default="exemplar",
                        help="how parts of planes that no photo saw are filled (default exemplar)")  # fmt: skip
    parser.add_argument("--no-repair", action="store_true", help="take poses and exposure as they are")
    parser.add_argument("--keep-axes", action="store_true", help="do not turn the scene so that up is +y")
    parser.add_argument("--glb", metavar="FILE", help="also write the planes as GLB")
    parser.add_argument("--ply", metavar="FILE", help="also write the points as PLY")
    parser.add_argument("--trp", metavar="FILE", help="also write the points in the format of torchrender points")
    parser.add_argument("--next-views", type=int, default=1, metavar="N", help="say where to take more photos (1)")
    parser.add_argument("--json", action="store_true", help="print the whole report as JSON")
    parser.add_argument("--seed", type=int, default=0, help="of all random choices (default 0)")


def run_walkthrough(arguments: argparse.Namespace) -> None:
    """Run the command."""
    check_output(Path(arguments.output), (SUFFIX,))
    for name, suffix in (("glb", ".glb"), ("ply", ".ply"), ("trp", ".trp")):
        if getattr(arguments, name):
            check_output(Path(getattr(arguments, name)), (suffix,))
    if not 0 <= arguments.next_views <= 64:
        raise OptionError(f"--next-views must be in [0, 64], got {arguments.next_views}")
    lens = None if arguments.intrinsics is None else numbers("--intrinsics", arguments.intrinsics, 4)
    from torchrender.walkthrough.build import build_walkthrough
    from torchrender.walkthrough.file import write_walkthrough
    from torchrender.walkthrough.frames.layouts import load_rgbd
    from torchrender.walkthrough.options import WalkthroughOptions

    repair = "off" if arguments.no_repair else "auto"
    options = WalkthroughOptions(
        n_min=arguments.n_min,
        tau_z=arguments.tau_z,
        rho_scale=arguments.rho_scale,
        size_share=arguments.size_share,
        fill=arguments.fill,
        exposure=repair,
        registration=repair,
        upright=not arguments.keep_axes,
        max_frames=arguments.max_frames,
        seed=arguments.seed,
    )
    with warnings.catch_warnings():
        warnings.showwarning = _say_warning
        warnings.simplefilter("always", UserWarning)
        sequence = load_rgbd(arguments.capture, intrinsics=lens, depth_scale=arguments.depth_scale)
        made = build_walkthrough(sequence, options, hold_out=arguments.hold_out, progress=_bar)
    size = write_walkthrough(arguments.output, made)
    for line in _exports(arguments, made):
        print(line)
    if arguments.json:
        print(json.dumps(dict(made.report), indent=2))
    else:
        for line in report_lines(made):
            print(line)
    for line in _next_views(made, arguments.next_views, arguments.seed):
        print(line, file=sys.stderr if arguments.json else sys.stdout)
    print(f"{arguments.output}  {size:,} bytes", file=sys.stderr if arguments.json else sys.stdout)


def _say_warning(message: Any, *_: Any, **__: Any) -> None:
    print(f"torchrender: warning: {message}", file=sys.stderr)


def _bar(items: Iterable[Any], stage: str) -> Iterable[Any]:
    """A progress bar on stderr for each stage, or where nobody watches a line when it begins."""
    if not sys.stderr.isatty():
        print(f"{stage} ...", file=sys.stderr)
        return items
    from tqdm import tqdm

    return tqdm(items, desc=stage, file=sys.stderr, leave=False)


def _exports(arguments: argparse.Namespace, made: Walkthrough) -> Iterator[str]:
    from torchrender.walkthrough.export import write_glb, write_ply, write_trp

    for name, write, parts in (
        ("glb", write_glb, len(made.planes)),
        ("ply", write_ply, len(made.points)),
        ("trp", write_trp, len(made.points)),
    ):
        file = getattr(arguments, name)
        if file and parts:
            yield f"{file}  {write(file, made):,} bytes"
        elif file:
            print(f"torchrender: warning: nothing to write to {file}", file=sys.stderr)


def report_lines(made: Walkthrough) -> Iterator[str]:
    """What a build says of itself."""
    r = made.report
    sizes = r["bytes"]
    yield (
        f"{r['photos']} photos of {r['size'][0]}x{r['size'][1]}: {r['planes']} planes, {r['points']:,} points in"
        f" {r['objects']:,} objects; {100 * r['planar_share']:.0f} % of pixels on planes, {100 * r['kept_share']:.0f} %"
        " kept after comparing photos"
    )
    if r["left_out"]:
        yield f"{len(r['left_out'])} frames left out"
    yield (
        f"size {made.size_bytes / 1e6:.1f} MB raw, {100 * r['size_share']:.0f} % of the photos'"
        f" {sizes['photos'] / 1e6:.1f} MB: textures {sizes['textures'] / 1e6:.1f}, points {sizes['points'] / 1e6:.1f},"
        f" colours that depend on the view {sizes['view_colors'] / 1e6:.1f}"
    )
    yield f"texels: {r['texels']['seen']:,} seen, {r['texels']['filled']:,} filled, {r['texels']['holes']:,} true holes"
    yield (
        f"depths of photos agree within {100 * r['disagreement_before']:.3f} % before and"
        f" {100 * r['disagreement_after']:.3f} % after registration; cameras moved by up to {r['camera_moved']:.4f}"
    )
    if r.get("held_out"):
        h = r["held_out"]
        yield (
            f"held out: {len(h['photos'])} photos, PSNR {h['psnr_db']:.1f} dB on {100 * h['coverage']:.1f} % of pixels,"
            f" {h['frame_ms']:.0f} ms a picture"
        )
    if r.get("held_out_as_given"):
        h = r["held_out_as_given"]
        yield f"held out, poses as given: PSNR {h['psnr_db']:.1f} dB on {100 * h['coverage']:.1f} % of pixels"
    total = sum(r["ms"].values())
    yield f"{total / 1e3:.1f} s: " + "  ".join(f"{stage} {ms / 1e3:.1f}" for stage, ms in r["ms"].items())


def _next_views(made: Walkthrough, count: int, seed: int) -> Iterator[str]:
    from torchrender.walkthrough.review.next_view import next_views

    if count:
        for number, view in enumerate(next_views(made, count, seed=seed), 1):
            eye, forward = view.camera.eye[0].tolist(), view.camera.forward[0].tolist()
            target = [e + f for e, f in zip(eye, forward)]
            place = " ".join(f"{n}={','.join(f'{v:.3f}' for v in p)}" for n, p in (("eye", eye), ("target", target)))
            yield (
                f"next photo {number}: {place}  shows nothing in {100 * view.missing:.0f} %, made-up parts in"
                f" {100 * view.filled:.0f} %"
            )


# ------------------------------------------------------------------ pictures


def render_walkthrough(arguments: argparse.Namespace) -> None:
    """``torchrender render room.trw``."""
    from torchrender.images.files import numbered, write_image
    from torchrender.numerics.tonemap import auto_exposure
    from torchrender.walkthrough.draw import draw_walkthrough
    from torchrender.walkthrough.file import read_walkthrough

    say_unused(arguments, ("output", "camera", "size", "background", "exposure", "supersample"), "a walkthrough")
    output = Path(arguments.output)
    check_output(output, (".png", ".exr"))
    width, height = image_size(arguments.size)
    made = read_walkthrough(arguments.scene)
    options = _draw_options(arguments.background)
    words = arguments.camera or [[]]
    chosen_exposure = 0.0 if arguments.exposure is None else exposure(arguments.exposure)
    factor = _whole_samples(arguments.supersample)
    for number, chosen in enumerate(words):
        camera = camera_of(made, chosen, width, height)  # type: ignore[arg-type]
        drawn = draw_walkthrough(made, camera.scaled(factor) if factor > 1 else camera, options)
        image = _smaller(drawn.image[0], factor)
        ev = auto_exposure(drawn.image[0], mask=drawn.covered[0]) if chosen_exposure is None else chosen_exposure
        image = 2.0**ev * image
        file = numbered(output, number, len(words))
        write_image(file, image)
        found = drawn.statistics[0]
        steps = "  ".join(f"{step} {elapsed:.0f} ms" for step, elapsed in found.ms.items())
        empty = 100 * found.uncovered / drawn.kind[0].numel()
        exposed = f"  exposure {ev:+.2f} EV" if chosen_exposure is None else ""
        shown = f"{found.drawn:,} of {found.points:,} points  {empty:.2f} % empty"
        print(f"{file}  {width}x{height}  {shown}  {steps}{exposed}")


def _whole_samples(wanted: float | None) -> int:
    """Samples per pixel and side that a walkthrough is drawn with: whole numbers; says what another is taken for."""
    from torchrender.pipeline.options import RenderOptions

    if wanted is None:
        return 1
    factor = max(1, round(RenderOptions(supersample=wanted).supersample))
    if factor != wanted:
        told = f"--supersample {wanted:g}: a walkthrough takes whole numbers of at least 1, here {factor}"
        print(f"torchrender: warning: {told}", file=sys.stderr)
    return factor


def _smaller(image: Any, factor: int) -> Any:
    if factor == 1:
        return image
    h, w, _ = image.shape
    return image.reshape(h // factor, factor, w // factor, factor, 3).mean(dim=(1, 3))


def _draw_options(background: str | None) -> Any:
    from torchrender.walkthrough.options import DrawOptions

    color = (0.0, 0.0, 0.0) if background is None else tuple(numbers("--background", background, 3))
    return DrawOptions(gap_pixels=GAP_PIXELS, background=color)  # type: ignore[arg-type]


def fly_pictures(arguments: argparse.Namespace, size: tuple[int, int]) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Pictures (H,W,3) linear along a path through the walkthrough, each with its statistics."""
    from torchrender.walkthrough.draw import draw_walkthrough
    from torchrender.walkthrough.file import read_walkthrough

    made = read_walkthrough(arguments.scene)
    cameras = flight(made, arguments.path, arguments.frames, size)
    options = _draw_options(None)
    for number in range(len(cameras)):
        drawn = draw_walkthrough(made, cameras[number], options)
        found = drawn.statistics[0]
        record = {"frame": number, "ms": round(sum(found.ms.values()), 2), "uncovered": found.uncovered}
        yield drawn.image[0].clamp(0, 1), record | {"steps_ms": {k: round(v, 2) for k, v in found.ms.items()}}


def flight(made: Walkthrough, name: str, frames: int, size: tuple[int, int]) -> Cameras:
    """Cameras of a flight: past the cameras of the photos, or along a path file."""
    from torchrender.scene.cameras.path import load_path

    near = 1e-3 * (made.diagonal or 1.0)
    if Path(name).suffix.lower() in (".toml", ".json"):
        path = load_path(name)
    elif name in ("", "photos"):
        path = photo_path(made)
    else:
        raise OptionError(f"--path of a walkthrough must be photos, or a TOML or JSON file of poses, got {name!r}")
    return path.cameras(frames, width=size[0], height=size[1], near=near)


def photo_path(made: Walkthrough, most: int = 24) -> CameraPath:
    """A way past the photos' cameras, in their order.

    Raises:
        OptionError: fewer than two cameras are known.
    """
    import math

    import torch

    from torchrender.scene.cameras.path import CameraPath

    cameras = made.cameras
    if cameras is None or len(cameras) < 2:
        raise OptionError("a flight past the photos needs at least two of them; give --path FILE")
    rows = torch.linspace(0, len(cameras) - 1, min(most, len(cameras))).round().long()
    fov = 2 * math.degrees(math.atan(cameras.height / (2 * float(cameras.intrinsics[0, 1, 1]))))
    eyes = cameras.eye[rows]
    return CameraPath(
        eyes=eyes, targets=eyes + cameras.forward[rows], fov_deg=torch.full((len(rows),), min(max(fov, 10.0), 120.0))
    )


def walkthrough_info(name: str) -> dict[str, Any] | None:
    """What a walkthrough's file holds, as plain values; None for anything else."""
    if not is_walkthrough(name):
        return None
    from torchrender.walkthrough.file import read_walkthrough

    made = read_walkthrough(name)
    held = made.report.get("held_out") or {}
    return {
        "name": made.name,
        "planes": len({p.plane for p in made.planes}),
        "texels": made.texel_count,
        "points": len(made.points),
        "objects": len(made.points.roots),
        "photos": 0 if made.cameras is None else len(made.cameras),
        "bytes_raw": made.size_bytes,
        "bytes": Path(name).stat().st_size,
        "held_out_psnr_db": held.get("psnr_db"),
        "held_out_coverage": held.get("coverage"),
        "bounds": made.bounds.tolist(),
        "diagonal": made.diagonal,
    }
