"""Measure reprojection: ``python -m torchrender.report.reproject [--quick]``.

Writes ``docs/results/reproject.md``, ``.json`` and ``.png``: three depth images drawn from a viewpoint between them, by
every method and by plain torch; times taken in turn, and the pictures beside a render of the scene itself.
"""

from __future__ import annotations

import sys
from dataclasses import replace
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
SPREAD = 0.05  # side of the triangle of viewpoints, bounding-box diagonals
UNKNOWN = (1.0, 0.0, 1.0)


def main() -> None:
    """Run every measurement and write the page."""
    arguments = study_parser(__doc__, quick="small images and few runs, to check that it works").parse_args()
    run(arguments.output, *((256, 3) if arguments.quick else (1024, 11)))


def run(folder: Path, size: int, runs: int, triangles: int | None = None) -> None:
    """Measure at ``size`` pixels and write the page; ``triangles``: of each scene, None for the usual number."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"machine": machine_record(), "size": size, "scenes": {}}
    rows = []
    for name in SCENES:
        for method in ("conventional", "nonredundant"):
            found, pictures = measure(build(name, triangles=triangles), method, size, runs)
            record["scenes"][f"{name}, {method}"] = found
            rows.append(torch.cat([smaller(p) for p in pictures], dim=1))
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
        "hybrid": lambda: reproject(images, target),
        "hybrid, offset images": lambda: reproject(images, target, offset_images=offset),
        "hybrid, corners fitted before": lambda: reproject(quads, target),
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
    lines = ["# Reprojection", "", machine_line(record["machine"]), ""]
    lines += [f"Three {size} x {size} depth images drawn at {size} x {size} from the viewpoint between them.", ""]
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


def _share(part: Tensor, whole: Tensor) -> float:
    return float(part.sum()) / max(int(whole.sum()), 1)
