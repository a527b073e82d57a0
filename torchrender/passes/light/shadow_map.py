"""The pass ``shadow_map``: depth as lights see it. Lasts while triangles and lights stand still."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from torchrender.buffers import ShadowMap
from torchrender.effects.shadows.shadow_map import render_shadow_map
from torchrender.passes.contract import Amounts, OwnMeasure, Pass
from torchrender.passes.hard import LIGHTS, SMALL_SHADOW, HardEffect, Law, Outputs, Subject, difference, no_lights
from torchrender.passes.light.visibility import POINT_SHADOW, SOFT_SHADOW, visibility_error
from torchrender.passes.outlook import Outlook, Verdict, counted, no_shadows
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer, Lasting, lights_of
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.options import RenderOptions, lasting_shadows
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight


def _made_with(options: RenderOptions) -> tuple[Any, ...]:
    # Cascades follow the eye: they do not last.
    lasts = options.shadow.cascades == 1
    return (options.shadows, lasting_shadows(options), None if lasts else object())


SHADOW_MAP: Buffer[tuple[ShadowMap | None, ...]] = Buffer("shadow_map", tuple, lasting=Lasting(lights_of, _made_with))
"""One per light of the scene, in its order; None for lights whose map nobody looks up."""


def applies(outlook: Outlook) -> Verdict:
    """Some light casts shadows."""
    return no_shadows(outlook) or Verdict(True, counted(len(outlook.scene.lights), "light"))


def looked_up(light: Light, options: RenderOptions) -> bool:
    """The picture itself looks the light's map up."""
    return options.area_shadows != "sampled" if isinstance(light, RectLight) else options.point_shadows == "maps"


def run(frame: Frame) -> tuple[ShadowMap | None, ...]:
    """The maps of an earlier picture, and those that it did not need."""
    options, scene = frame.options, frame.scene
    view = frame[GBUFFER].cameras if options.shadow.cascades > 1 else None
    earlier = frame.earlier(SHADOW_MAP)
    every_light = bool(frame.askers(SHADOW_MAP) - {POINT_SHADOW, SOFT_SHADOW})
    made = list(earlier or [None] * len(scene.lights))
    for number, light in enumerate(scene.lights):
        if made[number] is None and (every_light or looked_up(light, options)):
            # With the border that penumbrae need, so that the same map serves both kinds of look-up.
            how = lasting_shadows(options)
            how = replace(how, filter="pcss", soft=None) if isinstance(light, RectLight) else how
            made[number] = render_shadow_map(scene, light, how, camera=view)
    drawn = earlier is None or any(a is not b for a, b in zip(made, earlier, strict=True))
    return tuple(made) if earlier is None or drawn else earlier


def views(light: Light) -> int:
    """Pictures that a shadow map of the light takes."""
    if isinstance(light, DirectionalLight):
        return 1
    if isinstance(light, PointLight):
        return 6
    if isinstance(light, RectLight):
        return 5
    return 1 if light.outer_deg <= 65.0 else 5


def amounts(outlook: Outlook) -> Amounts:
    """Views; their texels; their triangles: nothing if the maps are there already."""
    if outlook.kept(SHADOW_MAP) is not None:
        return (0.0, 0.0, 0.0)
    count = float(sum(views(light) for light in outlook.scene.lights))
    height, width = outlook.options.shadow.shape
    return (count, count * height * width * 1e-6, count * outlook.triangles)


def _depths(subject: Subject) -> Outputs:
    scene = subject.scene
    maps = (render_shadow_map(scene, light, SMALL_SHADOW).depth for light in scene.lights)
    return {f"light {k}": depth / subject.unit for k, depth in enumerate(maps)}


def _texels_by_rays(subject: Subject, _: Outputs) -> float:
    found, wanted = {}, {}
    for number, light in enumerate(subject.scene.lights):
        made = render_shadow_map(subject.scene, light, SMALL_SHADOW)
        origins, directions = (v[:, ::7, ::5].reshape(-1, 3) for v in made.cameras.rays())
        rays_each = len(origins) // max(len(made.cameras), 1)
        near, far = (v.repeat_interleave(rays_each) for v in (made.cameras.near, made.cameras.far))
        t = subject.caster.first_hit(origins, directions, t_min=near, t_max=far).t
        found[f"{number}"], wanted[f"{number}"] = made.depth[:, ::7, ::5].double().reshape(-1), t
    return difference(found, wanted, 1e-4)


HARD = HardEffect(
    name="shadow_map",
    about=LIGHTS,
    modules=("effects.shadows.shadow_map",),
    run=_depths,
    bounds=lambda subject: {f"light {k}": (0.0, math.inf) for k in range(len(subject.scene.lights))},
    law=Law(
        text="rays through the texel centres hit at the stored depth: share of texels where not",
        deviation=_texels_by_rays,
        limit=0.01,
    ),
    skip=no_lights,
    turns=False,
)

PASS = Pass(
    name="shadow_map",
    summary="depth as lights see it",
    makes=SHADOW_MAP,
    needs=(GBUFFER,),
    applies=applies,
    run=run,
    settings=settings(
        "texels of a map's side",
        {str(size): {"shadow.size": size} for size in (256, 512, 1024, 2048)},
        ("4096", {"shadow.size": 4096}),
    ),
    amounts=amounts,
    one_cost=True,
    own=OwnMeasure(title="visibility error", buffer=POINT_SHADOW, error=visibility_error(POINT_SHADOW)),
    hard=(HARD,),
)
