"""Records of the stability suite: what cameras see, direct light, and shadows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.effects.shadows.occluders import OccluderOptions, approximate_occluders
from torchrender.effects.shadows.shadow_map import FILTERS, light_visibility, render_shadow_map
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, soft_shadow
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.rays import RayCaster
from torchrender.report.stability.cases import SHADOW, Subject
from torchrender.report.stability.effect import LIGHTS, VIEW, HardEffect, Law, Outputs, difference, mean_over
from torchrender.scene.light import Light, RectLight
from torchrender.shade import shade

SOFT = SoftShadowOptions(light_samples=4)

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
    about=VIEW,
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
        rays_each = len(origins) // max(len(made.cameras), 1)
        near, far = (v.repeat_interleave(rays_each) for v in (made.cameras.near, made.cameras.far))
        t = subject.caster.first_hit(origins, directions, t_min=near, t_max=far).t
        found[f"{number}"], wanted[f"{number}"] = made.depth[:, ::7, ::5].double().reshape(-1), t
    return difference(found, wanted, 1e-4)


SHADOW_MAP = HardEffect(
    name="shadow_map",
    about=LIGHTS,
    modules=("effects.shadows.shadow_map",),
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
    scene, found = subject.scene, {}
    for number, light in enumerate(scene.lights):
        cast = render_shadow_map(scene, light, replace(SHADOW, filter="pcss"))  # the widest border serves all filters
        for name in FILTERS:
            options = replace(SHADOW, filter=name)
            found[f"{name}, light {number}"] = light_visibility(scene, light, subject.gbuffer, options, cast)
    return found


def _receives(subject: Subject, light: Light) -> Tensor:
    """(B,H,W) bool: a surface to whose side the light sends; the other side of a rectangle is not asked for shadows."""
    seen = subject.gbuffer
    if not isinstance(light, RectLight) or not light.area > 0:
        return seen.covered
    before = ((seen.position - light.centre.double()) * light.normal.double()).sum(dim=-1) > 0
    return seen.covered & before


def _hard_shadows_by_rays(subject: Subject, outputs: Outputs) -> float:
    worst = 0.0
    for number, light in enumerate(subject.scene.lights):
        rays = traced_visibility(subject.caster, light, subject.gbuffer)
        wrong = (outputs[f"none, light {number}"] - rays).abs() > 0.5
        worst = max(worst, mean_over(wrong.float(), _receives(subject, light)))
    return worst


POINT_SHADOW = HardEffect(
    name="point_shadow",
    modules=("effects.shadows.shadow_map",),
    run=_light_visibility,
    bounds=lambda s: {f"{name}, light {k}": (0.0, 1.0) for name in FILTERS for k in range(len(s.scene.lights))},
    law=Law(
        text="where filter none says lit or dark, rays to the light (to the middle of one with an area) say the same: "
        "share of pixels where not",
        deviation=_hard_shadows_by_rays,
        limit=0.05,
    ),
    skip=_no_lights,
    turns=False,
)


def _traced_shadows(subject: Subject, backend: str = "auto") -> Outputs:
    caster = subject.caster if backend == "auto" else RayCaster(subject.scene.geometry, backend)
    return {
        f"light {k}": traced_visibility(caster, light, subject.gbuffer, samples=2)
        for k, light in enumerate(subject.scene.lights)
    }


TRACED_SHADOW = HardEffect(
    name="traced_shadow",
    modules=("effects.shadows.traced", "rays"),
    run=_traced_shadows,
    bounds=lambda subject: {f"light {k}": (0.0, 1.0) for k in range(len(subject.scene.lights))},
    law=Law(
        text="two ray casters, Embree and the tree, agree: share of pixels where not",
        deviation=lambda s, found: difference(found, _traced_shadows(s, "bvh")),
        limit=0.0,
    ),
    skip=_no_lights,
)


def _soft_shadows(subject: Subject) -> Outputs:
    scene, lights = subject.scene, subject.area_lights
    options = OccluderOptions(mesh="hybrid", size=32)
    casters = [approximate_occluders(scene, light, options) for light in lights]
    parts = [soft_shadow(c, light, subject.gbuffer, SOFT, bounds=scene.bounds) for c, light in zip(casters, lights)]
    return {
        "scene": soft_shadow(scene.geometry, lights, subject.gbuffer, SOFT).visibility,
        "depth images": torch.cat([p.visibility for p in parts], dim=1),
    }


def _soft_shadows_by_rays(subject: Subject, outputs: Outputs) -> float:
    # The effect takes textured sheets as closed.
    caster = RayCaster(replace(subject.scene.geometry, cutout=None))
    rays = [traced_visibility(caster, light, subject.gbuffer, samples=4) for light in subject.area_lights]
    error = (outputs["scene"] - torch.stack(rays, dim=1)).abs()
    chosen = torch.stack([_receives(subject, light) for light in subject.area_lights], dim=1)
    return mean_over(error, chosen)


SOFT_SHADOW = HardEffect(
    name="soft_shadow",
    about=LIGHTS,
    modules=("effects.shadows.soft_shadow", "effects.shadows.occluders"),
    run=_soft_shadows,
    bounds=lambda _: dict.fromkeys(("scene", "depth images"), (0.0, 1.0)),
    law=Law(
        text="with the scene's own triangles: mean difference to the share of 16 rays that reach the light",
        deviation=_soft_shadows_by_rays,
        limit=0.05,
    ),
    skip=lambda subject: None if subject.area_lights else "no area light",
    turns=False,
)

LIGHT = (GBUFFER, DIRECT_LIGHT, SHADOW_MAP, POINT_SHADOW, TRACED_SHADOW, SOFT_SHADOW)
