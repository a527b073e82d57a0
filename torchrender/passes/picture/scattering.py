"""The pass ``scattering``: what media do to the light on its way to surfaces and to the eye."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface, ReflectionLayer, ReflectionState, VisibilityBuffer
from torchrender.effects.media.in_view import boxes_in_view, boxes_of, shadowed_by, share_of_view
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.scatter import Illumination, ScatteringLayer, scatter
from torchrender.effects.reflections.reflectors import blend_reflections
from torchrender.effects.shadows.shadow_map import render_shadow_map
from torchrender.effects.transparency.layers import Veil
from torchrender.passes.contract import Amounts, Buffers, Pass
from torchrender.passes.hard import SMALL_SHADOW, HardEffect, Law, Outputs, Subject, mean_over, no_lights
from torchrender.passes.light.ambient_visibility import AMBIENT_VISIBILITY, has_ambient_light
from torchrender.passes.light.direct_light import DIRECT_LIGHT, MIRROR_SHARE
from torchrender.passes.light.pane_shadow import PANE_SHADOW
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP
from torchrender.passes.light.sky_shadow import SKY_SHADOW
from torchrender.passes.light.visibility import POINT_SHADOW, SOFT_SHADOW
from torchrender.passes.mirrors.air import air_along, before_mirrors, illumination_of, lit_by, shadows_in_air
from torchrender.passes.mirrors.reflections import REFLECTIONS
from torchrender.passes.mirrors.reflective_pixel import mirrors
from torchrender.passes.outlook import Outlook, Verdict, counted
from torchrender.passes.picture.darkened import change_of_hits, darkened
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer, Layer, Order
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.medium import Medium
from torchrender.scene.model import Scene


@dataclass(frozen=True, eq=False)
class Hazed:
    """What media do to pictures: ``transmittance (radiance + change) + scattered``."""

    layer: ScatteringLayer | None  # on the way to the eye; None: nobody asks, or samples do not know where that is
    change: Tensor | None  # (B,H,W,3) of what surfaces send, for light and mirrors lose some on their ways
    illumination: Illumination | None = None  # of the media, for other ways to the eye


def blend(scene: Scene, gbuffer: GBuffer, radiance: Tensor, value: Hazed) -> Tensor:
    """Radiance (B,H,W,3) seen through the media, with what they scatter."""
    del scene, gbuffer
    if value.change is not None:
        radiance = radiance + value.change
    if value.layer is None:
        return radiance
    return torch.addcmul(value.layer.scattered, value.layer.transmittance, radiance)


SCATTERING = Buffer("scattering", Hazed, layer=Layer(Order.SCATTERING, blend))


# ---------------------------------------------------------------- whether


def _share(scene: Scene, cameras: Cameras) -> float:
    return share_of_view(boxes_of(scene.media), cameras)


def _verdict(scene: Scene, cameras: Cameras) -> Verdict:
    boxes = boxes_of(scene.media)
    if not len(boxes):
        return Verdict(False, "no medium" if not scene.media else "every medium is empty")
    inside = int(boxes_in_view(boxes, cameras).sum())
    if inside:
        return Verdict(True, f"{counted(inside, 'medium').replace('mediums', 'media')} in view")
    if bool(boxes_in_view(shadowed_by(boxes, scene.lights, scene.diagonal), cameras).any()):
        return Verdict(True, "a medium may shadow what is in view")
    if has_ambient_light(scene):
        return Verdict(True, "a medium may take from the light from everywhere")
    return Verdict(False, "no medium in view: behind the camera or beside what it sees")


def applies(outlook: Outlook) -> Verdict:
    """A medium meets the view, or lies between a light and the view."""
    if not outlook.options.media:
        return Verdict(False, "media are turned off")
    if isinstance(outlook.samples, RaySurface) and len(boxes_of(outlook.scene.media)):
        return Verdict(True, "media may shadow what rays hit")
    verdict = outlook.fact(_verdict)
    if not verdict.runs and before_mirrors(outlook.scene, outlook.options) and mirrors(outlook).runs:
        return Verdict(True, "a mirror may show a medium")
    return verdict


def asks(outlook: Outlook) -> Buffers:
    """The lights' depth images, or rays; of what rays hit what mirrors change."""
    if isinstance(outlook.samples, RaySurface):
        return (MIRROR_SHARE,)
    return shadows_in_air(outlook)


