"""Point models measured: ``python -m torchrender.report.points [--quick] [--seconds 200] [-o docs/results]``.

Writes ``points.md``, ``.json`` and ``.png``; ``--seconds`` ends a run early, and the next goes on. There are
tables 3.1 and 3.2 of the published method remade, quality and time by filter against supersampled references, errors of
compression, models of up to ten million points, and pyvista.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from skimage.metrics import structural_similarity
from torch import Tensor

from torchrender.checks import checked_fields
from torchrender.images.files import write_image
from torchrender.points.cloud import PointCloud
from torchrender.points.codec import compress, decompress, half_extent
from torchrender.points.draw import render_points
from torchrender.points.file import open_points, write_points
from torchrender.points.options import PointImage, SplatOptions
from torchrender.points.select import SelectionOptions
from torchrender.points.tree import PatchOptions, PatchSet, PlainNodes, build_patches
from torchrender.quality.machine import machine_record
from torchrender.quality.metrics import psnr
from torchrender.quality.pages import write_record
from torchrender.quality.timing import take_turns
from torchrender.report.common.command import run_in_parts
from torchrender.report.common.parts import Parts
from torchrender.report.points.models import (
    SCANS,
    Maker,
    Model,
    bumpy_sphere,
    close_camera,
    ground,
    ground_reference,
    models,
)
from torchrender.report.points.page import write_page
from torchrender.report.points.peers import pyvista_points
from torchrender.scene.camera import Cameras
from torchrender.tuning.systems.points import drawn_surfaces

FILTERS = ("adaptive", "full", "reconstruction", "low_pass", "squares")
DEEPEST = SelectionOptions(level="deepest")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    meshes: tuple[tuple[str, str, int], ...] = (  # published name, file, samples as published
        ("Dragon", "stanford_dragon_res2.ply", 1_280_000),
        ("Armadillo (for Hip)", "armadillo.ply", 530_000),
        ("Bunny (for Hand)", "stanford_bunny.ply", 330_000),
    )
    scans: tuple[str, ...] = SCANS
    counts: tuple[int, ...] = (1_000_000, 3_000_000, 10_000_000)
    size: int = 512
    peer: tuple[int, int] = (1_000_000, 1024)  # points and pixels of a side
    factor: int = 8  # reference samples per side of a pixel
    runs: int = 9
    one_pixel: int = 10_000_000


QUICK = StudyOptions(
    meshes=(("Bunny (for Hand)", "stanford_bunny.ply", 20_000),), scans=("kitten_normals",), counts=(30_000,), size=96,
    peer=(5_000, 64), factor=4, runs=2, one_pixel=50_000,
)  # fmt: skip


def run(study: StudyOptions, folder: Path, parts: Parts) -> list[Path]:
    """Measure everything and write the page; pictures are written with their parts."""
    record: dict[str, Any] = {"machine": machine_record(), "study": asdict(study)}
    makers = models(study.meshes, study.scans, study.counts[0])
    record["models"] = {
        name: parts.measured(f"model {name}", partial(_row, make, study)) for name, make in makers.items()
    }
    first = next(iter(makers.values()))
    pictures = folder / "points.png", folder / "points-ground.png"
    record["quality"] = parts.measured("quality by filter", lambda: _shown(quality(first(), study), pictures[0]))
    record["aliasing"] = parts.measured("minified ground", lambda: _shown(aliasing(), pictures[1]))
    record["compression"] = parts.measured("compression", lambda: compression(first().cloud, study, folder))
    record["scaling"] = {str(n): parts.measured(f"{n:,} points", partial(scaling, n, study)) for n in study.counts}
    record["one_pixel"] = parts.measured("all in one pixel", partial(one_pixel, study))
    record["peer"] = parts.measured("pyvista", partial(peer, study))
    write_record(folder / "points.json", record)
    write_page(record, folder)
    return [folder / "points.json", folder / "points.md", *pictures]


def _row(make: Maker, study: StudyOptions) -> dict[str, Any]:
    return model_row(make().cloud, study)


def _shown(found: tuple[dict[str, Any], list[Tensor]], path: Path) -> dict[str, Any]:
    """The record of a part whose pictures are written, side by side."""
    write_image(path, torch.cat(found[1], dim=1))
    return found[0]


# ------------------------------------------------------------------ sections


def model_row(cloud: PointCloud, study: StudyOptions) -> dict[str, Any]:
    """One row of table 3.2: points, drawn points and frames per second at the published size."""
    patches = build_patches(cloud)
    camera = close_camera(cloud, study.size)
    work = {
        "adaptive": lambda: render_points(patches, camera),
        "full": lambda: render_points(patches, camera, SplatOptions(filter="full")),
        "squares": lambda: render_points(patches, camera, SplatOptions(filter="squares")),
        "deepest": lambda: render_points(patches, camera, SplatOptions(selection=DEEPEST)),
    }
    times = take_turns(work, runs=study.runs)
    found = render_points(patches, camera)
    return {
        "statistics": asdict(found.statistics[0]),
        "drawn_deepest": work["deepest"]().statistics[0].drawn,
        "covered": float(found.mask.float().mean()),
        "ms": {name: t.record() for name, t in times.items()},
    }


def quality(model: Model, study: StudyOptions) -> tuple[dict[str, Any], list[Tensor]]:
    """Time and errors of every filter, at the levels chosen and at the deepest, near and far."""
    patches = build_patches(model.cloud)
    rows: dict[str, Any] = {}
    pictures: list[Tensor] = []
    near = close_camera(model.cloud, study.size)
    centre = model.cloud.bounds.mean(0)
    far = Cameras.look_at(
        centre + 4 * (near.eye[0] - centre), centre, width=study.size, height=study.size, fov_deg=40,
        near=float(near.near[0]),
    )  # fmt: skip
    for place, camera in (("close", near), ("far", far)):
        truth = None if model.scene is None else drawn_surfaces(model.scene, camera, SplatOptions(), study.factor)
        for level in ("auto", "deepest"):
            selection = SelectionOptions(level=level)
            options = {name: SplatOptions(filter=name, selection=selection) for name in FILTERS}
            options["adaptive, by point"] = SplatOptions(choice="point", selection=selection)
            options["adaptive, by axes"] = SplatOptions(choice="point", test="eigen", selection=selection)
            work = {name: partial(render_points, patches, camera, o) for name, o in options.items()}
            drawn = {name: draw() for name, draw in work.items()}
            times = take_turns(work, runs=study.runs)
            rows[f"{place}, {level}"] = {
                name: {"ms": times[name].record(), **errors(picture, drawn["full"], truth)}
                for name, picture in drawn.items()
            }
            if level == "auto" and place == "close":
                pictures = [drawn[name].image[0] for name in ("adaptive", "squares")]
                pictures += [] if truth is None else [truth[0]]
    return rows, pictures


def errors(drawn: PointImage, full: PointImage, truth: tuple[Tensor, Tensor] | None) -> dict[str, Any]:
    """PSNR to full EWA; PSNR, SSIM, holes and wrong outline pixels against the reference."""
    s = drawn.statistics[0]
    row: dict[str, Any] = {
        "drawn": s.drawn, "full": s.full, "reconstruction": s.reconstruction, "low_pass": s.low_pass,
        "evaluations": s.evaluations, "psnr_full": float(psnr(drawn.image, full.image)),
    }  # fmt: skip
    if truth is not None:
        image, coverage = truth
        mask = drawn.mask[0]
        inside, outside = coverage > 0.999, coverage < 0.001
        partly = ~inside & ~outside
        row |= {
            "psnr": float(psnr(drawn.image, image[None])),
            "ssim": float(structural_similarity(drawn.image[0].numpy(), image.numpy(), channel_axis=2, data_range=1.0)),
            "holes": int((inside & ~mask).sum()),
            "outline": float((mask & outside).sum()) / max(int(partly.sum()), 1),
        }
    return row


def aliasing() -> tuple[dict[str, Any], list[Tensor]]:
    """A checkered ground to the horizon, against 16 x 16 rays a pixel: the whole, and its minified part."""
    patches = build_patches(ground(), PatchOptions(max_points=256))
    camera = Cameras.look_at([0.0, 1.5, 0.0], [0.0, 0.0, -8.0], width=128, height=128, fov_deg=50, near=0.1)
    value, share, distance = ground_reference(camera, 16)
    whole = share > 0.999
    parts = {"all": whole, "far": whole & (distance > 12)}
    rows, pictures = {}, []
    cases = {name: SplatOptions(filter=name, choice="point", shading="none", selection=DEEPEST) for name in FILTERS}
    cases["adaptive, by axes"] = replace(cases["adaptive"], test="eigen")
    cases["adaptive, with levels"] = SplatOptions(shading="none")
    for name, options in cases.items():
        drawn = render_points(patches, camera, options)
        grey, wanted = drawn.image[..., :1], value[None, ..., None]
        rows[name] = {part: float(psnr(grey, wanted, mask=chosen[None])) for part, chosen in parts.items()}
        rows[name]["holes"] = int((whole & ~drawn.mask[0]).sum())
        s = drawn.statistics[0]
        rows[name] |= {"full": s.full, "reconstruction": s.reconstruction, "low_pass": s.low_pass,
                       "evaluations": s.evaluations}  # fmt: skip
        if name in FILTERS:
            pictures.append(drawn.image[0])
    pictures.append(value.float()[..., None].expand(-1, -1, 3))
    return rows, [p.repeat_interleave(2, 0).repeat_interleave(2, 1) for p in pictures]


def compression(cloud: PointCloud, study: StudyOptions, folder: Path) -> dict[str, Any]:
    """Table 3.1: bytes, and what they cost in position, normal, radius and picture; reading from the file."""
    plain = build_patches(cloud)
    camera = close_camera(cloud, study.size)
    before = render_points(plain, camera)
    out: dict[str, Any] = {"points": len(cloud), "nodes": len(plain.nodes), "normals": {}}
    for normals in ("angles", "octahedron"):
        packed = compress(plain, normals=normals)
        row = node_errors(plain, decompress(packed))
        row["psnr"] = float(psnr(render_points(packed, camera).image, before.image))
        out["normals"][normals] = row
    path = folder / ".points-study.trp"
    try:
        out["file_bytes"] = write_points(path, plain)
        points = open_points(path)
        closer = Cameras.look_at(
            camera.eye[0] + 0.6 * (cloud.bounds.mean(0) - camera.eye[0]), cloud.bounds.mean(0), width=study.size,
            height=study.size, fov_deg=15, near=1e-4 * cloud.diagonal,
        )  # fmt: skip
        out["close_up_bytes"] = render_points(points, closer).statistics[0].bytes_read
        work = {"in memory": lambda: render_points(plain, camera), "from file": lambda: render_points(points, camera)}
        out["ms"] = {name: t.record() for name, t in take_turns(work, runs=study.runs).items()}
    finally:
        path.unlink(missing_ok=True)
    return out


def node_errors(plain: PatchSet, found: PatchSet) -> dict[str, float]:
    """Errors of decoded nodes: position by the patch's box, normals in degrees, radii relative."""
    a, b = plain.nodes, found.nodes
    assert isinstance(a, PlainNodes) and isinstance(b, PlainNodes)
    start = plain.headers.start
    extent = (2 * half_extent(plain.headers)).repeat_interleave(start[:, -1] - start[:, 0], dim=0)
    position = (a.position - b.position).abs() / extent.clamp_min(1e-300)
    cosine = (a.normal.double() * b.normal.double()).sum(1).clamp(-1, 1)
    angle = torch.rad2deg(cosine[a.normal.abs().sum(1) > 0].acos())
    radius = ((a.radius - b.radius).abs() / a.radius).double()
    return {
        "position_max": float(position.max()),
        "normal_mean": float(angle.mean()),
        "normal_max": float(angle.max()),
        "radius_mean": float(radius.mean()),
        "radius_max": float(radius.max()),
    }


