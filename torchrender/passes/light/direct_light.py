"""The pass ``direct_light``: light that arrives without detour, emission, background."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, MirrorShare, ReflectionLayer
from torchrender.effects.ambient.visibility import AmbientVisibility
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import HardEffect, Law, Outputs, Subject, radiance_bounds
from torchrender.passes.light.ambient_visibility import AMBIENT_VISIBILITY, has_ambient_light, reach_of
from torchrender.passes.light.hidden_light import SIDE, depth_visibility, eye_visibility
from torchrender.passes.light.light_reach import AREA_LISTED, LIGHT_REACH, POINT_LISTED
from torchrender.passes.light.pane_shadow import PANE_SHADOW
from torchrender.passes.light.probe import probe
from torchrender.passes.light.visibility import POINT_SHADOW, SOFT_SHADOW
from torchrender.passes.outlook import Outlook, Verdict, counted
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.senses import SIDE as SENSED_SIDE
from torchrender.passes.senses import beside, closely, difference, few, roughly
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer, Layer, Order
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light, RectLight
from torchrender.scene.model import Scene
from torchrender.shade import AmbientReach, sent_light, shade
from torchrender.shading.lights import LightLists
from torchrender.shading.sky import SkyMaps


def _under_all(scene: Scene, gbuffer: GBuffer, radiance: Tensor, direct: Tensor) -> Tensor:
    """What surfaces send lies under everything else."""
    del scene, gbuffer, radiance
    return direct


FEW = 4
"""Lights that are not worth a look at lists."""

BEYOND = 2.8
"""Times that rays find more hidden light than the depth of a picture tells: 23 random scenes and built-in ones, within
a quarter."""

RAYS = 64
"""Of the quickest traced ambient visibility, whose noise is told beforehand."""

HALF_WHITE = 0.5
"""Reflectance that few surfaces exceed."""

HIDDEN = 0.1
"""Visible share of what lights from everywhere, below which what is sent does not tell how white a surface is."""

DIRECT_LIGHT = Buffer("direct_light", Tensor, layer=Layer(Order.DIRECT, _under_all))
"""Radiance (B,H,W,3)."""

MIRROR_SHARE = Buffer("mirror_share", MirrorShare)
"""How mirrored pictures go into it; without pixels where nobody asks."""


def applies(outlook: Outlook) -> Verdict:
    """Every picture needs it."""
    return Verdict(True, "light of " + counted(len(outlook.scene.lights), "light") + ", ambient light, background")


def run(frame: Frame) -> tuple[Tensor, MirrorShare]:
    """Radiance (B,H,W,3) without reflections, and what these change."""
    scene, options = frame.scene, frame.options
    visibility, lists = _listed(frame)
    light = sent_light(
        scene,
        frame[GBUFFER],
        visibility,
        background=options.background,
        area_light=options.area_light,
        around=ambient_reach(scene, frame.get(AMBIENT_VISIBILITY)),
        mirrors=MIRROR_SHARE in frame.wanted or bool(frame.askers(MIRROR_SHARE)),
        lists=lists,
    )
    return light.radiance, light.share


def lights_visibility(frame: Frame) -> Tensor | None:
    """Share (B,L,H,W) of each light that arrives, as far as passes found out; None: all of it."""
    found, panes = _shadows(frame), frame.get(PANE_SHADOW)
    if not found:
        return panes
    lit = torch.ones(frame[GBUFFER].covered.shape)
    visibility = torch.stack([found.get(number, lit) for number in range(len(frame.scene.lights))], dim=1)
    return visibility if panes is None else visibility * panes


def _shadows(frame: Frame) -> dict[int, Tensor]:
    point, soft = frame.get(POINT_SHADOW), frame.get(SOFT_SHADOW)
    return {**(point or {}), **(soft or {})}


def _listed(frame: Frame) -> tuple[Tensor | None, LightLists | None]:
    """The same, with many lights of those alone whose shadows were made (B,K,H,W); and where lights reach."""
    reach = frame.get(LIGHT_REACH)
    if reach is None or len(frame.scene.lights) <= FEW:
        return lights_visibility(frame), None
    lists, found = LightLists(reach.starts, reach.lights, reach.side), _shadows(frame)
    if not found or frame.get(PANE_SHADOW) is not None:
        return lights_visibility(frame), lists
    known = tuple(sorted(found))
    return torch.stack([found[number] for number in known], dim=1), lists._replace(shaded=known)


def ambient_reach(scene: Scene, found: AmbientVisibility | None) -> AmbientReach | None:
    """What arrives from everywhere: the sky where nothing hides it however far, and fill light where nothing is near.

    With both, their shares count as the mean radiance of each.
    """
    if found is None:
        return None
    sky, fill = _from_around(scene)
    share = sky / max(sky + fill, 1e-30)
    if share in (0.0, 1.0):
        return AmbientReach(found.near) if share == 0.0 else AmbientReach(found.sky, found.bent_normal)
    return AmbientReach(torch.lerp(found.near, found.sky, share), found.bent_normal)


def _from_around(scene: Scene) -> tuple[float, float]:
    """Mean radiance of the sky, and of light that finds its way everywhere."""
    sky, fill = 0.0, float(scene.ambient.detach().mean())
    if scene.environment is None:
        return sky, fill
    light = scene.environment.mean_radiance
    return (sky, fill + light) if scene.environment.fill else (light, fill)


def with_share(run: Callable[[Frame], Any]) -> Callable[[Frame], Any]:
    """A pass's ``run`` whose layer, the first of what it makes, is blended in by what shading told of each pixel."""

    def shared(frame: Frame) -> Any:
        made = run(frame)
        share = frame[MIRROR_SHARE]
        if isinstance(made, ReflectionLayer):
            return replace(made, share=share)
        return (replace(made[0], share=share), *made[1:])

    return shared


