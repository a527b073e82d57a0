"""Measure reprojection: ``python -m torchrender.report.reproject [--quick]``.

Writes ``docs/results/reproject.md``, ``.json`` and ``.png``: three depth images drawn from a viewpoint between them, by
every method and by plain torch; times taken in turn, and the pictures beside a render of the scene itself.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import DepthImages, GBuffer
from torchrender.depth.options import SamplingOptions
from torchrender.depth.sample import sample_depth_images, sample_offset_images
from torchrender.depth.viewpoints import viewpoints_around
from torchrender.images.files import write_image
from torchrender.numerics.tonemap import tone_map
from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.metrics import psnr
from torchrender.quality.pages import write_record, write_text
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize, surface_attributes
from torchrender.reconstruct.corners import fit_corners
from torchrender.reconstruct.hybrid import reconstruct_hybrid
from torchrender.reconstruct.reproject import Reprojection, reproject
from torchrender.report.common.command import study_parser
from torchrender.report.reproject.kornia_warp import flow_warp, homography_warp
from torchrender.report.reproject.torch_warp import torch_grid_warp
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build
from torchrender.shade import shade

SCENES = ("living_room", "city")
EVERY = (
    "city", "cornell_box", "grass", "hall", "living_room", "nest", "panes", "street_lamp", "tree", "walker", "washroom",
)  # fmt: skip
"""All built-in scenes, for times alone."""
METHODS = ("conventional", "nonredundant")
AIM_MS, DEARER = 60.0, 1.6
"""Three images reprojected; and three non-redundant images in times of three conventional ones."""
SPREAD = 0.05  # side of the triangle of viewpoints, bounding-box diagonals
UNKNOWN = (1.0, 0.0, 1.0)


def main() -> None:
    """Run every measurement and write the page."""
    arguments = study_parser(__doc__, quick="small images and few runs, to check that it works").parse_args()
    run(arguments.output, *((256, 3) if arguments.quick else (1024, 7)))


def run(folder: Path, size: int, runs: int, triangles: int | None = None) -> None:
    """Measure at ``size`` pixels and write the page; ``triangles``: of each scene, None for the usual number."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"machine": machine_record(), "size": size, "scenes": {}}
    rows = []
    for name in SCENES:
        for method in METHODS:
            found, pictures = measure(build(name, triangles=triangles), method, size, runs)
            record["scenes"][f"{name}, {method}"] = found
            rows.append(torch.cat([smaller(p) for p in pictures], dim=1))
    record["every"] = [timed(name, build(name, triangles=triangles), size, runs) for name in EVERY]
    write_image(folder / "reproject.png", torch.cat(rows))
    write_record(folder / "reproject.json", record)
    write_text(folder / "reproject.md", page(record))
    sys.stderr.write(f"wrote {folder / 'reproject.md'}\n")


def measure(scene: Scene, method: str, size: int, runs: int) -> tuple[dict[str, Any], list[Tensor]]:
    """Times, quality and pictures of one scene and sampling method."""
    scene = scene.with_default_light()
    camera = scene.camera(width=size, height=size)
    cameras, target = (viewpoints_around(scene, camera, n, spread=SPREAD) for n in (3, 1))
    images = shaded(scene, sample_depth_images(scene, cameras, SamplingOptions(method=method)))
    offset = sample_offset_images(scene, images)
    quads = fit_corners(images, offset)
    truth = rasterize(scene, target, cull="back")
    work = {
        "hybrid, first view": lambda: reproject(fit_corners(images), target),
        "hybrid": lambda: reproject(images, target),  # further views: the corners are kept with the images
        "hybrid, offset images": lambda: reproject(images, target, offset_images=offset),
        "hybrid, offset images, corners kept": lambda: reproject(quads, target),
        "grid": lambda: reproject(images, target, method="grid"),
        "splat": lambda: reproject(images, target, method="splat"),
    }
    others = {
        "corners alone": lambda: fit_corners(images, offset),
        "mesh of all images": lambda: reconstruct_hybrid(images, offset),
        "plain torch grid": lambda: torch_grid_warp(images, target),
        "kornia homography of one image": lambda: homography_warp(images, target),
        "kornia flow of one image, depth given": lambda: flow_warp(images, target, truth.depth[0]),
    }
    timings = take_turns({**work, **others}, runs=runs)
    wanted = shade(scene, truth)
    drawn = {key: run() for key, run in work.items()}
    figures = {key: compare(result, truth, wanted) for key, result in drawn.items()}
    times = {key: timing.record() for key, timing in timings.items()}
    shown = [mapped(wanted[0])] + [picture(drawn[key]) for key in ("hybrid, offset images", "hybrid", "grid", "splat")]
    return {"filled": float(images.covered.float().mean()), "ms": times, "quality": figures}, shown


def timed(name: str, scene: Scene, size: int, runs: int) -> dict[str, Any]:
    """Times of three images of each kind: sampling them, a first view and further views of them, in turn."""
    camera = scene.camera(width=size, height=size)
    cameras, target = (viewpoints_around(scene, camera, n, spread=SPREAD) for n in (3, 1))
    work: dict[str, Any] = {}
    filled = {}
    for method in METHODS:
        options = SamplingOptions(method=method)
        images = sample_depth_images(scene, cameras, options)
        filled[method] = float(images.covered.float().mean())
        work[f"{method}, sampled"] = partial(sample_depth_images, scene, cameras, options)
        work[f"{method}, first"] = lambda images=images: reproject(fit_corners(images), target)
        work[f"{method}, further"] = partial(reproject, images, target)
    times = {key: timing.record() for key, timing in take_turns(work, runs=runs).items()}
    return {"scene": name, "triangles": scene.geometry.triangle_count, "filled": filled, "ms": times}


