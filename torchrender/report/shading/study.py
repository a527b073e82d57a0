"""Measure shading: ``python -m torchrender.report.shading [--quick] [-o docs/results]``.

Writes ``shading.md`` and ``.json``: pictures of Mitsuba, environment maps by direction, direct light by the
kernel beside what torch took before there was one, the price of all maps, what is left to the machine's limit, ambient
visibility in rooms, white furnaces. Data come from the folder of
``TORCHRENDER_DATA`` (default ``../shared/data``); what is not there is left out, and the page says so.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize
from torchrender.report.common.command import run_study
from torchrender.report.shading import before, opengl
from torchrender.report.shading.glossy_sky import glossy_of, settings_of
from torchrender.report.shading.mitsuba import beside_mitsuba
from torchrender.report.shading.page import page
from torchrender.report.shading.references import references
from torchrender.report.shading.rooms import ROOMS, ambient_rooms
from torchrender.report.shading.sky import irradiance_of
from torchrender.report.shading.subject import Subject, built_in, machine_limits, with_all_maps
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere
from torchrender.shade import shade
from torchrender.shading.attributes import _interpolated

SCENES = ("nest", "grass", "city", "tree", "living_room", "washroom", "cornell_box")
SIDES = {512: 7, 1024: 5}
"""Pixels a side, and how often each is timed."""
SAMPLES = 512
"""Of Mitsuba, for each pixel."""
ROUGHNESS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
DIRECTIONS = 256
GLOSSY_SKIES = ("museum.exr", "pisa_latlong_small.hdr", "forest.hdr")
READ, WRITTEN, GATHERS = 16 + 4, 12, 45
"""Bytes per pixel of the visibility buffer and of the light that leaves, and numbers gathered: corners, planes, ids."""


def direct_light(one: Subject, runs: int) -> dict[str, Any]:
    """Times of one scene, and how much the kernel differs from its twin in torch."""
    found, wanted = (shade(one.scene, gbuffer, one.visibility) for gbuffer in (one.gbuffer, replace(one.gbuffer)))
    error = ((found - wanted).abs() / wanted.abs().clamp_min(1e-3)).amax(-1)
    times = take_turns(
        {
            "attributes": lambda: _interpolated(one.scene.geometry, one.seen),
            "torch": _before(one),
            "kernel": lambda: shade(one.scene, one.gbuffer, one.visibility),
        },
        runs=runs,
    )
    covered = float(one.seen.covered.float().mean())
    return {
        "scene": one.name,
        "side": one.seen.triangle.shape[1],
        "covered": covered,
        "lights": len(one.scene.lights),
        "differ": int((error > 1e-4).sum()),
        "largest": float(error.max()),
        **{name: timing.record() for name, timing in times.items()},
    }


def _before(one: Subject) -> Any:
    """Shading in torch, from attributes that are there."""
    gbuffer = one.gbuffer
    gbuffer.uv  # noqa: B018  makes the attributes

    def work() -> Tensor:
        return before.shade(one.scene, gbuffer, one.visibility)

    return work


def beside_opengl(one: Subject, runs: int) -> dict[str, Any] | None:
    """The whole way from triangles to light, with one light from the eye on both sides; None without VTK."""
    if not opengl.available():
        return None
    draw, name = opengl.drawer(one)
    camera, scene = one.seen.cameras, one.scene
    head = (DirectionalLight(direction=camera.forward[0], irradiance=torch.full((3,), 3.0)),)
    lit = Scene(meshes=scene.meshes, materials=scene.materials, lights=head, ambient=torch.full((3,), 0.01))
    lit.__dict__["geometry"] = scene.geometry
    times = take_turns({"opengl": draw, "ours": lambda: shade(lit, rasterize(lit, camera))}, runs=runs)
    return {"scene": one.name, "renderer": name, **{k: t.record() for k, t in times.items()}}


def all_maps(name: str, side: int, runs: int) -> dict[str, Any]:
    """The price of metallic-roughness with maps, beside the plain model."""
    plain, mapped = with_all_maps(name, side)
    work = {
        "plain": lambda: shade(plain.scene, plain.gbuffer, plain.visibility),
        "all maps": lambda: shade(mapped.scene, mapped.gbuffer, mapped.visibility),
    }
    return {"scene": name, "side": side, **{k: t.record() for k, t in take_turns(work, runs=runs).items()}}


def furnace() -> list[dict[str, float]]:
    """Least and most radiance of white metal balls where all is white around."""
    ball = sphere(segments=96)
    mesh = type(ball)(
        vertices=ball.vertices, faces=ball.faces, normals=torch.nn.functional.normalize(ball.vertices, dim=-1)
    )
    camera = Cameras.look_at([0.0, 0.0, 6.0], [0.0, 0.0, 0.0], width=128, height=128, fov_deg=20.0)
    rows = []
    for roughness in ROUGHNESS:
        metal = Material(metallic=1.0, roughness=roughness, diffuse=torch.ones(3))
        scene = Scene(meshes=(mesh,), materials=(metal,), ambient=torch.ones(3))
        gbuffer = rasterize(scene, camera)
        image = shade(scene, gbuffer)[gbuffer.covered]
        rows.append({"roughness": roughness, "least": float(image.min()), "most": float(image.max())})
    return rows


def run(folder: Path, quick: bool) -> list[Path]:
    """Measure and write."""
    data = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))
    files = [folder / "shading.json", folder / "shading.md"]
    record: dict[str, Any] = {"machine": machine_record(), "per_pixel": {"bytes": READ + WRITTEN, "gathers": GATHERS}}
    for name, work in _parts(data, quick).items():
        begin = time.perf_counter()
        record[name] = work()
        sys.stderr.write(f"{name}: {time.perf_counter() - begin:.0f} s\n")
    write_record(files[0], record)
    write_text(files[1], page(record))
    return [file for file in files if file.is_file()]


def again(folder: Path, names: Sequence[str]) -> list[Path]:
    """Measure some parts and keep the others of the record that is there; the page says which, and of what commit."""
    files = [folder / "shading.json", folder / "shading.md"]
    record = json.loads(files[0].read_text())
    parts = _parts(Path(os.environ.get("TORCHRENDER_DATA", "../shared/data")), quick=False)
    now, before = machine_record(), record["machine"]
    kept = record.setdefault("kept", {})
    if now["commit"] != before["commit"]:
        kept |= {name: before["commit"] for name in parts if name in record and name not in kept}
    record["machine"] = now
    for name in names:
        record[name] = parts[name]()
        kept.pop(name, None)
    write_record(files[0], record)
    write_text(files[1], page(record))
    return files


def _parts(data: Path, quick: bool) -> dict[str, Callable[[], Any]]:
    """What is measured, by its name in the record."""
    names: Sequence[str] = ("cornell_box",) if quick else SCENES
    sides = {128: 2} if quick else SIDES
    small, runs = next(iter(sides.items()))
    mapped = names if quick else ("living_room", "washroom", "city")
    skies = data / "envmaps" if (data / "envmaps").is_dir() else None
    return {
        "limits": machine_limits,
        "direct_light": lambda: [direct_light(built_in(n, side), r) for side, r in sides.items() for n in names],
        "all_maps": lambda: [all_maps(name, small, runs) for name in mapped],
        "opengl": lambda: [row for n in names if (row := beside_opengl(built_in(n, small), runs)) is not None],
        "furnace": furnace,
        "mitsuba": lambda: beside_mitsuba(None, 4, ("matt",)) if quick else beside_mitsuba(skies, SAMPLES),
        "references": lambda: [] if quick else references(data / "references"),
        "skies": lambda: [] if quick or skies is None else irradiance_of(skies, DIRECTIONS),
        "glossy": lambda: [] if quick or skies is None else glossy_of([skies / name for name in GLOSSY_SKIES]),
        "settings": lambda: [] if quick or skies is None else settings_of(skies / GLOSSY_SKIES[0], runs),
        "rooms": lambda: [] if quick else ambient_rooms(ROOMS, small, runs),
    }


def main() -> None:
    """The command."""
    run_study(__doc__, run, quick="one small scene")