def senses(frame: Frame) -> dict[str, float]:
    """How much hidden light from everywhere darkens the picture, and how near lights with an area are."""
    found = {}
    near = _nearness(frame)
    if near is not None:
        found["direct_light"] = near
    reach = ambient_reach(frame.scene, frame.get(AMBIENT_VISIBILITY))
    if reach is not None:
        visible = few(reach.visibility)
        found["ambient_visibility"] = _changed(frame, visible, 1.0 - visible)
        noise = (visible * (1.0 - visible)).clamp_min(0.0).sqrt() / math.sqrt(RAYS)
        found[closely("ambient_visibility")] = _changed(frame, visible, noise)
    if has_ambient_light(frame.scene) and not frame.scene.photo_light:
        found[roughly("ambient_visibility")] = rough = _darkened(frame, reach)
        if reach is not None:
            found[beside("ambient_visibility")] = rough
    return found | probe(frame, frame[GBUFFER], lights_visibility(frame), reach, frame[DIRECT_LIGHT])


def _darkened(frame: Frame, known: AmbientReach | None) -> float:
    """How much a picture without ambient visibility is too bright: by the depth of a few of its pixels, and by what the
    eye sees of the sky all around.

    Args:
        known: the ambient visibility of this picture; None: it has none.
    """
    scene, gbuffer, radiance = frame.scene, frame[GBUFFER], few(frame[DIRECT_LIGHT], SIDE).detach().float()
    sky, fill = _from_around(scene)
    parts = [(light, far) for light, far in ((sky, math.inf), (fill, reach_of(scene, frame.options.ambient))) if light]
    if not parts:
        return 0.0
    lights, reaches = zip(*parts, strict=True)
    visible = None if known is None else few(known.visibility, SIDE)
    white = _whiteness(frame, radiance, torch.ones(()) if visible is None else visible, SIDE)
    whole = radiance if visible is None else radiance + ((sky + fill) * (1.0 - visible) * white)[..., None]

    def lost(shares: Sequence[Tensor]) -> float:
        hidden = [light * (1.0 - share) for light, share in zip(lights, shares, strict=True)]
        less = torch.stack(hidden).sum(dim=0) * white
        return difference(frame, whole, (whole - less[..., None]).clamp_min(0.0))

    found = BEYOND * lost([depth_visibility(gbuffer, far) for far in reaches])
    around = eye_visibility(scene, gbuffer, frame.spare_ms, reaches)
    return found if around is None else max(found, lost(around))