# ---------------------------------------------------------------- how


def run(frame: Frame) -> Hazed:
    """Transmittance and scattered light before what the picture sees, and how that is darkened."""
    samples, options = frame[GBUFFER], frame.options.scattering
    if isinstance(samples, RaySurface):
        return Hazed(None, _change(frame, samples, None))
    illumination = illumination_of(frame)
    seen = (samples.cameras, samples.depth, illumination, options)
    layer = scatter(frame.scene.media, *seen, position=samples.position) if options.air else None
    return Hazed(layer, _change(frame, samples, illumination), illumination)


def layer_before(
    scene: Scene, seen: VisibilityBuffer, options: RenderOptions, history: RenderHistory
) -> ScatteringLayer | None:
    """What media put before another picture than was rendered, lit as the pictures that left the history were.

    Args:
        scene: as it was given to those pictures.
        seen: (B,H,W) what the cameras see.

    Returns:
        None where these left no depth images of the lights, and some are needed.
    """
    past = history.of_scene(scene)
    lit = past.scene or scene
    maps = past.get(SCENE_SHADOW_MAP)
    if maps is None and lit.lights and options.shadows:
        return None
    return scatter(lit.media, seen.cameras, seen.depth, lit_by(lit, maps), options.scattering)


def _change(frame: Frame, samples: GBuffer | RaySurface, illumination: Illumination | None) -> Tensor | None:
    """What media take from the light that surfaces send and mirror; None: nothing."""
    if isinstance(samples, RaySurface):
        return change_of_hits(frame, samples) if frame.options.scattering.surfaces else None
    direct, mirrored = frame[DIRECT_LIGHT], frame.get(REFLECTIONS)
    darker = darkened(frame, samples, mirrors=mirrored is not None) if frame.options.scattering.surfaces else None
    if mirrored is None or illumination is None:
        return None if darker is None else darker.radiance - direct
    hazed = _hazed_mirrors(frame, samples, mirrored, illumination)
    if darker is None and hazed is mirrored:
        return None
    if darker is not None and hazed.share is not None:
        hazed = replace(hazed, share=darker.share)
    after = blend_reflections(frame.scene, samples, direct if darker is None else darker.radiance, hazed)
    return after - blend_reflections(frame.scene, samples, direct, mirrored)


def _hazed_mirrors(
    frame: Frame, samples: GBuffer, mirrored: ReflectionLayer, illumination: Illumination
) -> ReflectionLayer:
    """What mirrors show, seen through the media on the way from there to the mirror."""
    color = mirrored.color
    for k, state in enumerate(mirrored.state):
        rows = (state != ReflectionState.NONE).nonzero(as_tuple=True)
        ways = samples.position[k][rows].double(), mirrored.direction[k][rows], mirrored.distance[k][rows]
        found = air_along(frame, illumination, *ways)
        if found is not None:
            color = color.clone() if color is mirrored.color else color
            color[k][rows] = torch.addcmul(found[1], found[0], color[k][rows])
    return mirrored if color is mirrored.color else replace(mirrored, color=color)


