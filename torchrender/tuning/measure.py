"""Error against time: every setting of a pass beside the pass's reference, all other passes as usual."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from torchrender.image import Image
from torchrender.passes.contract import Pass
from torchrender.passes.settings import Setting
from torchrender.passes.table import GBUFFER, PASSES, find_pass
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.planner import plan
from torchrender.quality.metrics import flip, flip_map, psnr, relative_squared_error
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import built_in_path, walks_of
from torchrender.scene.model import Scene

SIDE = 512
"""Pixels of a side of the pictures that errors are taken of."""

FRAMES = 3
"""Pictures of a short sequence: the first prepares, the others are measured."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One setting of a pass in one view, or the mean of several."""

    flip: float  # mean, of the displayed picture
    psnr: float  # dB, of the displayed picture
    relative_mse: float  # of radiance
    own: float | None  # the effect's own measure, if it has one
    ms: float  # median of the pass alone, in a sequence: what lasts is there already
    spread_ms: float  # between the quartiles
    first_ms: float  # in a single picture, preparations included
    runs: int
    repeats: bool  # the error is the same in every run
    picture: Tensor | None = field(default=None, repr=False)  # (H,W,3) sRGB of the first view
    difference: Tensor | None = field(default=None, repr=False)  # (H,W) FLIP of it

    def record(self) -> dict[str, Any]:
        """Numbers alone, for JSON."""
        names = ("flip", "psnr", "relative_mse", "own", "ms", "spread_ms", "first_ms")
        values = {name: getattr(self, name) for name in names}
        rounded = {name: None if value is None else float(f"{value:.5g}") for name, value in values.items()}
        return {**rounded, "runs": self.runs, "repeats": self.repeats}


def views_of(scene: Scene, size: int, count: int = 2) -> list[Cameras]:
    """Short sequences (FRAMES cameras each): around the scene's first camera, and on from places along its path."""
    path = built_in_path(scene, (*walks_of(scene), "orbit")[0])
    near = 1e-3 * (scene.diagonal or 1.0)
    walk = path.cameras(240, width=size, height=size, near=near)
    starts = [int(240 * (i + 0.5) / count) for i in range(count)]
    return [walk[torch.arange(start, start + FRAMES)] for start in starts]


def measure_pass(
    scene: Scene, views: Sequence[Cameras], step: Pass, *, pictures: bool = False
) -> tuple[dict[str, Measured], Tensor | None]:
    """Every setting of a pass, means over the views in which it runs; empty where it runs in none.

    With ``pictures`` also the reference (H,W,3) sRGB of the first of these views.
    """
    lit = scene.with_default_light()
    found: dict[str, list[Measured]] = {setting.name: [] for setting in step.settings.all}
    running = next((s for s in step.settings.all if s.name != step.off), step.settings.all[0])
    shown = None
    for view in views:
        first = _sequence(lit, view, step, running)
        if first.image.plan is None or not first.image.plan.row(step.name).runs:
            continue
        made = {
            setting.name: _sequence(lit, view, step, setting) for setting in step.settings.all if setting != running
        }
        made[running.name] = first
        wanted = step.settings.reference
        exact = made[wanted.name].image if wanted in step.settings.all else _last(lit, view, step, wanted)
        with_picture = pictures and shown is None
        if with_picture:
            shown = exact.to_srgb()[0]
        for name, sequence in made.items():
            found[name].append(_compare(sequence, exact, step, with_picture))
    return {name: _mean(values) for name, values in found.items() if values}, shown


def exact_options() -> RenderOptions:
    """Every pass at its reference."""
    options = RenderOptions()
    for step in PASSES:
        if not step.settings.context.changes:
            options = step.settings.reference.applied(options)
    return options


def turned_off(options: RenderOptions, but: Pass | None = None) -> RenderOptions:
    """All passes that can be off at that, but one."""
    for step in PASSES:
        if step.off is not None and step is not but:
            options = step.settings.named(step.off).applied(options)
    return options


def options_at(step: Pass, setting: Setting) -> RenderOptions:
    """The usual options with one pass at a setting, and all others that can be off at that."""
    usual = turned_off(RenderOptions(), but=step)
    usual = Setting("measured with", step.measured_with).applied(usual)
    return setting.applied(step.settings.context.applied(usual))


