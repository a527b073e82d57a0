"""Records of the stability suite: reflections, and the whole picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer
from torchrender.effects.reflections.clustered import ClusterOptions, clustered_reflections
from torchrender.effects.reflections.reflectors import reflective_pixels
from torchrender.effects.reflections.reuse import ReuseState, reuse_reflections
from torchrender.effects.reflections.traced import environment_reflections, trace_reflections
from torchrender.effects.upsampling.joint import joint_upsampled
from torchrender.passes.resolve import resampled
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.report.stability.cases import SHADOW, Subject
from torchrender.report.stability.effect import SHAPE, VIEW, HardEffect, Law, Outputs, difference, displayed
from torchrender.shade import shade

FEW = ClusterOptions(bin_factor=0.25)

Bounds = Mapping[str, tuple[float, float]]


# --------------------------------------------------------------- reflections


def _no_mirrors(subject: Subject) -> str | None:
    return None if len(subject.pixels) else "nothing in view mirrors"


def _layer(layer: ReflectionLayer, subject: Subject) -> Outputs:
    return {"color": layer.color, "distance": layer.distance / subject.unit, "length": layer.direction.norm(dim=-1)}


def _layer_bounds(subject: Subject) -> Bounds:
    return {"color": (0.0, subject.radiance_limit), "distance": (0.0, math.inf), "length": (0.0, 1.0 + 1e-5)}


def _traced(subject: Subject, backend: str = "auto") -> ReflectionLayer:
    caster = subject.caster if backend == "auto" else RayCaster(subject.scene.geometry, backend)
    return trace_reflections(caster, subject.pixels, subject.shader)


def _mean_color_error(first: Tensor, second: Tensor, subject: Subject) -> float:
    error = (displayed(first) - displayed(second)).abs().reshape(-1, 3)
    return float(error[subject.pixels.pixel].mean())


REFLECTIONS = HardEffect(
    name="reflections",
    modules=("effects.reflections.clustered",),
    run=lambda s: _layer(clustered_reflections(s.scene, s.pixels, s.shader, FEW).layer, s),
    bounds=_layer_bounds,
    law=Law(
        text="mean difference of display values to traced reflections",
        deviation=lambda s, found: _mean_color_error(found["color"], _traced(s).color, s),
        limit=0.1,
    ),
    skip=_no_mirrors,
    turns=False,  # what no ray answers comes from a cube map along the axes
)

TRACED_REFLECTIONS = HardEffect(
    name="traced_reflections",
    about=VIEW,
    modules=("effects.reflections.traced",),
    run=lambda s: _layer(_traced(s), s),
    bounds=_layer_bounds,
    law=Law(
        text="two ray casters, Embree and the tree, agree: share of values where not",
        deviation=lambda s, found: difference(found, _layer(_traced(s, "bvh"), s)),
        limit=0.0,
    ),
    skip=_no_mirrors,
    turns=False,  # what no ray answers comes from a cube map along the axes
)


def _some_alone(subject: Subject, outputs: Outputs) -> float:
    some = subject.pixels.select(torch.arange(len(subject.pixels))[::3])
    alone = environment_reflections(some, subject.shader).color.reshape(-1, 3)[some.pixel]
    return difference({"color": outputs["color"].reshape(-1, 3)[some.pixel]}, {"color": alone})


ENVIRONMENT_REFLECTIONS = HardEffect(
    name="environment_reflections",
    about=SHAPE,
    modules=("effects.reflections.traced",),
    run=lambda s: _layer(environment_reflections(s.pixels, s.shader), s),
    bounds=_layer_bounds,
    law=Law(
        text="every third pixel alone mirrors what it mirrors among all: share of values that differ",
        deviation=_some_alone,
        limit=0.0,
    ),
    skip=_no_mirrors,
    turns=False,  # what no ray answers comes from a cube map along the axes
)


def _next_frame(subject: Subject) -> Subject:
    """The cameras moved a little, across the view."""
    step = 0.02 * subject.scene.diagonal
    matrix = subject.cameras.camera_from_world.clone()
    matrix[:, 0, 3] -= step
    return replace(subject, cameras=replace(subject.cameras, camera_from_world=matrix))


def _frame(subject: Subject, seen: GBuffer, state: ReuseState | None) -> tuple[Tensor, ReuseState]:
    pixels = reflective_pixels(subject.scene, seen)
    made = reuse_reflections(pixels, seen, lambda p: trace_reflections(subject.caster, p, subject.shader), state)
    return made.layer.color, made.state


def _reused(subject: Subject) -> Outputs:
    found, state = {}, None
    frames = {"key": subject.gbuffer, "still": subject.gbuffer, "moved": _next_frame(subject).gbuffer}
    for name, seen in frames.items():
        found[name], state = _frame(subject, seen, state)
    return found


REFLECTION_REUSE = HardEffect(
    name="reflection_reuse",
    about=VIEW,
    modules=("effects.reflections.reuse",),
    run=_reused,
    bounds=lambda s: dict.fromkeys(("key", "still", "moved"), (0.0, s.radiance_limit)),
    law=Law(
        text="the second frame of a camera that stands still is the first: mean difference of display values",
        deviation=lambda s, found: _mean_color_error(found["still"], found["key"], s),
        limit=0.02,
    ),
    skip=_no_mirrors,
    turns=False,  # what no ray answers comes from a cube map along the axes
)


# ------------------------------------------------------------- whole picture

FILTERS = ("nearest", "bilinear")
SIZES = ((7, 5), (48, 64), (12, 97))  # height and width: fewer pixels, more, and both


def _resampled(subject: Subject) -> Outputs:
    radiance = shade(subject.scene, subject.gbuffer)
    return {
        f"{way} {height} x {width}": resampled(radiance, (height, width), way)
        for way in FILTERS
        for height, width in SIZES
    }


def _grey_stays_grey(subject: Subject, _: Outputs) -> float:
    grey = torch.full((*subject.gbuffer.triangle.shape, 3), 0.4)
    parts = [resampled(grey, size, way) for way in FILTERS for size in SIZES]
    return max(float((part - 0.4).abs().max()) for part in parts)


RESOLVE = HardEffect(
    name="resolve",
    about=VIEW,
    modules=("passes.resolve",),
    run=_resampled,
    bounds=lambda s: {f"{way} {h} x {w}": (0.0, s.radiance_limit) for way in FILTERS for h, w in SIZES},
    law=Law(
        text="a picture of one colour keeps it at any size: largest difference", deviation=_grey_stays_grey, limit=1e-6
    ),
)


FEWER = (0.5, 0.3)
"""Rendered pixels per pixel and side."""


def _scaled_up(subject: Subject, radiance: Callable[[GBuffer], Tensor]) -> list[Tensor]:
    scene, made = subject.scene, []
    for factor in FEWER:
        few = rasterize(scene, subject.cameras.scaled(factor))
        made.append(joint_upsampled(radiance(few), few, subject.gbuffer, scene.geometry.material))
    return made


def _guided(subject: Subject) -> Outputs:
    made = _scaled_up(subject, lambda few: shade(subject.scene, few))
    return {f"by {1 / factor:g}": radiance for factor, radiance in zip(FEWER, made, strict=True)}


def _grey_stays_grey_guided(subject: Subject, _: Outputs) -> float:
    made = _scaled_up(subject, lambda few: torch.full((*few.triangle.shape, 3), 0.4))
    return max(float((part - 0.4).abs().max()) for part in made)


JOINT_UPSAMPLING = HardEffect(
    name="joint_upsampling",
    about=VIEW,
    modules=("effects.upsampling.joint",),
    run=_guided,
    bounds=lambda s: {f"by {1 / factor:g}": (0.0, s.radiance_limit) for factor in FEWER},
    law=Law(text="a picture of one colour keeps it: largest difference", deviation=_grey_stays_grey_guided, limit=1e-6),
)


def _picture(subject: Subject) -> Outputs:
    options = RenderOptions(shadow=SHADOW, reflection=FEW)
    return {"radiance": render(subject.scene, subject.cameras, options=options).radiance}


def _alone(subject: Subject, outputs: Outputs) -> float:
    alone = _picture(subject.single(0))["radiance"]
    return float((displayed(alone) - displayed(outputs["radiance"][:1])).abs().mean())


def _default_light_limit(subject: Subject) -> Bounds:
    lit = replace(subject, scene=subject.scene.with_default_light())
    return {"radiance": (0.0, lit.radiance_limit)}


PICTURE = HardEffect(
    name="picture",
    modules=("renderer",),
    run=_picture,
    bounds=_default_light_limit,
    law=Law(
        text="the first picture alone is that of the two together: mean difference of display values",
        deviation=_alone,
        limit=0.01,
    ),
    turns=False,
)

MIRRORS = (
    REFLECTIONS, TRACED_REFLECTIONS, ENVIRONMENT_REFLECTIONS, REFLECTION_REUSE, RESOLVE, JOINT_UPSAMPLING,
    PICTURE,
)  # fmt: skip
