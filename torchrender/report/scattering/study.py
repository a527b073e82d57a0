"""Scattering measured: errors against full integration and against rays, times, trends, baselines and a peer.

``python -m torchrender.report.scattering [--quick] [-o docs/results]`` writes ``scattering.md``, ``.json``,
``scattering.jpg``, ``scattering-film.jpg`` and ``scattering-cost.png``. Candidates take turns; nothing is kept between
their runs, so every time holds all set-up.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image as Picture
from torch import Tensor

from torchrender.effects.media.between import NOWHERE, between
from torchrender.effects.media.eye_rays import eye_of, rays_of
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import MediaTable
from torchrender.images.files import write_atomically
from torchrender.kernels.media.records import Scattered
from torchrender.numerics.color import srgb_from_linear
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record
from torchrender.quality.timing import take_turns
from torchrender.report.common.command import study_parser
from torchrender.report.scattering.motion import edits, film
from torchrender.report.scattering.page import plot, write_page
from torchrender.report.scattering.peers import beside_mitsuba
from torchrender.report.scattering.scenes import KINDS, eye, t1, t2
from torchrender.report.scattering.stage import QUICK, Stage, StudyOptions, errors, shaft_edges
from torchrender.report.scattering.streamed import after_steps
from torchrender.scene.light import PointLight

# ---------------------------------------------------------------- parts


def published(study: StudyOptions) -> list[dict[str, Any]]:
    """The table of T1: blocks, guard and gradients against all rays, without shadows."""
    stage = Stage.of(t1(), eye(*study.small), study.map_size, shadows=False)
    every = stage.light(block=1, way="march", steps=128, jitter=False)
    rows = []
    for block, guard, gradient in (
        (3, 0, "none"), (3, 0, "nearest"), (3, 0, "lsq"), (3, 20, "lsq"), (2, 20, "lsq"),
    ):  # fmt: skip
        how = {"block": block, "halo_guard_px": guard, "gradient": gradient}
        layer = stage.layer(way="march", steps=128, jitter=False, **how)
        row = {**how, "marched": float(layer.integrated.mean())}
        rows.append(row | errors(layer.scattered[0, ..., 0].double(), every))
    return rows


def ways(study: StudyOptions) -> list[dict[str, Any]]:
    """T1 and T2: errors against the walk and against rays, and milliseconds of the picture with all set-up."""
    rows = []
    cases = [("T1", "lamp", t1), ("T2", "sun", lambda k: t2("sun", k)), ("T2", "lamp", lambda k: t2("lamp", k))]
    for name, light, make in cases:
        for kind in KINDS:
            focal = 0.9 * study.size[0]
            stage = Stage.of(make(kind), eye(*study.size, focal), study.map_size)
            small = Stage.of(make(kind), eye(*study.small, 0.9 * study.small[0]), study.map_size)
            walk = stage.light(way="walk", block=1, panels=32)
            rays = small.light(way="march", shadows="rays", block=1, steps=study.rays_steps)
            edge, small_edge = shaft_edges(walk), shaft_edges(rays)
            rows += _ways_of(stage, small, (walk, edge), (rays, small_edge), study, f"{name} {light}, {kind}")
    return rows


def _ways_of(
    stage: Stage, small: Stage, walk: tuple[Tensor, Tensor], rays: tuple[Tensor, Tensor], study: StudyOptions, name: str
) -> list[dict[str, Any]]:
    plans: dict[str, dict[str, Any]] = {
        "walk": {"way": "walk", "block": 1},
        "slices": {"way": "slices", "block": 1},
        "slices, 2 x 2": {"way": "slices", "block": 2},
        "slices, 3 x 3": {"way": "slices", "block": 3},
        "walk, 3 x 3": {"way": "walk", "block": 3},
        "walk, 3 x 3, marks by length alone": {"way": "walk", "block": 3, "share_tolerance": 1.0},
        "64 steps": {"way": "march", "block": 1},
        "64 steps, 3 x 3": {"way": "march", "block": 3},
    }
    timed = take_turns({k: _timed(stage, o) for k, o in plans.items()}, runs=study.runs, warm_up=1)
    rows = []
    for label, how in plans.items():
        layer = stage.layer(**how)
        against_walk = errors(layer.scattered[0, ..., 0].double(), *walk)
        against_rays = errors(small.light(**how), *rays)
        rows.append({
            "case": name, "way": label, "ms": timed[label].median, "least_ms": timed[label].least,
            "walk": against_walk, "rays": against_rays, "share": float(layer.integrated.mean()),
        })  # fmt: skip
    return rows


def _timed(stage: Stage, how: dict[str, Any]) -> Callable[[], object]:
    return lambda: stage.layer(**how)


def costs(study: StudyOptions) -> dict[str, Any]:
    """Time against steps, panels, lights, and the share of rays that meet a medium."""
    stage = Stage.of(t2("lamp"), eye(*study.size), study.map_size)
    candidates = {f"{n} steps": {"way": "march", "steps": n, "block": 1} for n in (16, 32, 64, 128)}
    candidates |= {f"block {n}": {"block": n} for n in (1, 2, 3)}
    found = take_turns({k: _timed(stage, o) for k, o in candidates.items()}, runs=study.runs, warm_up=1)
    lights: dict[str, Callable[[], object]] = {}
    for count in (1, 2, 4, 8):
        lamps = tuple(PointLight(position=torch.tensor([1.0 - 0.3 * k, 1.2, -4.5 + 0.4 * k])) for k in range(count))
        many = Stage.of(replace(stage.scene, lights=lamps), stage.camera, study.map_size)
        lights[str(count)] = _timed(many, {})
    shares: dict[str, Callable[[], object]] = {}
    for right in (3.0, 1.0, 0.0, -1.5, -2.49):
        medium = replace(stage.scene.media[0], high=torch.tensor([right, 2.5, 1.0]))
        part = replace(stage, scene=replace(stage.scene, media=(medium,)))
        met = float((part.layer(block=1).transmittance[..., 0] < 1).float().mean())
        shares[f"{met:.3f}"] = _timed(part, {})
    beside = replace(stage.scene.media[0], low=torch.tensor([0.0, 0.0, 3.0]), high=torch.tensor([1.0, 1.0, 4.0]))
    shares["0, behind the camera"] = _timed(replace(stage, scene=replace(stage.scene, media=(beside,))), {})
    return {
        "ways": {k: t.record() for k, t in found.items()},
        "lights": {k: t.record() for k, t in take_turns(lights, runs=study.runs, warm_up=1).items()},
        "shares": {k: t.record() for k, t in take_turns(shares, runs=study.runs, warm_up=1).items()},
    }


def baselines(study: StudyOptions) -> dict[str, dict[str, float]]:
    """T1 against 8 jittered rays' worth of 1,024 steps: the source's baselines."""
    stage = Stage.of(t1(), eye(*study.small), study.map_size)
    reference = torch.stack([
        stage.light(way="march", steps=min(1024, 2 * study.rays_steps), block=1, seed=s) for s in range(8)
    ]).mean(0)  # fmt: skip
    medium = stage.scene.media[0]
    distance = stage.seen.depth[0].double().clamp_max(1e6)
    blend = (1 - torch.exp(-float(medium.extinction[0]) * distance)) * reference.mean()
    return {
        "all rays, 64 steps": errors(stage.light(way="march", block=1), reference),
        "all rays, slices": errors(stage.light(block=1), reference),
        "3 x 3, least squares": errors(stage.light(block=3), reference),
        "3 x 3, no gradient": errors(stage.light(block=3, gradient="none"), reference),
        "3 x 3, nearest (printed)": errors(stage.light(block=3, gradient="nearest"), reference),
        "3 x 3, bilinear, samples alone": errors(_bilinear(stage, 3), reference),
        "3 x 3, no division by length": errors(_undivided(stage, 3), reference),
        "plain fog blend": errors(blend, reference),
    }


def _bilinear(stage: Stage, block: int) -> Tensor:
    """Light of one pixel per block, the others between these."""
    every = stage.light(block=1)
    few = every[block // 2 :: block, block // 2 :: block]
    mode = {"size": every.shape, "mode": "bilinear", "align_corners": False}
    return torch.nn.functional.interpolate(few[None, None], **mode)[0, 0]  # type: ignore[arg-type]


def _undivided(stage: Stage, block: int) -> Tensor:
    """The source's interpolation with light itself in place of light per length."""
    camera, seen = stage.camera, stage.seen
    table = MediaTable.of(stage.scene.media, eye_of(camera))
    rays = rays_of(camera, seen.depth[0], table, seen.position[0])
    options = ScatterOptions(block=block)
    every = stage.layer(block=1).scattered[0, ..., :1].reshape(-1, 1).numpy()

    def integrate(rows: np.ndarray, out: Scattered) -> None:
        out.radiance[rows] = every[rows]

    found, _ = between(integrate, rays, torch.ones_like(rays.length), NOWHERE, 1, options)
    return torch.from_numpy(found).double().reshape(rays.shape)


