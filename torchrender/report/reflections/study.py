"""Reflections measured: clustered depth images beside ray tracing and the environment map.

``python -m torchrender.report.reflections [--quick] [-o docs/results]`` writes ``reflections.md``, ``.json`` and a
picture. Every time counts what a scene that changes with every frame has to do again; candidates take turns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from PIL import Image as Picture
from torch import Tensor

from torchrender.buffers import ReflectionLayer
from torchrender.checks import checked_fields
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_record
from torchrender.quality.metrics import mean_absolute_error, psnr
from torchrender.quality.pages import write_record
from torchrender.quality.timing import take_turns
from torchrender.rays import RayCaster
from torchrender.report.common.command import study_parser
from torchrender.report.common.progress import part
from torchrender.report.reflections.errors import occlusion_errors
from torchrender.report.reflections.metal import metal_objects
from torchrender.report.reflections.page import write_page
from torchrender.report.reflections.race import HYBRID, candidates_of, race
from torchrender.report.reflections.stage import Stage
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

SCENES = ("living_room", "washroom")
THESIS = ClusterOptions(
    centre="thesis", aim="normal", plane_share=float("inf"), camera_share=0.0, deviation_deg=180.0, layers=1,
    search="secant", image_scale=1.0, lobe="cone", fade=True, share_rays=False,
)  # fmt: skip
"""The literal algorithm."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    rooms: tuple[str, ...] = SCENES  # the living room among them
    size: int = 512  # pixels of the pictures' side, one sample each
    triangles: int | None = None  # of the rooms; None: their usual number
    counts: tuple[int, ...] = (63_000, 289_000, 1_000_000, 3_000_000)
    outputs: tuple[int, ...] = (256, 512, 1024)
    sweep_size: int = 256  # of pictures in sweeps over settings and along paths
    gloss_size: int = 128  # and with gloss
    rules: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0)
    path: int = 4  # views along each path
    metal_size: int = 192
    metal_models: bool = True
    runs: int = 3


QUICK = StudyOptions(
    size=64, triangles=20_000, counts=(10_000, 20_000), outputs=(32, 64), rules=(0.5, 1.0), path=2,
    sweep_size=32, gloss_size=16, metal_size=32, metal_models=False, runs=1,
)  # fmt: skip


def main() -> None:
    """Command-line entry."""
    arguments = study_parser(__doc__, quick="small pictures: a test of the command").parse_args()
    folder = arguments.output
    folder.mkdir(parents=True, exist_ok=True)
    write_study(run_study(QUICK if arguments.quick else StudyOptions(), folder), folder)


