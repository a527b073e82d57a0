"""The pass ``ambient_visibility``: how much of the light from everywhere reaches what is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.effects.ambient.edge_on import sees_edge_on
from torchrender.effects.ambient.horizon import horizon_ambient
from torchrender.effects.ambient.options import REACH_SHARE, AmbientOptions
from torchrender.effects.ambient.traced import traced_ambient
from torchrender.effects.ambient.visibility import AmbientVisibility
from torchrender.passes.contract import Amounts, Buffers, OwnMeasure, Pass, Prices
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, mean_over
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

AMBIENT_VISIBILITY = Buffer("ambient_visibility", AmbientVisibility)

LEAST_SIDE = 16
"""Rows and columns of a picture whose depth is searched."""

AT_HITS = 8
"""Rays where no eye looks first."""

EACH = 16
"""Rays at least where every pixel casts its own."""

TREE = 400_000
"""Triangles up to which a tree for rays, where nobody else asks for one, costs no more than it is worth."""


def applies(outlook: Outlook) -> Verdict:
    """There is light from everywhere, and something that could hide it."""
    scene = outlook.scene
    if outlook.options.ambient_visibility == "off":
        return Verdict(False, "ambient visibility is turned off")
    if not outlook.fact(_has_ambient_light):
        return Verdict(False, "no ambient light")
    if not scene.geometry.triangle_count:
        return Verdict(False, "the scene has no triangles")
    if scene.photo_light:
        return Verdict(False, "colours of photos hold the shadows of their light already")
    if all(scene.materials[mesh.material].unlit for mesh in scene.meshes if len(mesh.faces)):
        return Verdict(False, "every surface shows its colour as it is, whatever the light")
    kind = "ambient light" if scene.environment is None else f"light of the environment {scene.environment.name!r}"
    return Verdict(True, f"{kind} is hidden where surfaces stand close")


def has_ambient_light(scene: Scene) -> bool:
    """Light comes from everywhere."""
    return scene.environment is not None or bool((scene.ambient > 0).any())


def has_sky(scene: Scene) -> bool:
    """Light comes from beyond all that could hide it. Other light asks for no more than what is near."""
    return scene.environment is not None and not scene.environment.fill


def left_open(options: RenderOptions) -> bool:
    """Nobody says how."""
    return options.ambient_visibility == "auto"


def settle(outlook: Outlook, prices: Prices) -> RenderOptions:
    """For ``ambient_visibility="auto"`` rays, which are closer, but where a tree for them is missing and large."""
    del prices
    options = outlook.options
    if not left_open(options):
        return options
    ready = outlook.kept(RAY_CASTER) is not None or outlook.scene.geometry.triangle_count <= TREE
    return replace(options, ambient_visibility="traced" if ready else "horizon")


def by_rays(outlook: Outlook) -> Tensor:
    """Of which cameras (B,) rays are cast: they were asked for, no eye sees the samples first, or a picture's own depth
    tells little.

    In a row or a few pixels nothing stands beside what is seen, and rays cost next to nothing; a wall that an eye sees
    edge-on is in none of its depth images. Each camera is looked at alone: its picture is the same among others.
    """
    if outlook.options.ambient_visibility == "traced" or outlook.samples is not None:
        return torch.ones(max(len(outlook.cameras), 1), dtype=torch.bool)
    return ~outlook.fact(tells_enough)


def _has_ambient_light(scene: Scene, cameras: Cameras) -> bool:
    del cameras
    return has_ambient_light(scene)


def tells_enough(scene: Scene, cameras: Cameras) -> Tensor:
    """(B,) bool: the depth images of a camera's picture show about everything that hides light from what it shows."""
    if takes_each(cameras):
        return torch.zeros(len(cameras), dtype=torch.bool)
    return ~sees_edge_on(scene.geometry, cameras)


def is_small(cameras: Cameras) -> bool:
    """A picture of few pixels, or of few rows or columns."""
    return min(cameras.width, cameras.height) < LEAST_SIDE


