"""Error against time: every setting of a pass beside the pass's reference, all other passes as usual."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import ReflectionState
from torchrender.image import Image
from torchrender.passes.knobs import Setting
from torchrender.passes.table import PASSES, Pass
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.curves import load_curves
from torchrender.planning.knowledge import Knowledge
from torchrender.quality.metrics import flip_map, psnr, relative_squared_error
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.camera_path import built_in_path, walks_of
from torchrender.scene.model import Scene

Buffers = Mapping[str, Any]

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
    own: float | None  # the effect's own measure; see OWN
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


def _visibility_error(found: Buffers, reference: Buffers, name: str) -> float:
    """Mean absolute error of the share of light that arrives, over pixels with a surface."""
    covered = reference["gbuffer"].covered
    pairs = [(found[name][n], reference[name][n]) for n in reference[name]]
    return float(torch.stack([(a - b).abs()[covered].mean() for a, b in pairs]).mean())


def _mirror_error(found: Buffers, reference: Buffers, name: str) -> float:
    """Mean absolute error of the mirrored radiance, 0 to 255, clipped at white, over pixels that mirror."""
    wanted = reference[name]
    chosen = wanted.state != ReflectionState.NONE
    pair = [layer.color[chosen].clamp(0.0, 1.0) for layer in (found[name], wanted)]
    return 255.0 * float((pair[0] - pair[1]).abs().mean())


OWN: dict[str, tuple[str, str, Callable[[Buffers, Buffers, str], float]]] = {
    "shadow_map": ("visibility error", "point_shadows", _visibility_error),
    "point_shadow": ("visibility error", "point_shadows", _visibility_error),
    "soft_shadow": ("visibility error", "area_shadows", _visibility_error),
    "reflections": ("mirrored light, of 255", "reflection_layer", _mirror_error),
    "reflection_reuse": ("mirrored light, of 255", "reflection_layer", _mirror_error),
}
"""The measure of an effect itself: its name, the buffer that it is of, and the function."""


def views_of(scene: Scene, size: int, count: int = 2) -> list[Cameras]:
    """Short sequences (FRAMES cameras each): around the scene's first camera, and on from places along its path."""
    path = built_in_path(scene, (*walks_of(scene), "orbit")[0])
    near = 1e-3 * (scene.diagonal or 1.0)
    walk = path.cameras(240, width=size, height=size, near=near)
    starts = [int(240 * (i + 0.5) / count) for i in range(count)]
    return [walk[torch.arange(start, start + FRAMES)] for start in starts]


def applies(step: Pass, scene: Scene, cameras: Cameras) -> bool:
    """The pass has something to do in this view."""
    options = step.knob.context.applied(RenderOptions())
    known = Knowledge(scene=scene, cameras=cameras, past=RenderHistory(), curves=load_curves())
    return step.applies(known.outlook(options)).runs


def measure_pass(
    scene: Scene, views: Sequence[Cameras], step: Pass, *, pictures: bool = False
) -> tuple[dict[str, Measured], Tensor | None]:
    """Every setting of a pass, means over the views in which it applies; empty where it applies to none.

    With ``pictures`` also the reference (H,W,3) sRGB of the first of these views.
    """
    seen = [view for view in views if applies(step, scene, view[:1])]
    lit = scene.with_default_light()
    found: dict[str, list[Measured]] = {setting.name: [] for setting in step.knob.settings}
    shown = None
    for number, view in enumerate(seen):
        reference = _sequence(lit, view, step, step.knob.reference)
        if pictures and number == 0:
            shown = reference.image.to_srgb()[0]
        for setting in step.knob.settings:
            made = _sequence(lit, view, step, setting)
            found[setting.name].append(_compare(made, reference, step, pictures and number == 0))
    return {name: _mean(values) for name, values in found.items() if values}, shown


def options_at(step: Pass, setting: Setting) -> RenderOptions:
    """The usual options with one pass at a setting; only the pass that reuses reflections does."""
    usual = RenderOptions() if step.name == "reflection_reuse" else RenderOptions(reuse=None)
    if step.name == "reflection_reuse":
        usual = replace(usual, reflections="traced")
    return setting.applied(step.knob.context.applied(usual))


@dataclass(frozen=True, eq=False)
class _Sequence:
    """The last picture of a short sequence, with the pass's buffer, and what the pass took in each picture."""

    image: Image
    times_ms: tuple[float, ...]
    repeats: bool


def _sequence(scene: Scene, view: Cameras, step: Pass, setting: Setting) -> _Sequence:
    buffers = ("gbuffer", OWN[step.name][1]) if step.name in OWN else ()
    options, history = replace(options_at(step, setting), buffers=buffers), RenderHistory()
    images: list[Image] = []
    for number in (*range(FRAMES), FRAMES - 1):
        # The last one is made twice, from the same history.
        before = history if len(images) < FRAMES else images[-2].history
        images.append(render(scene, view[number], options=options, history=before))
        history = images[-1].history or RenderHistory()
    times = tuple(image.timings_ms.get(step.name, 0.0) for image in images)
    return _Sequence(images[-1], times, torch.equal(images[-1].radiance, images[-2].radiance))


def _compare(made: _Sequence, reference: _Sequence, step: Pass, picture: bool) -> Measured:
    shown, wanted = made.image.displayed().float(), reference.image.displayed().float()
    difference = flip_map(shown, wanted)
    # Shadow maps last: what they cost is what they cost at first.
    steady = made.times_ms[:1] if step.name == "shadow_map" else made.times_ms[1:]
    quarters = statistics.quantiles(steady, n=4) if len(steady) > 1 else [steady[0]] * 3
    name = OWN.get(step.name)
    own = None
    if name is not None and reference.image.buffers.get(name[1]) is not None:
        own = name[2](made.image.buffers, reference.image.buffers, name[1])
    return Measured(
        flip=float(difference.mean()),
        psnr=float(psnr(shown, wanted)[0]),
        relative_mse=float(relative_squared_error(made.image.radiance, reference.image.radiance)[0]),
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
    """One pass, or all of them."""
    from torchrender.passes.table import find_pass

    return PASSES if name is None else (find_pass(name),)