def run_study(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """All measurements; the picture of both rooms goes to ``folder``."""
    record: dict[str, Any] = {"machine": machine_record(), "study": asdict(study)}
    rooms = {name: _room(name, study) for name in study.rooms}
    stages = {name: _stage(scene, study.size) for name, scene in rooms.items()}
    small = _stage(rooms["living_room"], study.sweep_size)
    parts: dict[str, Callable[[], Any]] = {
        "quality": lambda: {name: quality(stage) for name, stage in stages.items()},
        "times": lambda: {name: times(stage, study.runs) for name, stage in stages.items()},
        "clusters": lambda: [sweep(small, m) for m in study.rules],
        "scale": lambda: [image_scale(small, s) for s in (0.5, 1.0, 2.0)],
        "output": lambda: [output_size(small, n, study) for n in study.outputs],
        "triangles": lambda: [triangle_count(n, study) for n in study.counts],
        "paths": lambda: {name: path(rooms[name], study) for name in study.rooms},
        "gloss": lambda: list(gloss(rooms["living_room"], study)),
        "share": lambda: [pixel_share(stages[study.rooms[-1]], s, study) for s in (0.0, 0.01, 0.1, 0.3, 1.0)],
        "choices": lambda: {"living_room": choices(small)},
        "metal": lambda: metal_objects(study.metal_size, study.metal_models),
    }
    for name, measure in parts.items():
        with part(name):
            record[name] = measure()
    save_picture(torch.cat([error_picture(s) for s in stages.values()], dim=1), folder / "reflections.jpg")
    return record


def write_study(record: dict[str, Any], folder: Path) -> None:
    """The record as JSON and page."""
    write_record(folder / "reflections.json", record)
    write_page(record, folder)


# -------------------------------------------------------------------- parts


def quality(stage: Stage) -> dict[str, Any]:
    """Errors of clustered reflections and of the environment map against rays."""
    reference = stage.reference
    made = stage.clustered()
    missed = occlusion_errors(stage.scene, stage.pixels, made.cameras, stage.true_hits)
    planar = made.cameras.clusters.sizes[made.cameras.planar].sum() / len(stage.pixels)
    row: dict[str, Any] = {
        "reflective": stage.share,
        "clusters": len(made.cameras),
        "planar": float(planar),
        "occlusion": float(missed.float().mean()),
        "unanswered": float(made.unknown.mean()),
    }
    layers = {"clustered": made.layer, "environment": stage.environment()}
    layers["hybrid"] = stage.clustered(HYBRID).layer
    layers["as published"] = stage.clustered(THESIS).layer
    curved = ~made.cameras.planar[made.cameras.clusters.cluster]
    row["curved"] = _apart(stage, layers, curved) | {"occlusion": _share(missed[curved])}
    row["plane"] = _apart(stage, layers, ~curved) | {"occlusion": _share(missed[~curved])}
    for name, layer in layers.items():
        picture = stage.picture(layer)
        row[name] = {
            "channels": (255.0 * mean_absolute_error(picture, reference, mask=stage.mask())[0]).tolist(),
            "psnr": float(psnr(picture, reference)),
        }
    return row


def times(stage: Stage, runs: int) -> dict[str, Any]:
    """Whole reflection passes in turn, and the steps of the clustered one and of rays."""
    candidates = candidates_of(stage) | {"environment": stage.environment}
    measured = {k: t.record() for k, t in take_turns(candidates, runs=runs, warm_up=0).items()}
    begin = time.perf_counter()
    caster = RayCaster(stage.scene.geometry)
    built = time.perf_counter()
    stage.traced_hits(caster)
    cast = time.perf_counter()
    return {
        "candidates": measured,
        "clustered": dict(stage.clustered().elapsed_ms),
        "traced": {"tree": 1e3 * (built - begin), "rays": 1e3 * (cast - built)},
        "preparations": stage.preparations(),
    }


def sweep(stage: Stage, m: float) -> dict[str, Any]:
    """Table 15: cluster count against time and errors."""
    return _measured(stage, ClusterOptions(bin_factor=m, camera_share=0.0)) | {"bin_factor": m}


def image_scale(stage: Stage, scale: float) -> dict[str, Any]:
    """Table 17: size of the depth images."""
    return _measured(stage, ClusterOptions(image_scale=scale)) | {"scale": scale}


def choices(stage: Stage) -> dict[str, Any]:
    """The thesis's cameras and clusters beside what is beyond it."""
    basic = ("plane_share", "search", "lobe", "fade", "share_rays", "camera_share")
    named = {
        "as published": THESIS,
        "+ planes apart": replace(THESIS, **_defaults("plane_share")),
        "+ rays meet triangles": replace(THESIS, **_defaults("plane_share", "search", "lobe", "fade", "share_rays")),
        "+ small clusters join": replace(THESIS, **_defaults(*basic)),
        "+ cameras look along their rays": replace(THESIS, **_defaults(*basic, "aim")),
        "+ best centre": replace(THESIS, **_defaults(*basic, "aim", "centre")),
        "+ four layers": replace(THESIS, **_defaults(*basic, "aim", "centre", "layers")),
        "+ parted by deviation": replace(THESIS, **_defaults(*basic, "aim", "centre", "layers", "deviation_deg")),
        "+ finer images (default)": ClusterOptions(),
        "rest traced": ClusterOptions(missing="trace"),
    }
    return {name: _measured(stage, options) for name, options in named.items()}


def output_size(stage: Stage, size: int, study: StudyOptions) -> dict[str, Any]:
    """Table 16: pixels of the picture."""
    cameras = stage.scene.camera(width=size, height=size)
    runs = study.runs if size <= 512 else 2
    return race(stage.seen_from(cameras), cameras, runs) | {"size": size}


def triangle_count(count: int, study: StudyOptions) -> dict[str, Any]:
    """Table 18: triangles of the room."""
    scene = build("living_room", triangles=count)
    runs = study.runs if count <= 300_000 else 2
    cameras = scene.camera(width=study.size, height=study.size)
    return race(Stage.of(scene, cameras), cameras, runs) | {"triangles": scene.geometry.triangle_count}


def pixel_share(stage: Stage, share: float, study: StudyOptions) -> dict[str, Any]:
    """Cost of few reflective pixels."""
    part = stage.only(share)
    timing = take_turns({"clustered": part.clustered}, runs=study.runs, warm_up=0)["clustered"]
    return {"pixels": len(part.pixels), "ms": timing.least}


def path(scene: Scene, study: StudyOptions) -> dict[str, Any]:
    """Tables 13, 19 and 21: clusters, planar share and occlusion error along a path through the scene's cameras."""
    caster = RayCaster(scene.geometry)
    rows, views = [], list(_path_cameras(scene, study.path, study.sweep_size))
    first = Stage.of(scene, views[0])
    for cameras in views:
        stage = first.seen_from(cameras)
        made = stage.clustered()
        count = max(len(stage.pixels), 1)
        missed = occlusion_errors(scene, stage.pixels, made.cameras, stage.traced_hits(caster))
        rows.append(
            {
                "reflective": stage.share,
                "clusters": len(made.cameras),
                "planar": float(made.cameras.clusters.sizes[made.cameras.planar].sum()) / count,
                "occlusion": float(missed.float().sum()) / count,
                "ms": sum(made.elapsed_ms.values()),
            }
        )
    keys = rows[0].keys()
    return {k: {"max": max(r[k] for r in rows), "mean": sum(r[k] for r in rows) / len(rows)} for k in keys}


def gloss(room: Scene, study: StudyOptions) -> Iterator[dict[str, Any]]:
    """Table 20: lobes of several widths."""
    for degree in (0.1, 0.5):
        materials = tuple(replace(m, gloss=degree) if m.is_reflector else m for m in room.materials)
        scene = replace(room, materials=materials)
        scene.__dict__["geometry"] = room.geometry
        stage = _stage(scene, study.gloss_size)
        for rays in (8, 49):
            made = stage.clustered(ClusterOptions(glossy_rays=rays))
            begin = time.perf_counter()
            traced = stage.traced(rays=rays)
            took = 1e3 * (time.perf_counter() - begin)
            yield {
                "gloss": degree,
                "rays": rays,
                "marching": made.elapsed_ms.get("marching", 0.0),
                "clustered": sum(made.elapsed_ms.values()),
                "traced": took,
                "psnr": float(psnr(stage.picture(made.layer), stage.picture(traced))),
            }


# ------------------------------------------------------------------ helpers


def _apart(stage: Stage, layers: dict[str, ReflectionLayer], chosen: Tensor) -> dict[str, float]:
    """Mean absolute error of mirrored light, 0 to 255, clipped at white, of some reflective pixels, by way."""
    place = stage.pixels.pixel[chosen]
    wanted = stage.reference_layer.color.reshape(-1, 3)[place].clamp(0.0, 1.0)
    found = {name: layer.color.reshape(-1, 3)[place].clamp(0.0, 1.0) for name, layer in layers.items()}
    return {name: 255.0 * float((color - wanted).abs().mean()) if len(place) else 0.0 for name, color in found.items()}


def _share(chosen: Tensor) -> float:
    return float(chosen.float().mean()) if len(chosen) else 0.0


def error_picture(stage: Stage) -> Tensor:
    """(1,h,3w,3) display values: clustered, traced, and their difference times 50."""
    made, reference = stage.picture(stage.clustered().layer), stage.reference
    return torch.cat([made, reference, (50.0 * (made - reference).abs()).clamp(0.0, 1.0)], dim=2)


def save_picture(display: Tensor, file: Path) -> None:
    """Display values (1,h,w,3) as a JPEG."""
    picture = Picture.fromarray((display[0] * 255.0).round().byte().numpy())
    write_atomically(file, lambda path: picture.save(path, "JPEG", quality=85))


def _measured(stage: Stage, options: ClusterOptions) -> dict[str, Any]:
    """Clusters, milliseconds of one run, and errors."""
    made = stage.clustered(options)
    missed = occlusion_errors(stage.scene, stage.pixels, made.cameras, stage.true_hits, options)
    return {
        "clusters": len(made.cameras),
        "ms": sum(made.elapsed_ms.values()),
        "occlusion": float(missed.float().mean()),
        "psnr": float(psnr(stage.picture(made.layer), stage.reference)),
    }


def _defaults(*names: str) -> dict[str, Any]:
    return {name: getattr(ClusterOptions(), name) for name in names}


def _room(name: str, study: StudyOptions) -> Scene:
    return build(name) if study.triangles is None else build(name, triangles=study.triangles)


def _stage(scene: Scene, size: int) -> Stage:
    return Stage.of(scene, scene.camera(width=size, height=size))


def _path_cameras(scene: Scene, count: int, size: int) -> Iterator[Cameras]:
    """Views on straight pieces between the scene's cameras, eye and target alike."""
    cameras = [scene.camera(name, width=size, height=size) for name in scene.cameras]
    eyes = torch.cat([c.eye for c in cameras])
    targets = eyes + torch.cat([c.forward for c in cameras])
    for place in torch.linspace(0.0, len(cameras) - 1.0, count).tolist():
        first = min(int(place), len(cameras) - 2)
        eye, target = (torch.lerp(x[first], x[first + 1], place - first) for x in (eyes, targets))
        yield Cameras.look_at(eye, target, width=size, height=size, fov_deg=60.0, near=float(cameras[0].near[0]))
