"""The pass ``hit_shader``: colours of what rays hit, in the light of the picture. Lasts while that does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchrender.effects.ambient.options import AmbientOptions
from torchrender.effects.ambient.traced import traced_ambient
from torchrender.effects.reflections.reflectors import ReflectedRays
from torchrender.effects.shadows.shadow_map import lights_visibility
from torchrender.effects.shadows.small_lights import FEWEST
from torchrender.passes.contract import Amounts, Buffers, Pass, always
from torchrender.passes.hard import (
    SMALL_SHADOW,
    HardEffect,
    Law,
    Outputs,
    Subject,
    displayed,
    mean_over,
    radiance_bounds,
)
from torchrender.passes.light.ambient_visibility import has_ambient_light, reach_of
from torchrender.passes.light.direct_light import ambient_reach
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP, SHADOW_MAP
from torchrender.passes.outlook import Outlook, no_shadows
from torchrender.passes.seen.occluders import OCCLUDERS
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.pipeline.buffer import Buffer, Lasting, look_of, same
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.hit_memory import HitMemory
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions, everywhere, plain_background
from torchrender.pipeline.standing import swept
from torchrender.scene.material_table import wants_gradient
from torchrender.shade import shade


def look_made_with(options: RenderOptions) -> tuple[Any, ...]:
    """What of the options shows in the colours of hits; their shadows are looked up in maps of everything."""
    shadow, area = everywhere(options), options.soft_shadow if _sampled(options) else options.area_shadows
    layers = (options.media, options.transparency, options.transparent_layers)
    return (options.shadows, shadow, area, *layers, plain_background(options), options.ambient_visibility != "off")


def _sampled(options: RenderOptions) -> bool:
    """Rectangular lights are sampled, on hits as in the picture."""
    return options.area_shadows == "sampled"


HIT_SHADER = Buffer("hit_shader", HitShader, lasting=Lasting(look_of, look_made_with))


RAYS_OF_MANY = 2
"""Rays towards ambient light at each of several hits whose mean counts."""

AROUND = 4
"""Pixels and side of the cube map around the scene's middle for which one point looks for ambient light."""

FEW_SAMPLES = 4
"""Along the edges of rectangular lights, for the cube map around the scene's middle."""


def asks(outlook: Outlook) -> Buffers:
    """Maps of everything, as those of the picture follow the eye; and rays to many lights or for ambient light.

    Triangles for lights that are sampled are there where the picture samples them, too.
    """
    if outlook.kept(HIT_SHADER) is not None:
        return ()
    maps: Buffers = () if no_shadows(outlook) else (SCENE_SHADOW_MAP,)
    rays = has_ambient_light(outlook.scene) or (bool(maps) and outlook.point_lights >= FEWEST)
    return (*maps, RAY_CASTER) if rays else maps


def run(frame: Frame) -> HitShader:
    """That of an earlier picture, else one that shades hits by the passes of this picture."""
    earlier = frame.earlier(HIT_SHADER)
    if earlier is not None:
        return earlier
    made_by: dict[Buffer[Any], Buffer[Any]]
    made_by = {SHADOW_MAP: SCENE_SHADOW_MAP, RAY_CASTER: RAY_CASTER, OCCLUDERS: OCCLUDERS}
    given = {own: frame[buffer] for own, buffer in made_by.items() if buffer in frame.values}
    rays = min(frame.options.ambient.rays, RAYS_OF_MANY)
    few = min(frame.options.soft_shadow.light_samples, FEW_SAMPLES)
    of_many = frame.over_hits(given, ambient={"rays": rays})
    around = frame.over_hits(given, ambient={"ray_spacing": AROUND}, soft_shadow={"light_samples": few})
    made = HitShader(frame.scene, frame.over_hits(given), frame.options.background, of_many, around, _memory(frame))
    made.look = _look(frame)
    return made


def _look(frame: Frame) -> tuple[Any, ...]:
    """What shows in the light of hits, but where meshes are."""
    assert frame.history.given is not None
    return (look_of(frame.history.given)[1:], look_made_with(frame.options))


def _memory(frame: Frame) -> HitMemory | None:
    """Light of hits of the picture before, as far as it holds; None where it is not worth keeping any."""
    scene, before = frame.scene, frame.history.last(HIT_SHADER)
    sky = scene.environment is not None and not scene.environment.fill  # hidden from everywhere by what is anywhere
    if not frame.history.sequence or sky or wants_gradient(scene.materials):
        return None
    if before is None or before.memory is None or not same(before.look, _look(frame)):
        return HitMemory()
    moved = swept(before.scene.meshes, scene.meshes)
    if moved is None:
        return HitMemory()
    hidden = has_ambient_light(scene) and frame.options.ambient_visibility != "off"
    reach = reach_of(scene, frame.options.ambient) if hidden else -1.0
    hard = frame.options.area_shadows == "hard"
    return before.memory.following(before.scene, scene, moved, reach, hard=hard)


def amounts(outlook: Outlook) -> Amounts:
    """Once, for the view from the scene's centre, if that was not drawn before."""
    return (0.0,) if outlook.kept(HIT_SHADER) is not None else (1.0,)


def _seen_by_rays(subject: Subject) -> Outputs:
    origins, directions = (rays.reshape(-1, 3) for rays in subject.cameras.rays())
    near = subject.cameras.near.repeat_interleave(len(origins) // max(len(subject.cameras), 1))
    hits = subject.caster.first_hit(origins, directions, t_min=near)  # what the near plane cuts away is not seen
    # As wide as a pixel, so that textures are as blurred as in the picture.
    width = subject.cameras.footprint(subject.gbuffer.depth.double()).reshape(-1)
    width = torch.where(torch.isfinite(width), width, 0.0)
    lengths = directions.norm(dim=-1)
    hits = replace(hits, t=hits.t * lengths)
    rays = ReflectedRays(origins, directions / lengths[:, None], width, torch.zeros_like(width))
    return {"radiance": subject.shader(rays, hits)}


def _as_the_picture(subject: Subject, outputs: Outputs) -> float:
    scene, seen = subject.scene, subject.gbuffer
    around = None
    if has_ambient_light(scene) and scene.geometry.triangle_count:
        reach = reach_of(scene, AmbientOptions())
        around = ambient_reach(scene, traced_ambient(subject.caster, seen, rays=64, reach=reach))
    wanted = shade(scene, seen, lights_visibility(scene, seen, SMALL_SHADOW), around=around).reshape(-1, 3)
    mirrors = scene.material_table.is_reflector[seen.material]
    plain = seen.covered & ~mirrors
    error: Tensor = (displayed(outputs["radiance"]) - displayed(wanted)).abs().mean(dim=-1)
    return mean_over(error, plain.reshape(-1))


HARD = HardEffect(
    name="hit_shader",
    modules=("pipeline.hit_shader", "shading.ray_surface"),
    run=_seen_by_rays,
    bounds=radiance_bounds,
    law=Law(
        text="rays of the camera bring what the picture shows where nothing mirrors: mean display difference",
        deviation=_as_the_picture,
        limit=0.02,  # maps of the scene against maps of the view: their borders lie elsewhere
    ),
    turns=False,  # what is mirrored in mirrors comes from a cube map along the axes
    rounding=0.03,  # its texels, and those of shadow maps, may change sides
    twins=0.03,
)

PASS = Pass(
    name="hit_shader",
    summary="shades what rays hit in the light of the picture",
    makes=HIT_SHADER,
    uses=(OCCLUDERS,),
    asks=asks,
    applies=always("rays hit something"),
    run=run,
    amounts=amounts,
    hard=(HARD,),
)