def veil_of(frame: Frame, cameras: Cameras, hazed: Hazed) -> Veil | None:
    """What media put before places that the pixels of cameras see; None: nothing, or nobody asks for it."""
    illumination = hazed.illumination
    if hazed.layer is None or illumination is None:
        return None
    origins, directions = (rays.reshape(-1, 3) for rays in cameras.rays())
    directions = directions / directions.norm(dim=-1, keepdim=True)

    def veil(pixel: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
        passed, added = torch.ones(len(pixel), 3), torch.zeros(len(pixel), 3)
        picture = pixel // (cameras.width * cameras.height)
        for k in picture.unique():
            own = (picture == k).nonzero().reshape(-1)
            rows = pixel[own]
            found = air_along(frame, illumination, origins[rows], directions[rows], lengths[own])
            if found is not None:
                passed[own], added[own] = found
        return passed, added

    return veil


# ---------------------------------------------------------------- costs and settings


def amounts(outlook: Outlook) -> Amounts:
    """Once per light; pixels that may meet a medium; the same times lights; texels of lights' images."""
    lights = float(len(outlook.scene.lights))
    met = outlook.pixels * (1.0 if isinstance(outlook.samples, RaySurface) else outlook.fact(_share))
    height, width = outlook.options.shadow.shape
    return (lights, met, met * lights, lights * height * width * 1e-6)


def single_samples(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Samples that are no picture have no neighbours to lie between."""
    del history
    return replace(options, scattering=replace(options.scattering, block=1))


def _way(way: str, block: int, shadows: str = "maps", steps: int = 64) -> dict[str, Any]:
    changes = {"way": way, "block": block, "shadows": shadows}
    return {f"scattering.{name}": value for name, value in changes.items()} | (
        {"scattering.steps": steps} if way == "march" else {}
    )


# ---------------------------------------------------------------- hard cases


def _fog(subject: Subject) -> Medium:
    """Around the scene; half of what enters along its diagonal is lost."""
    low, high = subject.scene.bounds
    pad = 0.05 * max(subject.scene.diagonal, 1e-12)
    thick = 0.7 / max(subject.scene.diagonal, 1e-12)
    return Medium(
        low=low - pad,
        high=high + pad,
        scattering=torch.full((3,), 0.8 * thick),
        absorption=torch.full((3,), 0.2 * thick),
        asymmetry=0.3,
    )


def _scattered(subject: Subject, options: ScatterOptions, *, maps: bool = True) -> ScatteringLayer:
    scene, seen = subject.scene, subject.gbuffer
    drawn = tuple(render_shadow_map(scene, light, SMALL_SHADOW) for light in scene.lights) if maps else ()
    lit = Illumination(lights=scene.lights, shadow_maps=drawn, size=scene.diagonal)
    return scatter((_fog(subject),), subject.cameras, seen.depth, lit, options, position=seen.position)


def _layers(subject: Subject) -> Outputs:
    made = _scattered(subject, ScatterOptions(block=1, way="walk"))
    return {"transmittance": made.transmittance, "scattered": made.scattered}


def _against_steps(subject: Subject, _: Outputs) -> float:
    quick = _scattered(subject, ScatterOptions(block=1, shadows="none"), maps=False).scattered
    slow = _scattered(subject, ScatterOptions(block=1, shadows="none", way="march", steps=64), maps=False).scattered
    return mean_over((quick - slow).abs(), torch.ones_like(quick, dtype=torch.bool)) / max(float(slow.mean()), 1e-30)


HARD = HardEffect(
    name="scattering",
    modules=("effects.media.scatter", "effects.media.in_view", "effects.media.surfaces"),
    run=_layers,
    bounds=lambda _: {"transmittance": (0.0, 1.0), "scattered": (0.0, math.inf)},
    law=Law(
        text="without shadows, closed forms beside 64 steps along every ray: mean difference, as a share",
        deviation=_against_steps,
        limit=0.02,
    ),
    skip=no_lights,
    turns=False,  # the fog's box lies along the axes
    rounding=0.05,  # rays along the rims of shadows
    twins=0.05,
)

PASS = Pass(
    name="scattering",
    summary="what media scatter towards the eye and keep from it",
    makes=SCATTERING,
    needs=(GBUFFER, DIRECT_LIGHT),
    uses=(POINT_SHADOW, SOFT_SHADOW, PANE_SHADOW, AMBIENT_VISIBILITY, SKY_SHADOW, REFLECTIONS),
    asks=asks,
    applies=applies,
    run=run,
    settings=settings(
        "integrated rays",
        {
            "3 x 3": _way("slices", 3),
            "2 x 2": _way("slices", 2),
            "all": _way("slices", 1),
            "walked, 2 x 2": _way("walk", 2),
            "walked": _way("walk", 1),
        },
        ("traced", _way("march", 1, "rays", 256)),
    ),
    amounts=amounts,
    over_samples=single_samples,
    over_hits=single_samples,
    hard=(HARD,),
)
