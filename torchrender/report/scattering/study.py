"""Scattering measured: errors against full integration and against rays, times, trends, baselines and a peer.

``python -m torchrender.report.scattering [--quick] [-o docs/results]`` writes ``scattering.md``, ``.json``,
``scattering.jpg``, ``scattering-film.jpg`` and ``scattering-cost.png``. Candidates take turns; nothing is kept between
their runs, so every time holds all set-up.
"""

from __future__ import annotations

import os
import sys
import time
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
from torchrender.report.scattering.probes import Probes
from torchrender.report.scattering.scenes import KINDS, eye, t1, t2
from torchrender.report.scattering.stage import QUICK, Stage, StudyOptions
from torchrender.report.scattering.streamed import after_steps
from torchrender.report.scattering.ways import published, ways
from torchrender.scene.light import PointLight

# ---------------------------------------------------------------- parts


def _timed(stage: Stage, how: dict[str, Any]) -> Callable[[], object]:
    return lambda: stage.layer(**how)


def costs(study: StudyOptions) -> dict[str, Any]:
    """Time against steps, panels, lights, and the share of rays that meet a medium."""
    stage = Stage.of(t2("lamp"), eye(*study.size), study.map_size)
    candidates: dict[str, dict[str, Any]] = {f"block {n}": {"block": n} for n in (1, 2, 3)}
    found = take_turns({k: _timed(stage, o) for k, o in candidates.items()}, runs=study.runs, warm_up=1)
    candidates = {f"{n} steps": {"way": "march", "steps": n, "block": 1} for n in (8, 16, 32, 64)}
    found |= take_turns({k: _timed(stage, o) for k, o in candidates.items()}, runs=1, warm_up=0)
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
    """T1 against the mean of 8 jittered rays of 1,024 steps in some pixels: the source's baselines."""
    stage = Stage.of(t1(), eye(*study.small), study.map_size)
    every = stage.light(block=1)
    probes = Probes.of(stage, every, study.probes)
    steps = min(1024, 2 * study.rays_steps)
    reference = torch.stack([probes.light(way="march", steps=steps, seed=s) for s in range(8)]).mean(0)
    medium = stage.scene.media[0]
    distance = stage.seen.depth[0].double().clamp_max(1e6)
    blend = (1 - torch.exp(-float(medium.extinction[0]) * distance)) * every.mean()
    pictures = {
        "all rays, 64 steps": stage.light(way="march", block=1),
        "all rays, 64 equal steps, scheme of the source": stage.light(
            way="march", block=1, scheme="source", equiangular=False
        ),
        "all rays, slices": every,
        "3 x 3, least squares": stage.light(block=3),
        "3 x 3, no gradient": stage.light(block=3, gradient="none"),
        "3 x 3, nearest (printed)": stage.light(block=3, gradient="nearest"),
        "3 x 3, bilinear, samples alone": _bilinear(stage, 3),
        "3 x 3, no division by length": _undivided(stage, 3),
        "plain fog blend": blend,
    }
    return {name: probes.errors(light, reference) for name, light in pictures.items()}


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

    def held_back(value: float) -> float:
        medium = replace(stage.scene.media[0], scattering=three(value), absorption=three(0.0))
        layer = replace(stage, scene=replace(stage.scene, media=(medium,))).layer(block=1)
        return 1.0 - float(layer.transmittance.mean())

    return {
        "share of surfaces' light held back: scattering 0.15 to 0.55, no absorption": [
            held_back(s) for s in (0.15, 0.25, 0.35, 0.45, 0.55)
        ],
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
        "picture": lambda: picture(study, folder / "scattering.jpg"),
    }
    record: dict[str, Any] = {"machine": machine_record(), "load": os.getloadavg()[0], "study": asdict(study)}
    for name, measure in parts.items():
        begin = time.perf_counter()
        record[name] = measure()
        sys.stderr.write(f"{name}: {time.perf_counter() - begin:.0f} s\n")
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
