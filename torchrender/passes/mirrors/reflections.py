"""The pass ``reflections``: what reflective pixels mirror."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import ReflectionLayer, ReflectionState
from torchrender.effects.reflections.clustered import ClusterOptions, clustered_reflections
from torchrender.effects.reflections.reflectors import RayShader, ReflectivePixels, blend_reflections
from torchrender.effects.reflections.traced import TraceOptions, environment_reflections, trace_reflections
from torchrender.passes.contract import Buffers, OwnMeasure, Pass, Prices
from torchrender.passes.hard import SHAPE, VIEW, HardEffect, Law, Outputs, Subject, difference, displayed, no_mirrors
from torchrender.passes.light.direct_light import DIRECT_LIGHT, MIRROR_SHARE, with_share
from torchrender.passes.mirrors.air import before_mirrors, shadows_in_air
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.mirrors.onward import mirror_shader, onward_of
from torchrender.passes.mirrors.reflective_pixel import REFLECTIVE_PIXEL, mirrors
from torchrender.passes.mirrors.work import amounts, did
from torchrender.passes.outlook import Outlook
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.passes.senses import closely
from torchrender.passes.senses import difference as seen_difference
from torchrender.passes.settings import Setting, settings
from torchrender.pipeline.buffer import Buffer, Layer, Order
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.rays import RayCaster

REFLECTIONS: Buffer[ReflectionLayer] = Buffer(
    "reflections", ReflectionLayer, layer=Layer(Order.REFLECTION, blend_reflections)
)


def asks(outlook: Outlook) -> Buffers:
    """Rays, at the settings that cast some; and where lights reach the media, as mirrors in mirrors show them, too."""
    options = outlook.options
    rest = options.reflections == "clustered" and options.reflection.missing == "trace"
    rays: Buffers = (RAY_CASTER,) if options.reflections == "traced" or rest else ()
    hazed = options.reflections != "environment" and before_mirrors(outlook.scene, options)
    return tuple(dict.fromkeys((HIT_SHADER, *rays, *(shadows_in_air(outlook) if hazed else ()))))


def run(frame: Frame) -> ReflectionLayer:
    """What the reflective pixels mirror, in each picture as if it were alone: clusters and hits are shared in one."""
    shader, direct = mirror_shader(frame), frame[DIRECT_LIGHT]
    layers = [
        _one(frame, shader, pixels, direct[k : k + 1]) for k, pixels in enumerate(frame[REFLECTIVE_PIXEL].pictures())
    ]
    return layers[0] if len(layers) == 1 else _batch(layers)


def _one(frame: Frame, shader: RayShader, pixels: ReflectivePixels, direct: Tensor) -> ReflectionLayer:
    options = frame.options
    if options.reflections == "environment":
        return environment_reflections(pixels, shader, options.tracing)
    if options.reflections == "traced":
        return trace_reflections(frame[RAY_CASTER], pixels, shader, options.tracing, onward=onward_of(frame, shader))
    caster = frame.get(RAY_CASTER)
    made = clustered_reflections(
        frame.scene,
        pixels,
        shader,
        options.reflection,
        direct=direct,
        caster=None if caster is None else lambda: caster,
        onward=onward_of(frame, shader),
    )
    return made.layer


def _batch(layers: list[ReflectionLayer]) -> ReflectionLayer:
    """Layers (1,H,W) of pictures as one (B,H,W); clusters are numbered through."""
    first, numbered = 0, []
    for layer in layers:
        numbered.append(torch.where(layer.cluster >= 0, layer.cluster + first, layer.cluster))
        first += int(layer.cluster.amax()) + 1 if layer.cluster.numel() else 0
    return ReflectionLayer(
        color=torch.cat([layer.color for layer in layers]),
        distance=torch.cat([layer.distance for layer in layers]),
        direction=torch.cat([layer.direction for layer in layers]),
        state=torch.cat([layer.state for layer in layers]),
        cluster=torch.cat(numbered),
    )


LOOK_MS = 70.0
"""A first look at the surroundings, about."""

PROBED = 2048
"""Reflective pixels, at most, whose surroundings are looked up beside what they mirror."""


def senses(frame: Frame) -> dict[str, float]:
    """How far off the surroundings alone would be: by a few of the pixels that show more."""
    pixels, layer = frame[REFLECTIVE_PIXEL], frame[REFLECTIONS]
    if frame.options.reflections == "environment" or not len(pixels):
        return {}
    chosen = pixels.select(torch.arange(len(pixels))[:: -(-len(pixels) // PROBED)])
    if frame.spare_ms < LOOK_MS and frame[HIT_SHADER].unseen(chosen.object_id, chosen.cameras.eye):
        return {}
    leaving = (chosen.position, chosen.object_id)
    far = frame[HIT_SHADER].environment(chosen.direction, chosen.cameras.eye, leaving=leaving)
    direct, mirrored = (image.reshape(-1, 3)[chosen.pixel] for image in (frame[DIRECT_LIGHT], layer.color))
    share = frame[MIRROR_SHARE]
    replaced, weight = (image.reshape(-1, 3)[chosen.pixel] for image in (share.replaced, share.mirrored))
    both = [(direct - replaced + weight * color).clamp_min(0.0)[None, None] for color in (mirrored, far)]
    part = len(pixels) / max(frame[GBUFFER].covered.numel(), 1)
    return {closely("reflections"): part * seen_difference(frame, both[0], both[1], frame[DIRECT_LIGHT])}


WAYS: Mapping[str, Mapping[str, Any]] = {
    "clusters": {"reflections": "clustered", "reflection.missing": "environment"},
    "clusters, rest traced": {"reflections": "clustered", "reflection.missing": "trace"},
    "traced": {"reflections": "traced"},
}
"""What ``reflections="auto"`` chooses from, from fast to exact; each alone may be the quickest."""

QUICK = 1.25
"""Times the quickest way's time that another, more accurate one may take, and milliseconds beyond that."""
SLACK_MS = 5.0


