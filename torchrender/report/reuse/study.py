"""Reuse of reflections measured on walks through two rooms, beside the published tables and other ways to reuse.

``python -m torchrender.report.reuse [--quick] [-o docs/results]`` writes ``reflection-reuse.md``, ``.json``
and pictures. Errors are those of the displayed picture, 0 to 255, against tracing every reflective pixel.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer, ReflectionState
from torchrender.checks import checked_fields
from torchrender.effects.reflections.key_frame import match_reflections
from torchrender.effects.reflections.reflectors import (
    ReflectivePixels,
    blend_reflections,
    mirrored_share,
    reflective_pixels,
)
from torchrender.effects.reflections.reuse import ReusedReflections, ReuseState, reuse_reflections
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.effects.reflections.traced import trace_reflections
from torchrender.effects.shadows.shadow_map import ShadowOptions, lights_visibility, render_shadow_map
from torchrender.images.files import write_image
from torchrender.numerics.color import linear_from_srgb, srgb_from_linear
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.report.common.command import study_parser
from torchrender.report.common.hits import hit_shader
from torchrender.report.common.progress import part
from torchrender.report.reflections.baselines import BaselineReflections, depth_reprojection, mirror_motion_vectors
from torchrender.report.reuse.page import write_page
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import built_in_path
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build
from torchrender.shade import shade

WALKS = (("washroom", "walk1"), ("washroom", "walk2"), ("living_room", "walk1"), ("living_room", "walk2"))
OCCLUSION = 0.02  # relative difference in distance that shows that a reused point is not the one seen


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    walks: tuple[tuple[str, str], ...] = WALKS
    size: int = 512
    frames: int = 24  # measured one after the other, from the middle of each walk
    walk_frames: int = 240  # steps of the whole walk
    triangles: int | None = None
    rendered: int = 3  # frames of render() with and without a history
    sheet: int = 12  # frames on the contact sheet
    whole_walks: tuple[tuple[str, str], ...] = (WALKS[3],)  # in large pictures from end to end
    whole_size: int = 1024  # pixels of the side of these pictures
    whole_frames: int = 240
    whole_step: int = 16  # every so many frames of these are traced, too


QUICK = StudyOptions(
    walks=(("washroom", "walk1"),),
    size=64,
    frames=5,
    walk_frames=120,
    triangles=8000,
    rendered=2,
    sheet=4,
    whole_walks=(("washroom", "walk1"),),
    whole_size=32,
    whole_frames=5,
    whole_step=3,
)


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene with everything that its frames share."""

    scene: Scene
    cameras: Cameras
    caster: RayCaster
    shader: HitShader
    shadows: ShadowOptions
    maps: list[Any]

    @classmethod
    def of(cls, name: str, walk: str, study: StudyOptions) -> Stage:
        scene = build(name, triangles=study.triangles)
        shadows = ShadowOptions()
        maps = [render_shadow_map(scene, light, shadows) for light in scene.lights]
        near = 1e-3 * scene.diagonal
        cameras = built_in_path(scene, walk).cameras(study.walk_frames, width=study.size, height=study.size, near=near)
        first = max(0, (study.walk_frames - study.frames) // 2)
        shader = hit_shader(scene, RenderOptions(shadow=shadows), maps)
        return cls(scene, cameras[first : first + study.frames], RayCaster(scene.geometry), shader, shadows, maps)

    def trace(self, pixels: ReflectivePixels) -> ReflectionLayer:
        return trace_reflections(self.caster, pixels, self.shader)

    def reuse(self, pixels: ReflectivePixels, gbuffer: GBuffer, state: ReuseState | None) -> ReusedReflections:
        weight = mirrored_share(self.scene, gbuffer, pixels)
        return reuse_reflections(pixels, gbuffer, self.trace, state, None, weight)

    def direct(self, gbuffer: GBuffer) -> Tensor:
        return shade(self.scene, gbuffer, lights_visibility(self.scene, gbuffer, self.shadows, self.maps))

    def shown(self, gbuffer: GBuffer, direct: Tensor, layer: ReflectionLayer) -> Tensor:
        """(H,W,3) displayed values, 0 to 255."""
        return 255.0 * srgb_from_linear(blend_reflections(self.scene, gbuffer, direct, layer).clamp(0.0, 1.0))[0]


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.perf_counter()
    value = work()
    return value, 1e3 * (time.perf_counter() - begin)


def measure_walk(name: str, walk: str, study: StudyOptions, folder: Path) -> dict[str, Any]:
    """All figures of one walk."""
    stage = Stage.of(name, walk, study)
    state: ReuseState | None = None
    frames: list[dict[str, Any]] = []
    sheet: list[Tensor] = []
    picture, middle = None, len(stage.cameras) // 2
    last: Tensor | None = None
    for number in range(len(stage.cameras)):
        gbuffer, raster_ms = _timed(partial(rasterize, stage.scene, stage.cameras[number]))
        direct, shade_ms = _timed(partial(stage.direct, gbuffer))
        pixels, pixels_ms = _timed(partial(reflective_pixels, stage.scene, gbuffer))
        if number == 0:  # compiled loops and caches
            warm = reuse_reflections(pixels, gbuffer, stage.trace)
            reuse_reflections(pixels, gbuffer, stage.trace, warm.state)
        before = state

        made, reuse_ms = _timed(partial(stage.reuse, pixels, gbuffer, state))
        exact, trace_ms = _timed(partial(stage.trace, pixels))
        state = made.state
        record: dict[str, Any] = {
            "diffuse_ms": raster_ms + shade_ms + pixels_ms,
            "reuse_ms": reuse_ms,
            "trace_ms": trace_ms,
            "reflective_share": len(pixels) / study.size**2,
            "report": _plain(made.report),
        }
        truth = stage.shown(gbuffer, direct, exact)
        own = stage.shown(gbuffer, direct, made.layer)
        record |= _errors(own, truth, made.layer, exact, pixels)
        if last is not None:
            record["popping"] = float((own - truth - last).abs().mean())
        last = own - truth
        if before is not None and not made.report.key_frame:
            record |= _against_key(stage, before, pixels, gbuffer, direct, exact, truth, number)
            if picture is None or (picture < middle <= number):  # the first one, or better one from the middle
                picture = number
                _picture(folder / f"reflection-reuse-{name}-{walk}.png", stage, before, gbuffer, direct, exact, own)
        if number % max(1, len(stage.cameras) // study.sheet) == 0:
            sheet.append((own / 255.0)[::2, ::2])
        frames.append(record)
    _contact_sheet(folder / f"reflection-reuse-{name}-{walk}-frames.png", sheet[: study.sheet])
    count = stage.scene.geometry.triangle_count
    return {"frames": frames, "triangles": count, "rendered": _rendered(stage, study)}


def whole_walk(name: str, walk: str, study: StudyOptions) -> list[dict[str, Any]]:
    """Every frame of a walk in large pictures; some of them are traced, too."""
    stage = Stage.of(name, walk, replace(study, size=study.whole_size, frames=study.whole_frames))
    state: ReuseState | None = None
    frames: list[dict[str, Any]] = []
    for number in range(len(stage.cameras)):
        gbuffer = rasterize(stage.scene, stage.cameras[number])
        pixels = reflective_pixels(stage.scene, gbuffer)
        if number == 0:
            reuse_reflections(pixels, gbuffer, stage.trace)
        made, took = _timed(partial(stage.reuse, pixels, gbuffer, state))
        state, report = made.state, made.report
        row: dict[str, Any] = {"key_frame": report.key_frame, "traced_share": report.traced_share, "reuse_ms": took}
        if number % study.whole_step == study.whole_step // 2:
            exact, row["trace_ms"] = _timed(partial(stage.trace, pixels))
            direct = stage.direct(gbuffer)
            own, truth = (stage.shown(gbuffer, direct, layer) for layer in (made.layer, exact))
            row |= _errors(own, truth, made.layer, exact, pixels)
        frames.append(row)
    return frames


def _plain(report: Any) -> dict[str, Any]:
    values = {k: dict(v) if hasattr(v, "items") else v for k, v in vars(report).items()}
    return values | {"traced_share": report.traced_share}


def _errors(
    own: Tensor, truth: Tensor, layer: ReflectionLayer, exact: ReflectionLayer, pixels: ReflectivePixels
) -> dict[str, float]:
    difference = (own - truth).abs().mean(-1).reshape(-1)
    reused = layer.state.reshape(-1)[pixels.pixel] == ReflectionState.REUSED
    distance, true = (v.distance.reshape(-1)[pixels.pixel] for v in (layer, exact))
    both = torch.isfinite(distance) & torch.isfinite(true)
    other = torch.where(
        both, (distance - true).abs() > OCCLUSION * true, torch.isfinite(distance) != torch.isfinite(true)
    )
    return {
        "error": float(difference[pixels.pixel].mean()) if len(pixels) else 0.0,
        "image_error": float(difference.mean()),
        "occlusion_error": float((other & reused).float().mean()) if len(pixels) else 0.0,
    }


def _against_key(
    stage: Stage,
    before: ReuseState,
    pixels: ReflectivePixels,
    gbuffer: GBuffer,
    direct: Tensor,
    exact: ReflectionLayer,
    truth: Tensor,
    number: int,
) -> dict[str, Any]:
    """Distance from the key frame, baselines with the same key frame, and search steps from a cold start."""
    eye = gbuffer.cameras.eye
    out: dict[str, Any] = {"key_distance": float((eye - before.key.cameras.eye).norm()), "baselines": {}}
    for label, method in (("depth", depth_reprojection), ("motion_vectors", mirror_motion_vectors)):
        made, took = _timed(partial(method, before.key, pixels))
        shown = stage.shown(gbuffer, direct, _with_baseline(exact, made, pixels))
        error = (shown - truth).abs().mean(-1).reshape(-1)[pixels.pixel]
        share = 1.0 - float(made.found.float().mean())
        out["baselines"][label] = {"error": float(error.mean()), "traced_share": share, "ms": took}
    if number % 5 == 0:
        walk = replace(ReuseOptions(), search="walk")
        warm = match_reflections(before.key, eye, before.start, walk)
        cold = match_reflections(before.key, eye, None, walk)
        both = warm.valid & cold.valid
        same = (warm.end == cold.end).all(1)[both]
        out["search"] = {
            "warm": float(warm.steps.double().mean()),
            "cold": float(cold.steps.double().mean()),
            "unchanged": float(same.float().mean()) if len(same) else 1.0,
        }
    return out


def _with_baseline(exact: ReflectionLayer, made: BaselineReflections, pixels: ReflectivePixels) -> ReflectionLayer:
    """The traced layer with a baseline's colours where it has some."""
    color = exact.color.reshape(-1, 3).clone()
    color[pixels.pixel[made.found]] = made.color[made.found]
    return replace(exact, color=color.reshape(exact.color.shape))


def _picture(
    path: Path,
    stage: Stage,
    before: ReuseState,
    gbuffer: GBuffer,
    direct: Tensor,
    exact: ReflectionLayer,
    own: Tensor,
) -> None:
    """The reused picture, its error times 50, and that of the warp by depth."""
    pixels = reflective_pixels(stage.scene, gbuffer)
    truth = stage.shown(gbuffer, direct, exact)
    painted = _with_baseline(exact, depth_reprojection(before.key, pixels), pixels)
    errors = [(v - truth).abs() * 50.0 / 255.0 for v in (own, stage.shown(gbuffer, direct, painted))]
    row = torch.cat([own / 255.0, *(e.clamp(0.0, 1.0) for e in errors)], dim=1)
    write_image(path, linear_from_srgb(row))


def _contact_sheet(path: Path, pictures: list[Tensor]) -> None:
    columns = min(4, len(pictures))
    rows = [torch.cat(pictures[k : k + columns], dim=1) for k in range(0, len(pictures) // columns * columns, columns)]
    write_image(path, linear_from_srgb(torch.cat(rows, dim=0)))


def _rendered(stage: Stage, study: StudyOptions) -> dict[str, float]:
    """Milliseconds of whole pictures by ``render``: each from nothing, and each with the history of the one before."""
    options = RenderOptions(reflections="traced")
    history = render(stage.scene, stage.cameras[0], options=options, history=RenderHistory()).history
    alone, going_on = [], []
    for number in range(1, min(study.rendered + 1, len(stage.cameras))):
        _, took = _timed(partial(render, stage.scene, stage.cameras[number], options=options))
        alone.append(took)

        image, took = _timed(partial(render, stage.scene, stage.cameras[number], options=options, history=history))
        history = image.history
        going_on.append(took)
    return {"alone": statistics.median(alone), "with_history": statistics.median(going_on)}


def run(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """Measure everything and write the page."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"machine": machine_record(), "study": asdict(study), "walks": {}}
    for name, walk in study.walks:
        with part(f"{name} {walk}"):
            record["walks"][f"{name} {walk}"] = measure_walk(name, walk, study, folder)
    for name, walk in study.whole_walks:
        with part(f"{name} {walk}, {study.whole_frames} frames of {study.whole_size}²"):
            record["walks"][f"{name} {walk}"]["whole"] = whole_walk(name, walk, study)
    write_record(folder / "reflection-reuse.json", record)
    write_page(record, folder)
    return record


def main() -> None:
    """The command."""
    given = study_parser(__doc__, quick="one short walk, small pictures: checks that it works").parse_args()
    run(QUICK if given.quick else StudyOptions(), given.output)
