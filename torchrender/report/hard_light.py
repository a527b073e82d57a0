"""Records of the stability suite: what cameras see, light, shadows, reflections, and the whole picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer
from torchrender.effects.clustered_reflection import clustered_reflections
from torchrender.effects.reflection_reuse import ReuseState, reuse_reflections
from torchrender.effects.shadow_map import FILTERS, light_visibility, render_shadow_map
from torchrender.effects.soft_shadow import SoftShadowOptions, soft_shadow
from torchrender.effects.traced_reflection import environment_reflections, trace_reflections
from torchrender.geometry.light_occluders import OccluderOptions, approximate_occluders
from torchrender.rays import RayCaster
from torchrender.reflection.reflectors import reflective_pixels
from torchrender.renderer import RenderOptions, render
from torchrender.report.hard_cases import SHADOW, Subject
from torchrender.report.hard_effect import HardEffect, Law, Outputs, difference, displayed, mean_over
from torchrender.report.shadow_quality import ray_cast_visibility
from torchrender.scene.light import Light, RectLight
from torchrender.scene.model import Scene
from torchrender.shade import shade

SOFT = SoftShadowOptions(light_samples=4, map_size=128)

Bounds = Mapping[str, tuple[float, float]]


# ------------------------------------------------------------------ G-buffer


def _gbuffer(subject: Subject) -> Outputs:
    seen = subject.gbuffer
    local = subject.cameras.transform(seen.position) / subject.unit
    toward = torch.nn.functional.normalize(seen.position - subject.cameras.eye[:, None, None], dim=-1)
    return {
        "depth": seen.depth / subject.unit,
        "triangle": seen.triangle,
        "material": seen.material,
        "position": torch.where(seen.covered[..., None], local, 0.0),
        "facing": torch.where(seen.covered, (seen.geometric_normal.double() * toward).sum(-1), 0.0),
        "length": seen.normal.norm(dim=-1),
        "barycentric": seen.barycentric,
        "uv": seen.uv,
    }


def _gbuffer_bounds(_: Subject) -> Bounds:
    unlimited = (-torch.finfo(torch.float64).max, torch.finfo(torch.float64).max)
    return {
        "depth": (0.0, math.inf), "position": unlimited, "facing": (-1.0 - 1e-6, 1e-6), "length": (0.0, 1.0 + 1e-5),
        "barycentric": (0.0, 1.0), "uv": (-1e6, 1e6),
    }  # fmt: skip


def _against_rays(subject: Subject, outputs: Outputs) -> float:
    origins, directions = subject.cameras.rays()
    near, far = (v[:, None, None].expand(origins.shape[:3]) for v in (subject.cameras.near, subject.cameras.far))
    hits = subject.caster.first_hit(
        origins.reshape(-1, 3), directions.reshape(-1, 3), t_min=near.reshape(-1), t_max=far.reshape(-1)
    )
    depth = (hits.t / subject.unit).reshape(origins.shape[:3])
    return difference({"depth": outputs["depth"].double()}, {"depth": depth}, 1e-4)


GBUFFER = HardEffect(
    name="gbuffer",
    modules=("raster",),
    run=_gbuffer,
    bounds=_gbuffer_bounds,
    law=Law(
        text="rays through the pixel centres hit at the same depth: share of pixels where not",
        deviation=_against_rays,
        limit=0.01,
    ),
)


# -------------------------------------------------------------- direct light


def _radiance_bounds(subject: Subject) -> Bounds:
    return {"radiance": (0.0, subject.radiance_limit)}


def _light_by_light(subject: Subject, outputs: Outputs) -> float:
    scene, seen = subject.scene, subject.gbuffer
    dark = replace(scene, lights=())
    rest = shade(dark, seen)
    parts = [shade(replace(scene, lights=(light,)), seen) - rest for light in scene.lights]
    total = torch.stack([rest, *parts]).double().sum(dim=0)
    return float((total - outputs["radiance"]).abs().max() / total.abs().max().clamp_min(1e-30))


DIRECT_LIGHT = HardEffect(
    name="direct_light",
    modules=("shade",),
    run=lambda subject: {"radiance": shade(subject.scene, subject.gbuffer)},
    bounds=_radiance_bounds,
    law=Law(
        text="the light of all lights is the sum of theirs: largest difference, of the brightest pixel",
        deviation=_light_by_light,
        limit=1e-5,
    ),
)


# ------------------------------------------------------------------- shadows


def _no_lights(subject: Subject) -> str | None:
    return None if subject.scene.lights else "no lights"


def _shadow_maps(subject: Subject) -> Outputs:
    scene = subject.scene
    maps = (render_shadow_map(scene, light, SHADOW).depth for light in scene.lights)
    return {f"light {k}": depth / subject.unit for k, depth in enumerate(maps)}


def _texels_by_rays(subject: Subject, _: Outputs) -> float:
    found, wanted = {}, {}
    for number, light in enumerate(subject.scene.lights):
        made = render_shadow_map(subject.scene, light, SHADOW)
        origins, directions = (v[:, ::7, ::5].reshape(-1, 3) for v in made.cameras.rays())
        limits = (v.repeat_interleave(len(origins) // len(made.cameras)) for v in (made.cameras.near, made.cameras.far))
        t = subject.caster.first_hit(origins, directions, **dict(zip(("t_min", "t_max"), limits))).t
        found[f"{number}"], wanted[f"{number}"] = made.depth[:, ::7, ::5].double().reshape(-1), t
    return difference(found, wanted, 1e-4)


SHADOW_MAP = HardEffect(
    name="shadow_map",
    modules=("effects.shadow_map",),
    run=_shadow_maps,
    bounds=lambda subject: {f"light {k}": (0.0, math.inf) for k in range(len(subject.scene.lights))},
    law=Law(
        text="rays through the texel centres hit at the stored depth: share of texels where not",
        deviation=_texels_by_rays,
        limit=0.01,
    ),
    skip=_no_lights,
    turns=False,
)


def _light_visibility(subject: Subject) -> Outputs:
    scene = subject.scene
    return {
        name: torch.stack(
            [light_visibility(scene, light, subject.gbuffer, replace(SHADOW, filter=name)) for light in scene.lights], 1
        )
        for name in FILTERS
    }


def _receives(subject: Subject, light: Light) -> Tensor:
    """(B,H,W) bool: a surface to whose side the light sends; the other side of a rectangle is not asked for shadows."""
    seen = subject.gbuffer
    if not isinstance(light, RectLight) or not light.area > 0:
        return seen.covered
    before = ((seen.position - light.centre.double()) * light.normal.double()).sum(dim=-1) > 0
    return seen.covered & before


def _hard_shadows_by_rays(subject: Subject, outputs: Outputs) -> float:
    seen = subject.gbuffer
    chosen = torch.stack([_receives(subject, light) for light in subject.scene.lights], dim=1)
    rays = torch.stack([ray_cast_visibility(subject.scene, light, seen) for light in subject.scene.lights], dim=1)
    return mean_over(((outputs["none"] - rays).abs() > 0.5).float(), chosen)


LIGHT_VISIBILITY = HardEffect(
    name="light_visibility",
    modules=("effects.shadow_map",),
    run=_light_visibility,
    bounds=lambda _: dict.fromkeys(FILTERS, (0.0, 1.0)),
    law=Law(
        text="rays to the lights (to the middle of those with an area) meet nothing where filter none says so: share "
        "of pixels where not",
        deviation=_hard_shadows_by_rays,
        limit=0.1,
    ),
    skip=_no_lights,
    turns=False,
)


def _soft_shadows(subject: Subject) -> Outputs:
    scene, lights = subject.scene, subject.area_lights
    found = {"scene": soft_shadow(scene.geometry, lights, subject.gbuffer, SOFT).visibility}
    for mesh in ("triangles", "hybrid"):
        options = OccluderOptions(mesh=mesh, size=64)
        casters = [approximate_occluders(scene, light, options) for light in lights]
        parts = [soft_shadow(c, light, subject.gbuffer, SOFT, bounds=scene.bounds) for c, light in zip(casters, lights)]
        found[mesh] = torch.cat([p.visibility for p in parts], dim=1)
    return found


def _soft_shadows_by_rays(subject: Subject, outputs: Outputs) -> float:
    # The effect takes textured sheets as closed.
    closed = replace(subject.scene, materials=tuple(replace(m, alpha_cutoff=None) for m in subject.scene.materials))
    rays = [ray_cast_visibility(closed, light, subject.gbuffer, samples=4) for light in subject.area_lights]
    error = (outputs["scene"] - torch.stack(rays, dim=1)).abs()
    chosen = torch.stack([_receives(subject, light) for light in subject.area_lights], dim=1)
    return mean_over(error, chosen)


SOFT_SHADOW = HardEffect(
    name="soft_shadow",
    modules=("effects.soft_shadow", "geometry.light_occluders"),
    run=_soft_shadows,
    bounds=lambda _: dict.fromkeys(("scene", "triangles", "hybrid"), (0.0, 1.0)),
    law=Law(
        text="with the scene's own triangles: mean difference to the share of 16 rays that reach the light",
        deviation=_soft_shadows_by_rays,
        limit=0.05,
    ),
    skip=lambda subject: None if subject.area_lights else "no area light",
)


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
    modules=("effects.clustered_reflection",),
    run=lambda s: _layer(clustered_reflections(s.scene, s.pixels, s.shader).layer, s),
    bounds=_layer_bounds,
    law=Law(
        text="mean difference of display values to traced reflections",
        deviation=lambda s, found: _mean_color_error(found["color"], _traced(s).color, s),
        limit=0.1,
    ),
    skip=_no_mirrors,
)

TRACED_REFLECTIONS = HardEffect(
    name="traced_reflections",
    modules=("effects.traced_reflection",),
    run=lambda s: _layer(_traced(s), s),
    bounds=_layer_bounds,
    law=Law(
        text="two ray casters, Embree and the tree, agree: share of values where not",
        deviation=lambda s, found: difference(found, _layer(_traced(s, "bvh"), s)),
        limit=0.0,
    ),
    skip=_no_mirrors,
)


def _some_alone(subject: Subject, outputs: Outputs) -> float:
    some = subject.pixels.select(torch.arange(len(subject.pixels))[::3])
    alone = environment_reflections(some, subject.shader).color.reshape(-1, 3)[some.pixel]
    return difference({"color": outputs["color"].reshape(-1, 3)[some.pixel]}, {"color": alone})


ENVIRONMENT_REFLECTIONS = HardEffect(
    name="environment_reflections",
    modules=("effects.traced_reflection",),
    run=lambda s: _layer(environment_reflections(s.pixels, s.shader), s),
    bounds=_layer_bounds,
    law=Law(
        text="every third pixel alone mirrors what it mirrors among all: share of values that differ",
        deviation=_some_alone,
        limit=0.0,
    ),
    skip=_no_mirrors,
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
    modules=("effects.reflection_reuse",),
    run=_reused,
    bounds=lambda s: dict.fromkeys(("key", "still", "moved"), (0.0, s.radiance_limit)),
    law=Law(
        text="the second frame of a camera that stands still is the first: mean difference of display values",
        deviation=lambda s, found: _mean_color_error(found["still"], found["key"], s),
        limit=0.02,
    ),
    skip=_no_mirrors,
)


# ------------------------------------------------------------- whole picture


def _picture(subject: Subject) -> Outputs:
    options = RenderOptions(shadow=SHADOW)
    return {"radiance": render(subject.scene, subject.cameras, options=options).radiance}


def _one_by_one(subject: Subject, outputs: Outputs) -> float:
    alone = torch.cat([_picture(subject.single(k))["radiance"] for k in range(len(subject.cameras))])
    return float((displayed(alone) - displayed(outputs["radiance"])).abs().mean())


def _default_light_limit(subject: Subject) -> Bounds:
    lit: Scene = subject.scene.with_default_light()
    return {"radiance": (0.0, replace(subject, scene=lit).radiance_limit)}


PICTURE = HardEffect(
    name="resolve",
    modules=("renderer",),
    run=_picture,
    bounds=_default_light_limit,
    law=Law(
        text="pictures made one by one are those made together: mean difference of display values",
        deviation=_one_by_one,
        limit=0.01,
    ),
)

LIGHT = (
    GBUFFER, DIRECT_LIGHT, SHADOW_MAP, LIGHT_VISIBILITY, SOFT_SHADOW, REFLECTIONS, TRACED_REFLECTIONS,
    ENVIRONMENT_REFLECTIONS, REFLECTION_REUSE, PICTURE,
)  # fmt: skip
