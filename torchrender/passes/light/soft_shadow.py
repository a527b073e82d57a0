"""The pass ``soft_shadow``: shadows of rectangular lights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.effects.shadows.light_cameras import wide_lights
from torchrender.effects.shadows.occluders import OccluderOptions, approximate_occluders
from torchrender.effects.shadows.shadow_map import light_visibility
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, soft_shadow
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.passes.contract import Amounts, Buffers, OwnMeasure, Pass, Prices
from torchrender.passes.hard import LIGHTS, HardEffect, Law, Outputs, Subject, mean_over, receives
from torchrender.passes.light.light_reach import AREA_LIGHTS, LIGHT_REACH
from torchrender.passes.light.probe import few_rows, surface_of
from torchrender.passes.light.shadow_map import SHADOW_MAP
from torchrender.passes.light.standing_light import StandingLight, buffer_of, kept_light, same_light
from torchrender.passes.light.visibility import POINT_SHADOW, SOFT_SHADOW, lights_in_view, visibility_error
from torchrender.passes.outlook import Outlook, Verdict, counted, no_shadows
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.seen.occluders import OCCLUDERS
from torchrender.passes.senses import borders, partly_lit
from torchrender.passes.settings import Setting, settings
from torchrender.pipeline.doubts import lights_told
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light, RectLight
from torchrender.scene.model import Scene


def applies(outlook: Outlook) -> Verdict:
    """Lights with an area have penumbrae."""
    nothing = no_shadows(outlook)
    if nothing is not None:
        return nothing
    if not outlook.area_lights:
        return Verdict(False, "no light has an area: hard shadows by shadow map instead")
    reaching = outlook.known.get(AREA_LIGHTS)
    if reaching == 0:
        return Verdict(False, "no light with an area reaches what is seen")
    told = counted(outlook.area_lights if reaching is None else int(reaching), "light") + " with an area"
    wide = outlook.fact(_wide) if outlook.options.area_shadows == "sampled" else ()
    return Verdict(True, f"{told}; {lights_told(outlook.scene, wide)} too large for one map" if wide else told)


def _wide(scene: Scene, _: Cameras) -> tuple[int, ...]:
    return wide_lights(scene)


def left_open(options: RenderOptions) -> bool:
    """The usual way is not asked for by name."""
    return options.area_shadows == "pcss" and PASS.name not in options.fixed


def settle(outlook: Outlook, prices: Prices) -> RenderOptions:
    """Samples instead of a map from the middle of each light, where such maps miss much of what some light reaches."""
    del prices
    options = outlook.options
    if not left_open(options) or no_shadows(outlook) is not None or not outlook.fact(_wide):
        return options
    return Setting(SAMPLED, WAYS[SAMPLED]).applied(options)


def asks(outlook: Outlook) -> Buffers:
    """Triangles or maps."""
    return (OCCLUDERS,) if outlook.options.area_shadows == "sampled" else (SHADOW_MAP,)


STANDING_SOFT_SHADOW = buffer_of("soft_shadow")
"""What the next picture can use again."""


def run(frame: Frame) -> tuple[dict[int, Tensor], StandingLight]:
    """Visibility (B,H,W) of the rectangular lights, by their number."""
    found = _found(frame, lights_in_view(frame, area=True))
    return found, kept_light(frame, found)


AT_HITS = 8.0
"""Texels, at most, that guessed penumbrae of hits reach to either side: no triangles settle their edges, and the wider
they are the more light gets in where things touch."""


def _found(frame: Frame, lights: dict[int, Light]) -> dict[int, Tensor]:
    gbuffer, options = frame[GBUFFER], frame.options
    if options.area_shadows == "sampled":
        rectangles = [light for light in lights.values() if isinstance(light, RectLight)]
        found = soft_shadow(frame[OCCLUDERS], rectangles, gbuffer, options.soft_shadow, bounds=frame.scene.bounds)
        return dict(zip(lights, found.visibility.unbind(1), strict=True))
    maps = frame[SHADOW_MAP]
    if options.area_shadows == "pcss":
        by_size = replace(options.shadow, filter="pcss", soft=None)
        if isinstance(gbuffer, RaySurface):
            by_size = replace(by_size, largest_radius=min(by_size.largest_radius, AT_HITS))
    else:
        by_size = options.shadow
    same = same_light(frame, STANDING_SOFT_SHADOW, lights)
    return {n: light_visibility(frame.scene, x, gbuffer, by_size, maps[n], same.get(n)) for n, x in lights.items()}


def senses(frame: Frame) -> dict[str, float]:
    """How much of the picture lies in penumbrae, and how long the borders of shadows are.

    Hard shadows have no penumbrae that would tell what leaving them out changes: there, those of a few pixels count, by
    the same maps.
    """
    covered, lights = frame[GBUFFER].covered, frame[SOFT_SHADOW].values()
    lit = _guessed(frame) if frame.options.area_shadows == "hard" else partly_lit(covered, lights)
    found = {} if lit is None else {"soft_shadow": lit}
    return found if POINT_SHADOW in frame.values else {**found, "shadow_map": borders(frame, covered, lights)}


def _guessed(frame: Frame) -> float | None:
    """Share of the picture in penumbrae, summed over the lights; None where a few pixels do not tell."""
    gbuffer = frame[GBUFFER]
    if not isinstance(gbuffer, GBuffer):
        return None
    rows, part = few_rows(gbuffer)
    if not len(rows):
        return 0.0
    surface, by_size = surface_of(frame, gbuffer, rows).image, replace(frame.options.shadow, filter="pcss", soft=None)
    seen = [
        light_visibility(frame.scene, light, surface, by_size, frame[SHADOW_MAP][n])
        for n, light in lights_in_view(frame, area=True).items()
        if frame[SHADOW_MAP][n] is not None
    ]
    return part * sum(partly_lit(one >= 0.0, [one], len(rows)) for one in seen)


def amounts(outlook: Outlook) -> Amounts:
    """Once; look-ups."""
    return (1.0, outlook.known.get(AREA_LIGHTS, outlook.area_lights) * outlook.pixels)


def over_samples(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Few samples, from anywhere: penumbrae by map, where the picture left no triangles sorted for its own.

    With these the shader of what mirrors show stays that of the picture, too.
    """
    if options.area_shadows != "sampled" or history.get(OCCLUDERS, options) is not None:
        return options
    return replace(options, area_shadows="pcss")