def takes_each(cameras: Cameras) -> bool:
    """Pixels cast rays of their own: those of parallel views, which know no lattice, and of pictures with few."""
    return cameras.orthographic or is_small(cameras)


def asks(outlook: Outlook) -> Buffers:
    """Triangles ready for rays, where they are cast."""
    return (RAY_CASTER,) if bool(by_rays(outlook).any()) else ()


def run(frame: Frame) -> AmbientVisibility:
    """By rays where these were asked for or a picture's depth does not tell enough, else by depth around the eye."""
    gbuffer, scene = frame[GBUFFER], frame.scene
    caster = frame.get(RAY_CASTER) if AMBIENT_VISIBILITY in frame.askers(RAY_CASTER) else None
    if not isinstance(gbuffer, GBuffer):
        assert caster is not None
        return _by_rays(frame, gbuffer, caster)
    ways: list[tuple[Tensor, AmbientVisibility]] = []
    traced = torch.zeros(len(gbuffer.depth), dtype=torch.bool)
    if caster is not None:
        asked = frame.options.ambient_visibility == "traced"
        traced = torch.ones_like(traced) if asked else ~tells_enough(scene, gbuffer.cameras)
    for chosen, cast in ((traced, caster), (~traced, None)):
        rows = chosen.nonzero().reshape(-1)
        if len(rows) or (cast is None and not ways):
            seen = gbuffer if len(rows) == len(traced) else gbuffer.of_cameras(rows)
            ways.append((rows, _by_depth(frame, seen) if cast is None else _by_rays(frame, seen, cast)))
    if len(ways) == 1:
        return ways[0][1]
    order = torch.cat([rows for rows, _ in ways]).argsort()
    return AmbientVisibility(
        *(torch.cat([getattr(found, field.name) for _, found in ways])[order] for field in fields(AmbientVisibility))
    )


def _by_depth(frame: Frame, seen: GBuffer) -> AmbientVisibility:
    options, scene = frame.options.ambient, frame.scene
    return horizon_ambient(scene.geometry, seen, options, reach=reach_of(scene, options), far=has_sky(scene))


def _by_rays(frame: Frame, samples: GBuffer | RaySurface, caster: RayCaster) -> AmbientVisibility:
    options, scene = frame.options.ambient, frame.scene
    seen = isinstance(samples, GBuffer)
    each = isinstance(samples, GBuffer) and takes_each(samples.cameras)
    return traced_ambient(
        caster,
        samples,
        rays=max(options.rays, EACH) if each else options.rays,
        reach=reach_of(scene, options),
        share=options.share if seen else options.rays < AT_HITS,
        spacing=1 if each else options.ray_spacing,
        far=has_sky(scene),
    )