def trends(study: StudyOptions) -> dict[str, list[float]]:
    """Mean light of T1 with more scattering, more absorption, and the phase function from back to forward."""
    stage = Stage.of(t1(), eye(*study.small), study.map_size)

    def mean(**changes: Any) -> float:
        medium = replace(stage.scene.media[0], **changes)
        return float(replace(stage, scene=replace(stage.scene, media=(medium,))).light(block=1).mean())

    def three(value: float) -> Tensor:
        return torch.full((3,), value)

    return {
        "scattering 0.02 to 0.1, no absorption": [
            mean(scattering=three(s), absorption=three(0.0)) for s in (0.02, 0.04, 0.06, 0.08, 0.1)
        ],
        "absorption 0 to 0.8, scattering 0.3": [mean(absorption=three(a)) for a in (0.0, 0.2, 0.4, 0.6, 0.8)],
        "g -0.6 to 0.6, scattering 0.5": [
            mean(scattering=three(0.5), asymmetry=g) for g in (-0.6, -0.3, 0.0, 0.3, 0.6)
        ],
    }


def picture(study: StudyOptions, path: Path) -> None:
    """T1, T2 with lamp and sun, for the three media."""
    rows = []
    width, height = (max(s // 2, 16) for s in study.size)
    for make in (t1, lambda k: t2("lamp", k), lambda k: t2("sun", k)):
        images = []
        for kind in KINDS:
            light = Stage.of(make(kind), eye(width, height), study.map_size).light()
            top = light.reshape(-1).kthvalue(int(0.995 * light.numel())).values
            images.append(srgb_from_linear((light / top).clamp(0, 1).float()))
        rows.append(torch.cat(images, dim=1))
    sheet = (torch.cat(rows) * 255).round().to(torch.uint8).numpy()
    write_atomically(path, lambda file: Picture.fromarray(sheet).save(file, format="JPEG", quality=88))


# ---------------------------------------------------------------- command


def run_study(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """All measurements; the picture goes to ``folder``."""
    parts: dict[str, Callable[[], Any]] = {
        "published": lambda: published(study),
        "ways": lambda: ways(study),
        "costs": lambda: costs(study),
        "baselines": lambda: baselines(study),
        "trends": lambda: trends(study),
        "film": lambda: film(study, folder),
        "edits": lambda: edits(study),
        "streamed": lambda: after_steps(study.film[0] * 2),
        "peer": lambda: beside_mitsuba(study),
    }
    record: dict[str, Any] = {"machine": machine_record(), "load": os.getloadavg()[0], "study": asdict(study)}
    for name, measure in parts.items():
        record[name] = measure()
        sys.stderr.write(f"{name}: measured\n")
    picture(study, folder / "scattering.jpg")
    write_atomically(folder / "scattering-cost.png", lambda path: plot(path, record["costs"]))
    return record


def main() -> None:
    """Command-line entry."""
    arguments = study_parser(__doc__, quick="small pictures: a test of the command").parse_args()
    folder = arguments.output
    folder.mkdir(parents=True, exist_ok=True)
    record = run_study(QUICK if arguments.quick else StudyOptions(), folder)
    write_record(folder / "scattering.json", record)
    write_page(record, folder / "scattering.md")