FEW = SoftShadowOptions(light_samples=4)


def _visibility(subject: Subject) -> Outputs:
    scene, lights = subject.scene, subject.area_lights
    options = OccluderOptions(mesh="hybrid", size=32)
    casters = [approximate_occluders(scene, light, options) for light in lights]
    rebuilt = replace(FEW, occluders="rebuilt")
    parts = [soft_shadow(c, light, subject.gbuffer, rebuilt, bounds=scene.bounds) for c, light in zip(casters, lights)]
    return {
        "scene": soft_shadow(scene.geometry, lights, subject.gbuffer, FEW).visibility,
        "depth images": torch.cat([p.visibility for p in parts], dim=1),
    }


def _by_rays(subject: Subject, outputs: Outputs) -> float:
    # The effect takes textured sheets as closed.
    caster = RayCaster(replace(subject.scene.geometry, cutout=None))
    rays = [traced_visibility(caster, light, subject.gbuffer, samples=4) for light in subject.area_lights]
    error = (outputs["scene"] - torch.stack(rays, dim=1)).abs()
    chosen = torch.stack([receives(subject, light) for light in subject.area_lights], dim=1)
    return mean_over(error, chosen)


HARD = HardEffect(
    name="soft_shadow",
    about=LIGHTS,
    modules=("effects.shadows.soft_shadow", "effects.shadows.occluders"),
    run=_visibility,
    bounds=lambda _: dict.fromkeys(("scene", "depth images"), (0.0, 1.0)),
    law=Law(
        text="with the scene's own triangles: mean difference to the share of 16 rays that reach the light",
        deviation=_by_rays,
        limit=0.05,
    ),
    skip=lambda subject: None if subject.area_lights else "no area light",
    turns=False,
)

WAYS: Mapping[str, Mapping[str, Any]] = {
    "hard": {"area_shadows": "hard"},
    "pcss": {"area_shadows": "pcss"},
    "4 x 4": {"area_shadows": "sampled", "soft_shadow.light_samples": 4},
    "8 x 8": {"area_shadows": "sampled", "soft_shadow.light_samples": 8},
    "16 x 16": {"area_shadows": "sampled", "soft_shadow.light_samples": 16},
}

SAMPLED = "8 x 8"
"""Of these where maps fail and nobody says how."""

PASS = Pass(
    name="soft_shadow",
    summary="shadows of rectangular lights",
    makes=SOFT_SHADOW,
    also=(STANDING_SOFT_SHADOW,),
    needs=(GBUFFER,),
    uses=(LIGHT_REACH,),
    asks=asks,
    applies=applies,
    run=run,
    settle=settle,
    settings=settings(
        "way, light samples",
        WAYS,
    ),
    amounts=amounts,
    senses=senses,
    own=OwnMeasure(title="visibility error", buffer=SOFT_SHADOW, error=visibility_error(SOFT_SHADOW)),
    over_samples=over_samples,
    hard=(HARD,),
)
