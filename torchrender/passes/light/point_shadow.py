"""The pass ``point_shadow``: hard shadows of lights without area."""

from __future__ import annotations

from dataclasses import replace

from torch import Tensor

from torchrender.effects.shadows.light_reach import light_reach
from torchrender.effects.shadows.shadow_map import FILTERS, light_visibility, render_shadow_map
from torchrender.effects.shadows.small_lights import FEWEST, small_light_visibility
from torchrender.effects.shadows.traced import traced_visibilities, traced_visibility
from torchrender.passes.contract import Amounts, Buffers, OwnMeasure, Pass
from torchrender.passes.hard import (
    SMALL_SHADOW,
    HardEffect,
    Law,
    Outputs,
    Subject,
    difference,
    mean_over,
    no_lights,
    receives,
)
from torchrender.passes.light.light_reach import LIGHT_REACH, POINT_LIGHTS
from torchrender.passes.light.shadow_map import SHADOW_MAP
from torchrender.passes.light.standing_light import StandingLight, buffer_of, kept_light, same_light
from torchrender.passes.light.visibility import POINT_SHADOW, lights_by_rays, lights_in_view, visibility_error
from torchrender.passes.outlook import Outlook, Verdict, counted, no_shadows
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.passes.senses import borders
from torchrender.passes.settings import settings
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions, lasting_shadows
from torchrender.rays import RayCaster
from torchrender.scene.light import Light, vectors_to


def applies(outlook: Outlook) -> Verdict:
    """Lights without area cast hard shadows."""
    nothing = no_shadows(outlook)
    if nothing is not None:
        return nothing
    if not outlook.point_lights:
        return Verdict(False, "every light has an area")
    reaching = outlook.known.get(POINT_LIGHTS)
    if reaching == 0:
        return Verdict(False, "no light without area reaches what is seen")
    count = outlook.point_lights if reaching is None else int(reaching)
    return Verdict(True, counted(count, "light") + " without area: hard shadows")


def asks(outlook: Outlook) -> Buffers:
    """Rays or maps; of many lights those that reach little of the picture take rays."""
    if outlook.options.point_shadows == "traced":
        return (RAY_CASTER,)
    many = outlook.known.get(POINT_LIGHTS, 0.0) >= FEWEST or over_many(outlook)
    return (SHADOW_MAP, RAY_CASTER) if many else (SHADOW_MAP,)


def over_many(outlook: Outlook) -> bool:
    """Hits of rays in the light of many small lights, which have no maps of everything."""
    return outlook.samples is not None and outlook.point_lights >= FEWEST


STANDING_POINT_SHADOW = buffer_of("point_shadow")
"""What the next picture can use again."""


def run(frame: Frame) -> tuple[dict[int, Tensor], StandingLight]:
    """Visibility (B,H,W) of the lights without area, by their number; those without a map take rays."""
    found = _visibility(frame, lights_in_view(frame, area=False))
    return found, kept_light(frame, found)


def _visibility(frame: Frame, lights: dict[int, Light]) -> dict[int, Tensor]:
    gbuffer = frame[GBUFFER]
    if frame.options.point_shadows == "traced":
        return traced_visibilities(frame[RAY_CASTER], lights, gbuffer)
    maps, options, small = frame[SHADOW_MAP], frame.options.shadow, lights_by_rays(frame)
    small |= {n for n in lights if maps[n] is None}
    mapped = {n: light for n, light in lights.items() if n not in small}
    same = same_light(frame, STANDING_POINT_SHADOW, mapped)
    found = {n: light_visibility(frame.scene, x, gbuffer, options, maps[n], same.get(n)) for n, x in mapped.items()}
    if small:
        caster = frame.get(RAY_CASTER) or RayCaster(frame.scene.geometry)
        few = {n: lights[n] for n in sorted(small)}
        reach = frame.get(LIGHT_REACH) or light_reach(frame.scene, gbuffer)
        found |= small_light_visibility(caster, few, gbuffer, reach)
    return found


def senses(frame: Frame) -> dict[str, float]:
    """How long the borders of shadows are, whatever filter or rays found them."""
    edges = borders(frame, frame[GBUFFER].covered, frame[POINT_SHADOW].values())
    return {"point_shadow": edges, "shadow_map": edges}