def left_open(options: RenderOptions) -> bool:
    """Nobody says how."""
    return options.reflections == "auto"


def settle(outlook: Outlook, prices: Prices) -> RenderOptions:
    """For ``reflections="auto"`` the most accurate of the quick ways, trees and cube maps included.

    In a sequence the tree counts once it turns out that the scene changes, and a way is kept while it is a quick one.
    """
    options = outlook.options
    if not left_open(options):
        return options
    exact = Setting("traced", WAYS["traced"]).applied(options)
    if not mirrors(outlook).runs:
        return exact
    times: dict[str, float] = {}
    for name, changes in WAYS.items():
        found = dict(prices(Setting(name, changes).applied(options)))
        if outlook.history.sequence and not outlook.history.pictures:
            found.pop(RAY_CASTER, None)
        known = [ms for ms in found.values() if ms is not None]
        if len(known) == len(found):
            times[name] = sum(known)
    allowed = QUICK * min(times.values(), default=0.0) + SLACK_MS
    quick = [name for name, ms in times.items() if ms <= allowed]
    return Setting(quick[-1], WAYS[quick[-1]]).applied(options) if quick else exact


def over_samples(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Where there is a ray caster rays, else the scene's cube map: clusters are for whole pictures."""
    if options.reflections == "off":
        return options
    return replace(options, reflections="environment" if history.get(RAY_CASTER) is None else "traced")


def mirror_error(found: Mapping[str, Any], reference: Mapping[str, Any]) -> float:
    """Mean absolute error of the mirrored radiance, 0 to 255, clipped at white, over pixels that mirror."""
    wanted: ReflectionLayer = reference[REFLECTIONS.name]
    chosen = wanted.state != ReflectionState.NONE
    pair = [layer.color[chosen].clamp(0.0, 1.0) for layer in (found[REFLECTIONS.name], wanted)]
    return 255.0 * float((pair[0] - pair[1]).abs().mean())


OWN = OwnMeasure(title="mirrored light, of 255", buffer=REFLECTIONS, error=mirror_error)


def _clusters(bin_factor: float, deviation_deg: float, scale: float, missing: str) -> dict[str, Any]:
    return {
        "reflections": "clustered",
        "reflection.bin_factor": bin_factor,
        "reflection.deviation_deg": deviation_deg,
        "reflection.image_scale": scale,
        "reflection.missing": missing,
    }


# ---------------------------------------------------------------- hard cases

FEW = ClusterOptions(bin_factor=0.25)
OWN_RAYS = TraceOptions(share_rays=False)


def _layer(layer: ReflectionLayer, subject: Subject) -> Outputs:
    return {"color": layer.color, "distance": layer.distance / subject.unit, "length": layer.direction.norm(dim=-1)}


def _layer_bounds(subject: Subject) -> Mapping[str, tuple[float, float]]:
    return {"color": (0.0, subject.radiance_limit), "distance": (0.0, math.inf), "length": (0.0, 1.0 + 1e-5)}


def _traced(subject: Subject, backend: str = "auto") -> ReflectionLayer:
    caster = subject.caster if backend == "auto" else RayCaster(subject.scene.geometry, backend)
    return trace_reflections(caster, subject.pixels, subject.shader)


def mean_color_error(first: Tensor, second: Tensor, subject: Subject) -> float:
    """Mean difference of display values over the pixels that mirror."""
    error = (displayed(first) - displayed(second)).abs().reshape(-1, 3)
    return float(error[subject.pixels.pixel].mean())


def _some_alone(subject: Subject, outputs: Outputs) -> float:
    some = subject.pixels.select(torch.arange(len(subject.pixels))[::3])
    alone = environment_reflections(some, subject.shader, OWN_RAYS).color.reshape(-1, 3)[some.pixel]
    return difference({"color": outputs["color"].reshape(-1, 3)[some.pixel]}, {"color": alone})


# In all of them, what no ray answers comes from a cube map along the axes: they do not turn.
def _too_near_for_clusters(subject: Subject) -> str | None:
    near = subject.pixels.length.numel() > 0 and float(subject.pixels.length.max()) < 1e-4 * subject.scene.diagonal
    return "clusters' images begin at 1e-4 of the scene's diagonal, beyond all mirrors" if near else no_mirrors(subject)


HARD = (
    HardEffect(
        name="reflections",
        modules=("effects.reflections.clustered",),
        run=lambda s: _layer(clustered_reflections(s.scene, s.pixels, s.shader, FEW).layer, s),
        bounds=_layer_bounds,
        law=Law(
            text="mean difference of display values to traced reflections",
            deviation=lambda s, found: mean_color_error(found["color"], _traced(s).color, s),
            limit=0.1,
        ),
        skip=_too_near_for_clusters,
        turns=False,
    ),
    HardEffect(
        name="traced_reflections",
        about=VIEW,
        modules=("effects.reflections.traced", "effects.reflections.virtual"),
        run=lambda s: _layer(_traced(s), s),
        bounds=_layer_bounds,
        law=Law(
            text="two ray casters, Embree and the tree, agree: share of values where not",
            deviation=lambda s, found: difference(found, _layer(_traced(s, "bvh"), s)),
            limit=0.0,
        ),
        skip=no_mirrors,
        turns=False,
        rounding=0.04,  # glossy hits share what they found within cells: values at their borders move
        twins=0.04,
    ),
    HardEffect(
        name="environment_reflections",
        about=SHAPE,
        modules=("effects.reflections.traced",),
        run=lambda s: _layer(environment_reflections(s.pixels, s.shader, OWN_RAYS), s),
        bounds=_layer_bounds,
        law=Law(
            text="every third pixel alone mirrors what it mirrors among all: share of values that differ",
            deviation=_some_alone,
            limit=0.0,
        ),
        skip=no_mirrors,
        turns=False,
    ),
)

PASS = Pass(
    name="reflections",
    summary="what mirrors show",
    makes=REFLECTIONS,
    needs=(GBUFFER, REFLECTIVE_PIXEL, DIRECT_LIGHT, MIRROR_SHARE),
    asks=asks,
    applies=mirrors,
    run=with_share(run),
    settings=settings(
        "way",
        {
            "environment": {"reflections": "environment"},
            "few clusters": _clusters(0.25, 30.0, 1.0, "environment"),
            "clusters": _clusters(1.0, 5.0, 2.0, "environment"),
            "clusters, rest traced": _clusters(1.0, 5.0, 2.0, "trace"),
            "traced": {"reflections": "traced"},
        },
    ),
    amounts=amounts,
    senses=senses,
    rests_on=HIT_SHADER,
    once=1,
    doubt=2.0,  # what hits show is lit as the picture is, or mirrors in turn: up to four times in random scenes
    did=did,
    settle=settle,
    settles=left_open,
    own=OWN,
    over_samples=over_samples,
    hard=HARD,
)