def shaded(scene: Scene, images: DepthImages) -> DepthImages:
    """The images with the scene's radiance at each sample as colour."""
    color = shade(scene, surface_attributes(scene, images))
    return replace(images, color=torch.where(images.covered[..., None], color, 0.0))


def compare(result: Reprojection, truth: GBuffer, wanted: Tensor) -> dict[str, float]:
    """Valid share of what the scene covers; of that, right depth and peak signal-to-noise ratio (display range)."""
    known = result.valid & truth.covered
    cameras: Cameras = truth.cameras
    off = (torch.where(known, result.depth, 1.0) - torch.where(known, truth.depth, 1.0)).abs()
    right = known & (off <= 2 * cameras.footprint(torch.where(known, truth.depth, 1.0)))
    pictures = mapped(result.color), mapped(wanted)
    return {
        "valid": _share(known, truth.covered),
        "depth_right": _share(right, known),
        "psnr_valid": float(psnr(*pictures, mask=known)),
        "psnr_right": float(psnr(*pictures, mask=right)),
    }


def mapped(radiance: Tensor) -> Tensor:
    """Display-linear colour in [0,1]."""
    return tone_map(radiance, "reinhard")


def smaller(image: Tensor, side: int = 320) -> Tensor:
    """(H,W,3) means over square cells, so that the page stays light."""
    step = max(1, image.shape[0] // side)
    rows, columns = image.shape[0] // step, image.shape[1] // step
    return image[: rows * step, : columns * step].reshape(rows, step, columns, step, 3).mean(dim=(1, 3))


def picture(result: Reprojection) -> Tensor:
    """(H,W,3), pixels without a sample in a colour that no surface has."""
    return torch.where(result.valid[0, ..., None], mapped(result.color[0]), torch.tensor(UNKNOWN))


def page(record: dict[str, Any]) -> str:
    """The Markdown page."""
    size = record["size"]
    where = machine_line(record["machine"])
    lines = ["# Reprojection", "", f"`python -m torchrender.report.reproject` on {where}", ""]
    lines += [f"Three {size} x {size} depth images drawn at {size} x {size} from the viewpoint between them."]
    lines += [
        "A first view fits the corners of the samples' quads; they are kept with the images for further views.",
        "",
    ]
    lines += every_table(record["every"])
    for name, found in record["scenes"].items():
        slow = found["ms"]["plain torch grid"]["median"]
        lines += [f"## {name} ({100 * found['filled']:.0f} % of the pixels filled)", ""]
        lines += [
            "| method | median ms | least | torch / this | valid % | depth right % | PSNR valid | PSNR right depth |"
        ]
        lines += ["|---|---|---|---|---|---|---|---|"]
        for key, ms in found["ms"].items():
            q = found["quality"].get(key)
            text = "– | – | – | –"
            if q is not None:
                text = f"{100 * q['valid']:.2f} | {100 * q['depth_right']:.2f} | "
                text += f"{q['psnr_valid']:.1f} | {q['psnr_right']:.1f}"
            times = f"{ms['median']:.1f} | {ms['least']:.1f} | {slow / ms['median']:.1f}"
            lines += [f"| {key} | {times} | {text} |"]
        lines += [""]
    lines += ["Rows: " + "; ".join(record["scenes"]) + ". Columns: the scene itself, hybrid with offset images,"]
    lines += [
        "hybrid without, grid, splat. Magenta: no sample reaches the pixel.",
        "",
        "![pictures](reproject.png)",
        "",
    ]
    return "\n".join(lines)


def every_table(rows: list[dict[str, Any]]) -> list[str]:
    """Times on all built-in scenes."""
    lines = [
        "## All built-in scenes",
        "",
        f"Median milliseconds. Aimed at: at most {AIM_MS:g} ms for three images, non-redundant ones included, and",
        f"three non-redundant images sampled in at most {DEARER:g} times the time of three conventional ones.",
        "**Bold**: reached.",
        "",
        "| scene | filled % | conventional: first view | further | non-redundant: first view | further "
        "| sampled: conventional | non-redundant | ratio |",
        "|---|---|---|---|---|---|---|---|---|",
    ]

    def short(ms: float) -> str:
        return f"**{ms:.1f}**" if ms <= AIM_MS else f"{ms:.1f}"

    for row in rows:
        ms = {key: timing["median"] for key, timing in row["ms"].items()}
        cells = [row["scene"], " / ".join(f"{100 * row['filled'][m]:.0f}" for m in METHODS)]
        cells += [short(ms[f"{m}, {view}"]) for m in METHODS for view in ("first", "further")]
        sampled = [ms[f"{m}, sampled"] for m in METHODS]
        ratio = sampled[1] / sampled[0]
        cells += [f"{t:.0f}" for t in sampled] + [f"**{ratio:.2f}**" if ratio <= DEARER else f"{ratio:.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def _share(part: Tensor, whole: Tensor) -> float:
    return float(part.sum()) / max(int(whole.sum()), 1)