def reach_of(scene: Scene, options: AmbientOptions) -> float:
    """Scene units within which something hides near light."""
    return REACH_SHARE * scene.diagonal if options.reach is None else options.reach


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels; depths that are looked at; triangles drawn around the eye; rays, and triangles to sort for them."""
    pixels, options = outlook.pixels, outlook.options.ambient
    traced = float(by_rays(outlook).float().mean()) if len(outlook.cameras) else 0.0
    each = outlook.samples is None and takes_each(outlook.cameras)
    few = 1.0 if outlook.samples is not None or each else options.ray_spacing**2
    looks = (1.0 - traced) * pixels * options.slices * options.steps / options.spacing**2
    drawn = (1.0 - traced) * (1 if options.around else 0) * (2 if options.backs else 1)
    reaching = 2.0 if has_sky(outlook.scene) else 1.0  # far, and what is hit near as well
    rays = traced * reaching * (max(options.rays, EACH) if each else options.rays) * pixels / few
    return (1.0, pixels, looks, drawn * outlook.triangles, rays)


def over_samples(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """What no eye sees first: a few rays."""
    del history
    return replace(options, ambient=replace(options.ambient, rays=min(options.ambient.rays, AT_HITS)))


def _error(found: Mapping[str, Any], reference: Mapping[str, Any]) -> float:
    """Mean absolute error of near and of far visibility, over pixels with a surface; without any all is visible."""
    covered, wanted = reference["gbuffer"].covered, reference[AMBIENT_VISIBILITY.name]
    own = found.get(AMBIENT_VISIBILITY.name)
    pairs = ((wanted.near, None if own is None else own.near), (wanted.sky, None if own is None else own.sky))
    errors = [((1.0 if b is None else b) - a).abs()[covered].mean() for a, b in pairs]
    return float(torch.stack(errors).mean())


FEW = AmbientOptions(slices=2, steps=12, spacing=2, around=32)


def _found(subject: Subject) -> Outputs:
    scene, seen = subject.scene, subject.gbuffer
    reach = 0.25 * subject.unit
    if not bool(tells_enough(scene, subject.cameras).all()):
        made = traced_ambient(subject.caster, seen, rays=16, reach=reach)
    else:
        made = horizon_ambient(scene.geometry, seen, FEW, reach=reach)
    return {"sky": made.sky, "near": made.near, "length": made.bent_normal.norm(dim=-1)}


def _beside_rays(subject: Subject, outputs: Outputs) -> float:
    caster = RayCaster(subject.scene.geometry)
    exact = traced_ambient(caster, subject.gbuffer, rays=32, reach=0.25 * subject.unit)
    covered = subject.gbuffer.covered
    return max(mean_over((outputs[n] - getattr(exact, n)).abs(), covered) for n in ("sky", "near"))


HARD = HardEffect(
    name="ambient_visibility",
    about=VIEW,
    modules=("effects.ambient.horizon", "effects.ambient.traced", "effects.ambient.edge_on"),
    run=_found,
    bounds=lambda _: {"sky": (0.0, 1.0), "near": (0.0, 1.0), "length": (0.0, 1.0 + 1e-5)},
    law=Law(text="mean difference to the share of 32 rays that get away", deviation=_beside_rays, limit=0.25),
    skip=lambda subject: None if subject.scene.geometry.triangle_count else "no triangles",
    turns=False,  # slices are laid along the axes of the picture, and their pattern shows in single values
    rounding=0.1,  # a step of a search may find another pixel
    twins=0.1,
)


def _horizon(**changes: Any) -> dict[str, Any]:
    return {"ambient_visibility": "horizon"} | {f"ambient.{name}": value for name, value in changes.items()}


def _traced(rays: int, spacing: int) -> dict[str, Any]:
    return {"ambient_visibility": "traced", "ambient.rays": rays, "ambient.ray_spacing": spacing}


PASS = Pass(
    name="ambient_visibility",
    summary="finds how much of the light from everywhere reaches what is seen",
    makes=AMBIENT_VISIBILITY,
    needs=(GBUFFER,),
    asks=asks,
    applies=applies,
    run=run,
    settings=settings(
        "way, slices x steps",
        {
            "off": {"ambient_visibility": "off"},
            "1 x 12": _horizon(slices=1, steps=12, spacing=4, around=32, backs=False),
            "2 x 16": _horizon(slices=2, steps=16, spacing=3, around=64, backs=False),
            "8 rays, 4 x 4": _traced(8, 4),
            "16 rays, 3 x 3": _traced(16, 3),
            "64 rays": _traced(64, 1),
        },
        ("256 rays", _traced(256, 1)),
    ),
    amounts=amounts,
    coarsens=0.5,  # rendered pixels apart are searched from: with fewer these are farther apart in the picture
    patterns=("8 rays, 4 x 4", "16 rays, 3 x 3"),
    off="off",
    settle=settle,
    settles=left_open,
    by_settings=True,
    own=OwnMeasure(title="visibility error", buffer=AMBIENT_VISIBILITY, error=_error),
    over_samples=over_samples,
    over_hits=over_samples,
    hard=(HARD,),
)
