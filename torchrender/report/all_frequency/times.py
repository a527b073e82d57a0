"""Times: pictures of points by spheres, terms and levels; of stages; of fits; of pictures of a character that moves."""

from __future__ import annotations

from dataclasses import replace
from itertools import count as counting
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.sky_shadows.fit import fit_spheres
from torchrender.effects.sky_shadows.light import prepare_light
from torchrender.effects.sky_shadows.occluder import joined
from torchrender.effects.sky_shadows.options import SkyLightOptions, SphereOptions
from torchrender.effects.sky_shadows.shade import caps_of, hidden_bits, samples_of, with_bodies
from torchrender.kernels.sky_shadows.light import hidden_words
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.timing import take_turns
from torchrender.renderer import render
from torchrender.report.all_frequency.accuracy import shaded
from torchrender.report.all_frequency.stage import Stage
from torchrender.report.all_frequency.ways import texel_sum
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import plane, torus

TERMS = (50, 200)
PART = 1024
"""Points of the plain sum, which would take seconds for all."""


def times(at: Stage, environment: Environment, runs: int) -> dict[str, Any]:
    """Least milliseconds for all points, by spheres, terms and levels; of stages; of a light that turns."""
    lights = {
        (terms, level): prepare_light(environment, SkyLightOptions(terms=terms, levels=level))
        for terms in TERMS
        for level in (1, 2)
    }
    work: dict[str, Any] = {
        f"{count},{terms},{level}": lambda s=spheres, one=light: shaded(at.points, at.normals, s, one)
        for count, spheres in at.spheres.items()
        for (terms, level), light in lights.items()
    }
    stages = _stages(at, environment)
    taken = take_turns(work | stages, runs=runs, warm_up=1)
    least = {name: timing.least for name, timing in taken.items()}
    least["plain sum over texels"] *= len(at.points) / PART
    return {"all": {name: least[name] for name in work}, "stages": {name: least[name] for name in stages}}


def _stages(at: Stage, environment: Environment) -> dict[str, Any]:
    spheres = at.spheres[64]
    samples = samples_of(at.points, at.normals)
    rows, words = with_bodies(spheres), np.zeros((len(at.points), 96), np.int64)
    light, angle, part = prepare_light(environment), counting(1), slice(0, PART)
    caps = {name: caps_of(SkyLightOptions(direct_bits=way)) for name, way in (("table", False), ("one by one", True))}

    def plain() -> Tensor:
        bits = hidden_bits(at.points[None, part], at.normals[None, part], spheres[None], light.options)[0]
        return texel_sum(bits, at.normals[part], light)

    return {
        "caps by table": lambda: hidden_words(samples, rows, caps["table"], words),
        "caps one by one": lambda: hidden_words(samples, rows, caps["one by one"], words),
        "light that turns": lambda: prepare_light(replace(environment, rotation_deg=float(next(angle)))),
        "plain sum over texels": plain,
    }


def fits(folder: Path, options: SphereOptions, *, quick: bool) -> list[dict[str, Any]]:
    """What stands out of a torus and of a scanned figure, and how long that took to find."""
    ring = torus(1.0, 0.35, 48)
    rows: list[tuple[str, Tensor, Tensor, float | None]] = [
        (f"torus, {n}", ring.vertices.double(), ring.faces, asked)
        for n, asked in ((16, 0.30), (32, 0.10), (64, 0.06))
        if n == 16 or not quick
    ]
    if not quick:
        vertices, faces = joined(load(folder / "meshes" / "armadillo.ply").meshes)
        rows.append(("armadillo, 64", vertices, faces, None))
    made = []
    for name, vertices, faces, asked in rows:
        begin = perf_counter()
        found = fit_spheres(vertices, faces, replace(options, spheres=int(name.split()[-1])))
        took = perf_counter() - begin
        points = torch.cat([vertices, vertices[faces].mean(1)])
        labels = torch.cat([found.vertex_sphere, found.face_sphere])
        out = (points - found.centres[labels]).norm(dim=-1) > found.radii[labels] * (1 + 1e-9)
        used = torch.cat([torch.unique(faces), torch.arange(len(faces)) + len(vertices)])
        made.append(
            {"name": name, "error": found.relative_error, "asked": asked, "s": took, "out": int(out[used].sum())}
        )
    return made


def on_floor(scene: Scene, environment: Environment) -> Scene:
    """A figure on a floor under a sky, and no other light."""
    low, high = scene.bounds
    tall = float((high - low).max())
    floor = plane(torch.tensor([4.0 * tall, 4.0 * tall]), 1, 1.0)
    middle = torch.tensor([float(low[0] + high[0]) / 2, float(low[1]), float(low[2] + high[2]) / 2]).double()
    floor = replace(floor, vertices=floor.vertices + middle, name="floor", material=len(scene.materials))
    stone = Material(name="stone", diffuse=torch.tensor([0.62, 0.6, 0.57]))
    return replace(
        scene, meshes=(*scene.meshes, floor), materials=(*scene.materials, stone), lights=(),
        ambient=torch.zeros(3), environment=environment,
    )  # fmt: skip


def view_of(figure: Scene) -> tuple[Cameras, float]:
    """A camera of 512 x 512 that sees a figure from above and beside, and how tall that is."""
    low, high = figure.bounds
    middle, tall = (low + high) / 2, float((high - low).max())
    eye = middle + torch.tensor([1.15, 0.75, 1.25]).double() * tall
    return Cameras.look_at(eye, middle, width=512, height=512, fov_deg=45.0), tall


def walking(folder: Path, environment: Environment) -> tuple[Scene, Cameras, float]:
    """A character on a floor, a camera, and how tall the character is."""
    figure = load(folder / "characters" / "CesiumMan.glb")
    return on_floor(figure, environment), *view_of(figure)


def moving(folder: Path, environment: Environment, frames: int) -> dict[str, Any]:
    """Milliseconds of pictures of 512 x 512 of a character that walks, with its shadow and without; some pictures."""
    scene, camera, _ = walking(folder, environment)
    ways = {"with": RenderOptions(), "without": RenderOptions(shadows=False, ambient_visibility="off")}
    history = {name: RenderHistory() for name in ways}
    duration = next(iter(scene.animations.values()))
    ms: dict[str, list[float]] = {name: [] for name in ("move", *ways)}
    own: list[float] = []
    pictures: list[Tensor] = []
    for number in range(-2, frames):  # two pictures to compile and to fit
        begin = perf_counter()
        now = scene.at(duration * (number % frames) / frames)
        spent = {"move": perf_counter() - begin}
        for name, options in ways.items():
            begin = perf_counter()
            image = render(now, camera, options=options, history=history[name])
            spent[name] = perf_counter() - begin
            if name == "with" and number >= 0:
                own.append(image.timings_ms.get("sky_shadow", 0.0))
                pictures.append((image.to_srgb()[0] * 255 + 0.5).to(torch.uint8))
        if number >= 0:
            for name, seconds in spent.items():
                ms[name].append(1e3 * seconds)
    record: dict[str, Any] = {name: {"median": float(np.median(v)), "least": min(v)} for name, v in ms.items()}
    record["sky_shadow"] = {"median": float(np.median(own)), "least": min(own)}
    return {"ms": record, "frames": frames, "pictures": pictures}
