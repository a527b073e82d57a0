"""The pass ``sky_shadow``: shadows that moving or chosen objects cast under the environment's light."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.effects.ambient.visibility import AmbientVisibility
from torchrender.effects.sky_shadows.occluder import chosen_meshes, occluder_of
from torchrender.effects.sky_shadows.options import SkyLightOptions
from torchrender.effects.sky_shadows.picture import (
    EVEN,
    Surroundings,
    light_left,
    light_lost,
    light_of,
    no_more_than_hides,
    unevenness,
)
from torchrender.effects.sky_shadows.shade import shade
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import HardEffect, Law, Outputs, Subject
from torchrender.passes.light.ambient_visibility import AMBIENT_VISIBILITY
from torchrender.passes.light.direct_light import ambient_reach
from torchrender.passes.outlook import Outlook, Verdict, counted
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer, Layer, Order
from torchrender.pipeline.frame import Frame
from torchrender.scene.model import Scene


def _darken(scene: Scene, gbuffer: GBuffer, radiance: Tensor, lost: Tensor) -> Tensor:
    """What does not arrive is taken off what surfaces send; what ambient visibility took too much comes back."""
    del scene, gbuffer
    return (radiance - lost).clamp_min(0.0)


SKY_SHADOW = Buffer("sky_shadow", Tensor, layer=Layer(Order.DIRECT + 2, _darken))
"""Radiance (B,H,W,3) that surfaces do not send because objects hide a part of the environment from them.

Negative where ambient visibility, which takes all light from everywhere for the same, hid more than they do."""


def applies(outlook: Outlook) -> Verdict:
    """An environment with structure, and something that moves before it or was chosen."""
    scene, options = outlook.scene, outlook.options
    if not options.shadows:
        return Verdict(False, "shadows are turned off")
    environment = scene.environment
    if environment is None or not environment.intensity > 0:
        return Verdict(False, "no environment lights the scene")
    meshes = chosen_meshes(scene, options.sky_shadow.occluders)
    if not any(len(scene.meshes[m].faces) for m in meshes):
        return Verdict(False, "nothing moves and nothing was chosen: ambient visibility is enough")
    if isinstance(outlook.samples, RaySurface):
        return Verdict(False, "mirrors show the environment's light without these shadows")
    if unevenness(environment) < EVEN:
        return Verdict(False, "the environment is even: ambient visibility is enough")
    count = options.sky_shadow.sphere.spheres
    return Verdict(True, f"{counted(len(meshes), 'mesh')}, as {counted(count, 'sphere')}, under {environment.name}")


def run(frame: Frame) -> Tensor:
    """Radiance (B,H,W,3) to take away."""
    scene, gbuffer, options = frame.scene, frame[GBUFFER], frame.options.sky_shadow
    occluder = occluder_of(scene, chosen_meshes(scene, options.occluders), options.sphere)
    if occluder is None or scene.environment is None:
        return torch.zeros(*gbuffer.covered.shape, 3)
    light = light_of(scene.environment, options.light)
    left = light_left(scene, gbuffer, occluder, light, options.spacing)
    around = _surroundings(scene, frame.get(AMBIENT_VISIBILITY))
    if around is not None:
        own = gbuffer.covered & (occluder.face_spheres(scene)[gbuffer.triangle.clamp_min(0)] >= 0)
        left = no_more_than_hides(left, around.sky, own)
    return light_lost(scene, gbuffer, left, around)


def _surroundings(scene: Scene, found: AmbientVisibility | None) -> Surroundings | None:
    """What the picture's light was computed with."""
    reach = ambient_reach(scene, found)
    if reach is None or found is None or scene.environment is None:
        return None
    return Surroundings(reach.visibility, reach.bent_normal, found.near if scene.environment.fill else found.sky)


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels; shaded points; these times spheres, in hundreds."""
    options = outlook.options.sky_shadow
    points = outlook.pixels / options.spacing**2
    return (1.0, outlook.pixels, points, points * options.sphere.spheres / 100)


def _left(subject: Subject) -> Outputs:
    """A white floor at what is seen, under spheres there, in the light of half the sky."""
    points, normals, spheres = _parts(subject)
    light = light_of_half(SkyLightOptions(direct_bits=True))
    return {"radiance": shade(points, normals, spheres, light).radiance}


def light_of_half(options: SkyLightOptions) -> Any:
    """Light of the upper half of all directions, radiance one."""
    from torchrender.effects.sky_shadows.light import prepare_light
    from torchrender.scene.sky.cube_map import texel_directions

    return prepare_light((texel_directions(32)[..., 1:2] > 0).double().expand(-1, -1, -1, 3).contiguous(), options)


def _parts(subject: Subject) -> tuple[Tensor, Tensor, Tensor]:
    seen = subject.gbuffer
    rows = seen.covered[0].reshape(-1).nonzero().reshape(-1)[::7][:400]
    points, normals = seen.position[0].reshape(-1, 3)[rows], seen.normal[0].reshape(-1, 3)[rows]
    size = float((points.amax(0) - points.amin(0)).norm()) if len(rows) else 1.0
    centres = points[:: max(len(rows) // 8, 1)] + 0.1 * size * normals[:: max(len(rows) // 8, 1)].double()
    spheres = torch.cat([centres, torch.full((len(centres), 1), 0.08 * size, dtype=torch.float64)], dim=1)
    return points[None], normals[None], spheres[None]


def _more_spheres(subject: Subject, outputs: Outputs) -> float:
    points, normals, spheres = _parts(subject)
    light = light_of_half(SkyLightOptions(direct_bits=True, terms=6138))
    few = shade(points, normals, spheres[:, ::2], light).radiance
    many = shade(points, normals, spheres, light).radiance
    del outputs
    return float((many - few).clamp_min(0.0).max()) if many.numel() else 0.0


HARD = HardEffect(
    name="sky_shadow",
    modules=("effects.sky_shadows.shade", "effects.sky_shadows.occluder", "effects.sky_shadows.picture"),
    run=_left,
    bounds=lambda _: {"radiance": (0.0, 1.01)},
    law=Law(text="a further sphere brings no light: most that it brings", deviation=_more_spheres, limit=0.01),
    turns=False,  # the cube map lies along the axes
    rounding=0.05,
)


def _choice(spacing: int, levels: int, terms: int) -> dict[str, Any]:
    return {
        "sky_shadow.spacing": spacing, "sky_shadow.light.levels": levels, "sky_shadow.light.terms": terms,
        "sky_shadow.light.direct_bits": False,
    }  # fmt: skip


PASS = Pass(
    name="sky_shadow",
    summary="shadows of moving objects under the environment",
    makes=SKY_SHADOW,
    needs=(GBUFFER,),
    uses=(AMBIENT_VISIBILITY,),
    applies=applies,
    run=run,
    settings=settings(
        "pixels per point, terms",
        {
            "4, 50": _choice(4, 1, 50),
            "3, 100": _choice(3, 2, 100),
            "2, 200": _choice(2, 2, 200),
            "1, 400": _choice(1, 2, 400),
        },
        ("exact caps", {**_choice(1, 2, 6138), "sky_shadow.light.direct_bits": True}),
    ),
    amounts=amounts,
    one_cost=True,
    hard=(HARD,),
)