def amounts(outlook: Outlook) -> Amounts:
    """Once; look-ups."""
    return (1.0, outlook.known.get(POINT_LIGHTS, outlook.point_lights) * outlook.pixels)


def over_samples(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Few samples are not worth a ray caster, nor maps of their own: those of everything are there for mirrors."""
    del history
    return replace(options, point_shadows="maps", shadow=replace(options.shadow, coverage="scene"))


def over_hits(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """By maps of everything: others follow the eye."""
    del history
    return replace(
        options, point_shadows="maps", shadow=replace(lasting_shadows(options), coverage="scene", edges="map")
    )


def _filters(subject: Subject) -> Outputs:
    scene, found = subject.scene, {}
    for number, light in enumerate(scene.lights):
        # The widest border serves all filters.
        cast = render_shadow_map(scene, light, replace(SMALL_SHADOW, filter="pcss"))
        for name in FILTERS:
            options = replace(SMALL_SHADOW, filter=name)
            found[f"{name}, light {number}"] = light_visibility(scene, light, subject.gbuffer, options, cast)
    return found


def _maps_by_rays(subject: Subject, outputs: Outputs) -> float:
    worst, seen = 0.0, subject.gbuffer
    for number, light in enumerate(subject.scene.lights):
        rays = traced_visibility(subject.caster, light, seen)
        wrong = (outputs[f"none, light {number}"] - rays).abs() > 0.5
        # Behind its surface nobody asks for a light: there both may say what they like.
        to_light = vectors_to(light, seen.position.reshape(-1, 3)).reshape(seen.position.shape)
        before = (to_light * seen.geometric_normal.double()).sum(dim=-1) > 0
        worst = max(worst, mean_over(wrong.float(), receives(subject, light) & before))
    return worst


HARD = HardEffect(
    name="point_shadow",
    modules=("effects.shadows.shadow_map", "effects.shadows.small_lights"),
    run=_filters,
    bounds=lambda s: {f"{name}, light {k}": (0.0, 1.0) for name in FILTERS for k in range(len(s.scene.lights))},
    law=Law(
        text="where filter none says lit or dark, rays to the light (to the middle of one with an area) say the same: "
        "share of pixels where not",
        deviation=_maps_by_rays,
        limit=0.05,
    ),
    skip=no_lights,
    turns=False,
)


def _traced(subject: Subject, backend: str = "auto") -> Outputs:
    caster = subject.caster if backend == "auto" else RayCaster(subject.scene.geometry, backend)
    return {
        f"light {k}": traced_visibility(caster, light, subject.gbuffer, samples=2)
        for k, light in enumerate(subject.scene.lights)
    }


HARD_RAYS = HardEffect(
    name="traced_shadow",
    modules=("effects.shadows.traced", "rays"),
    run=_traced,
    bounds=lambda subject: {f"light {k}": (0.0, 1.0) for k in range(len(subject.scene.lights))},
    law=Law(
        text="two ray casters, Embree and the tree, agree: share of pixels where not",
        deviation=lambda s, found: difference(found, _traced(s, "bvh")),
        limit=0.0,
    ),
    skip=no_lights,
)

PASS = Pass(
    name="point_shadow",
    summary="hard shadows of lights without area",
    makes=POINT_SHADOW,
    also=(STANDING_POINT_SHADOW,),
    needs=(GBUFFER,),
    uses=(LIGHT_REACH,),
    asks=asks,
    applies=applies,
    run=run,
    settings=settings(
        "look-up",
        {
            "nearest": {"point_shadows": "maps", "shadow.filter": "none", "shadow.edges": "map"},
            "bilinear": {"point_shadows": "maps", "shadow.filter": "bilinear", "shadow.edges": "map"},
            "exact edges": {"point_shadows": "maps", "shadow.filter": "bilinear", "shadow.edges": "exact"},
            "traced": {"point_shadows": "traced", "shadow.filter": "bilinear", "shadow.edges": "exact"},
        },
    ),
    amounts=amounts,
    senses=senses,
    own=OwnMeasure(title="visibility error", buffer=POINT_SHADOW, error=visibility_error(POINT_SHADOW)),
    over_samples=over_samples,
    over_hits=over_hits,
    hard=(HARD, HARD_RAYS),
)