def _changed(frame: Frame, visible: Tensor, change: Tensor) -> float:
    """By a change of ambient visibility."""
    radiance = few(frame[DIRECT_LIGHT]).detach().float()
    hidden = sum(_from_around(frame.scene)) * change * _whiteness(frame, radiance, visible, SENSED_SIDE)
    return difference(frame, radiance, radiance + hidden[..., None])


def _whiteness(frame: Frame, radiance: Tensor, visible: Tensor, side: int) -> Tensor:
    """Surfaces as white as the light they send allows, and half white at most, as where next to none arrives."""
    told = radiance.mean(dim=-1) / (sum(_from_around(frame.scene)) * visible).clamp_min(1e-6)
    hidden = (visible < HIDDEN) & few(frame[GBUFFER].covered, side)
    return torch.where(hidden, HALF_WHITE, told).clamp_max(HALF_WHITE)


def _nearness(frame: Frame) -> float | None:
    """Mean share of the hemisphere, about, that area lights take; None without any."""
    lights = [light for light in frame.scene.lights if isinstance(light, RectLight)]
    if not lights:
        return None
    gbuffer = frame[GBUFFER]
    places = few(gbuffer.position)[few(gbuffer.covered)]
    if not len(places):
        return 0.0
    squares = torch.stack([(places - light.centre).square().sum(dim=-1) for light in lights])
    areas = torch.tensor([light.area for light in lights], dtype=squares.dtype)[:, None]
    return float((areas / (areas + squares)).mean(dim=1).sum())


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels; pixels times lights, without and with area; maps of an environment, and of mirrors of it."""
    pixels, point, area = outlook.pixels, float(outlook.point_lights), float(outlook.area_lights)
    if point + area > FEW:  # those that are listed for a tile
        point, area = outlook.known.get(POINT_LISTED, point), outlook.known.get(AREA_LISTED, area)
    return (1.0, pixels, pixels * point, pixels * area, *outlook.fact(_sky_maps))


def _sky_maps(scene: Scene, cameras: Cameras) -> tuple[float, float]:
    """Whether the maps of the environment are still to be made, and whether those of what it mirrors are."""
    del cameras
    mirrors = scene.material_table.has_physical
    if scene.environment is None or SkyMaps.are_made(scene.environment, mirrors):
        return 0.0, 0.0
    return 1.0, float(mirrors)


def over_hits(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Mirrors show exact light whatever the picture takes: what they show may last longer than its options."""
    del history
    return replace(options, area_light="polygon")


def _light_by_light(subject: Subject, outputs: Outputs) -> float:
    scene, seen = subject.scene, subject.gbuffer

    def lit_by(*lights: Light) -> Tensor:
        made = replace(scene, lights=lights)
        made.__dict__["geometry"] = scene.geometry  # the same triangles: the same kernel
        return shade(made, seen)

    rest = lit_by()
    parts = [lit_by(light) - rest for light in scene.lights]
    total = torch.stack([rest, *parts]).double().sum(dim=0)
    return float((total - outputs["radiance"]).abs().max() / total.abs().max().clamp_min(1e-30))


HARD = HardEffect(
    name="direct_light",
    modules=("shade",),
    run=lambda subject: {"radiance": shade(subject.scene, subject.gbuffer)},
    bounds=radiance_bounds,
    law=Law(
        text="the light of all lights is the sum of theirs: largest difference, of the brightest pixel",
        deviation=_light_by_light,
        limit=1e-5,
    ),
)

PASS = Pass(
    name="direct_light",
    summary="light that arrives without detour",
    makes=DIRECT_LIGHT,
    also=(MIRROR_SHARE,),
    needs=(GBUFFER,),
    uses=(LIGHT_REACH, POINT_SHADOW, SOFT_SHADOW, PANE_SHADOW, AMBIENT_VISIBILITY),
    applies=applies,
    run=run,
    settings=settings("irradiance of rectangles", {name: {"area_light": name} for name in ("centre", "polygon")}),
    amounts=amounts,
    once=2,
    senses=senses,
    over_hits=over_hits,
    hard=(HARD,),
)