def scaling(count: int, study: StudyOptions) -> dict[str, Any]:
    """A synthetic model: time to build and compress, memory, and frames per second of the compressed points."""
    cloud = bumpy_sphere(count)
    begin = time.perf_counter()
    plain = build_patches(cloud)
    built = time.perf_counter()
    packed = compress(plain)
    done = time.perf_counter()
    camera = close_camera(cloud, study.size)
    headers = packed.headers
    tables = sum(t.numel() * t.element_size() for t in vars(headers).values())
    work = {"plain": lambda: render_points(plain, camera), "compressed": lambda: render_points(packed, camera)}
    times = take_turns(work, runs=study.runs)
    return {
        "build_s": built - begin,
        "compress_s": done - built,
        "patches": len(headers),
        "nodes": len(plain.nodes),
        "bytes_per_point": (8 * len(plain.nodes) + tables) / count,
        "statistics": asdict(render_points(packed, camera).statistics[0]),
        "ms": {name: t.record() for name, t in times.items()},
    }


def one_pixel(study: StudyOptions) -> dict[str, Any]:
    """All points of a model in one pixel."""
    count = study.one_pixel
    g = np.random.default_rng(0)
    cloud = PointCloud(
        position=torch.from_numpy(g.normal(size=(count, 3)) * 1e-5),
        normal=torch.tensor([0.0, 0.0, 1.0]).expand(count, 3),
        radius=torch.full((count,), 1e-6),
    )
    patches = build_patches(cloud, PatchOptions(max_points=65536))
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=study.size, height=study.size)
    out: dict[str, Any] = {"points": count}
    for name, selection in (("levels", SelectionOptions()), ("deepest", DEEPEST)):
        begin = time.perf_counter()
        drawn = render_points(patches, camera, SplatOptions(selection=selection))
        out[name] = {"ms": 1e3 * (time.perf_counter() - begin), "drawn": drawn.statistics[0].drawn}
        out[name]["finite"] = bool(torch.isfinite(drawn.image).all())
    return out


def peer(study: StudyOptions) -> dict[str, Any]:
    """The same points by pyvista's Gaussian points; frames of both in turn."""
    count, size = study.peer
    cloud = bumpy_sphere(count)
    camera = close_camera(cloud, size)
    patches = build_patches(cloud)
    work = {
        "levels": lambda: render_points(patches, camera),
        "deepest": lambda: render_points(patches, camera, SplatOptions(selection=DEEPEST)),
    }
    times = {name: t.record() for name, t in take_turns(work, runs=study.runs).items()}
    return {"points": count, "size": size, "ms": times, "pyvista": pyvista_points(cloud, camera, 3)}


def main(argv: Sequence[str] | None = None) -> None:
    """The command."""
    run_in_parts(
        __doc__,
        lambda folder, quick, parts: run(QUICK if quick else StudyOptions(), folder, parts),
        "points",
        quick="small models and pictures: checks that it works",
        argv=argv,
    )