def errors_alone(
    scene: Scene, camera: Cameras, step: Pass, history: RenderHistory
) -> tuple[dict[str, dict[str, float]], RenderHistory]:
    """Mean FLIP by setting, and what the pass took, in pictures that are part of no sequence.

    Empty where the pass does not run. What lasts is kept from picture to picture, what belongs to a sequence is not.
    """
    choices, reference = step.settings.all, step.settings.reference
    running = next((s for s in choices if s.name != step.off), choices[0])
    shown: dict[str, Tensor] = {}
    times: dict[str, float] = {}
    if not plan(scene, camera, options=options_at(step, running)).row(step.name).runs:
        return {}, history
    for setting in (running, reference, *choices):
        if setting.name in shown:
            continue
        image = render(scene, camera, options=options_at(step, setting), history=history.shared())
        assert image.history is not None and image.plan is not None
        history = image.history
        if setting == running and not image.plan.row(step.name).runs:
            return {}, history
        shown[setting.name], times[setting.name] = image.displayed().float(), image.timings_ms.get(step.name, 0.0)
    errors = {s.name: float(flip(shown[s.name], shown[reference.name])[0]) for s in choices}
    return {name: {"flip": error, "ms": times[name]} for name, error in errors.items()}, history


@dataclass(frozen=True, eq=False)
class _Sequence:
    """The last picture of a short sequence, with the pass's buffer, and what the pass took in each picture."""

    image: Image
    times_ms: tuple[float, ...]
    repeats: bool


def _sequence(scene: Scene, view: Cameras, step: Pass, setting: Setting) -> _Sequence:
    options, history = _watched(step, setting), RenderHistory()
    images: list[Image] = []
    for number in (*range(FRAMES), FRAMES - 1):
        # The last one is made twice, from the same history.
        before = history if len(images) < FRAMES else images[-2].history
        images.append(render(scene, view[number], options=options, history=before))
        history = images[-1].history or RenderHistory()
    times = tuple(image.timings_ms.get(step.name, 0.0) for image in images)
    # What the history keeps may be large.
    return _Sequence(replace(images[-1], history=None), times, torch.equal(images[-1].radiance, images[-2].radiance))


def _last(scene: Scene, view: Cameras, step: Pass, setting: Setting) -> Image:
    """The last picture, as one of a sequence: what a reference takes is not asked."""
    options = _watched(step, setting)
    before = render(scene, view[FRAMES - 2], options=options, history=RenderHistory())
    return replace(render(scene, view[FRAMES - 1], options=options, history=before.history), history=None)


def _watched(step: Pass, setting: Setting) -> RenderOptions:
    """The options of a setting, with what its own measure looks at."""
    buffers = () if step.own is None else (GBUFFER.name, step.own.buffer.name)
    return replace(options_at(step, setting), buffers=buffers)


def _compare(made: _Sequence, exact: Image, step: Pass, picture: bool) -> Measured:
    shown, wanted = made.image.displayed().float(), exact.displayed().float()
    difference = flip_map(shown, wanted)
    # What lasts costs what it costs at first.
    steady = made.times_ms[:1] if step.makes.lasting is not None else made.times_ms[1:]
    quarters = statistics.quantiles(steady, n=4) if len(steady) > 1 else [steady[0]] * 3
    own = None
    if step.own is not None and step.own.buffer.name in exact.buffers:
        own = step.own.error(made.image.buffers, exact.buffers)
    return Measured(
        flip=float(difference.mean()),
        psnr=float(psnr(shown, wanted)[0]),
        relative_mse=float(relative_squared_error(made.image.radiance, exact.radiance)[0]),
        own=own,
        ms=statistics.median(steady),
        spread_ms=quarters[2] - quarters[0],
        first_ms=made.times_ms[0],
        runs=len(steady),
        repeats=made.repeats,
        picture=made.image.to_srgb()[0] if picture else None,
        difference=difference[0] if picture else None,
    )


def _mean(values: Sequence[Measured]) -> Measured:
    """Means of several views; the pictures of the first."""

    def of(name: str) -> float:
        return statistics.fmean(getattr(v, name) for v in values)

    owns = [v.own for v in values if v.own is not None]
    return replace(
        values[0],
        flip=of("flip"),
        psnr=of("psnr"),
        relative_mse=of("relative_mse"),
        ms=of("ms"),
        spread_ms=of("spread_ms"),
        first_ms=of("first_ms"),
        repeats=all(v.repeats for v in values),
        own=statistics.fmean(owns) if owns else None,
        runs=sum(v.runs for v in values),
    )


def frontier(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """Names of the points (time, error) that no other beats in both, from fast to exact."""
    best: list[str] = []
    for name, (_, error) in sorted(points.items(), key=lambda item: item[1]):
        if not best or error < points[best[-1]][1]:
            best.append(name)
    return best


def passes_named(name: str | None) -> tuple[Pass, ...]:
    """One pass, or all that have a choice."""
    return tuple(step for step in PASSES if step.settings.is_choice) if name is None else (find_pass(name),)
