"""The pass ``occluders``: what casts shadows of sampled area lights, sorted. Lasts while it stands still.

That is the whole scene, or what a few depth images from the corners of the lights show of it: fewer triangles to
search, at the price of drawing the images.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchrender.effects.shadows.light_reach import shines
from torchrender.effects.shadows.occluders import OccluderOptions, approximate_occluders
from torchrender.effects.shadows.soft_shadow import Occluders, SoftShadowOptions, occluders, soft_shadow
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import LIGHTS, HardEffect, Law, Outputs, Subject
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer, Lasting, lights_of
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.light import Light, RectLight


def _images(light: Light, bounds: Tensor) -> float:
    """Depth images of a light: one from each corner, or the six faces of a cube where a corner is inside the scene."""
    if not isinstance(light, RectLight):
        return 0.0
    inside = bool(((light.centre > bounds[0]) & (light.centre < bounds[1])).all())
    return 24.0 if inside else 4.0


IMAGE_SIDE = 1024
"""Pixels of a side of the depth images."""

KEPT = 0.05
"""Of a scene's triangles that images show: about this many per pixel at most."""


def _made_with(options: RenderOptions) -> tuple[Any, ...]:
    return (options.soft_shadow.occluders,)


OCCLUDERS = Buffer("occluders", Occluders, lasting=Lasting(lights_of, _made_with))

MESHES = {"images": "triangles", "rebuilt": "hybrid"}
"""Meshes of :class:`~torchrender.effects.shadows.occluders.OccluderOptions` by kind of occluders."""


def applies(outlook: Outlook) -> Verdict:
    """Lights with an area are sampled."""
    if outlook.options.area_shadows != "sampled" or not outlook.area_lights:
        return Verdict(False, "no area light is sampled")
    return Verdict(True, "area lights are sampled")


def run(frame: Frame) -> Occluders:
    """Those of an earlier picture, else new ones."""
    earlier = frame.earlier(OCCLUDERS)
    if earlier is not None:
        return earlier
    scene, how = frame.scene, frame.options.soft_shadow
    kind = how.occluders
    if kind == "scene":
        return occluders(scene.geometry).prepared(how)
    options = OccluderOptions(mesh=MESHES[kind], size=IMAGE_SIDE)
    lights = [light for light in scene.lights if isinstance(light, RectLight) and shines(light)]
    return occluders([approximate_occluders(scene, light, options) for light in lights]).prepared(how)


def amounts(outlook: Outlook) -> Amounts:
    """Once; triangles to sort; triangles to draw into images, and these: nothing if that was done before."""
    if outlook.kept(OCCLUDERS) is not None:
        return (0.0, 0.0, 0.0, 0.0)
    if outlook.options.soft_shadow.occluders == "scene":
        return (1.0, outlook.triangles, 0.0, 0.0)
    images = sum(_images(light, outlook.scene.bounds) for light in outlook.scene.lights)
    pixels = images * IMAGE_SIDE**2 * 1e-6
    kept = min(outlook.triangles, KEPT * pixels) if outlook.options.soft_shadow.occluders == "images" else 2 * pixels
    return (1.0, kept, images * outlook.triangles, pixels)


FEW = SoftShadowOptions(light_samples=2)


def _visibility(subject: Subject) -> Outputs:
    sorted_ = occluders(subject.scene.geometry)
    found = soft_shadow(sorted_, subject.area_lights, subject.gbuffer, FEW, bounds=subject.scene.bounds)
    return {"visibility": found.visibility}


def _sorted_or_not(subject: Subject, outputs: Outputs) -> float:
    alone = soft_shadow(subject.scene.geometry, subject.area_lights, subject.gbuffer, FEW)
    return float((alone.visibility - outputs["visibility"]).abs().max()) if outputs["visibility"].numel() else 0.0


HARD = HardEffect(
    name="occluders",
    about=LIGHTS,
    modules=("effects.shadows.soft_shadow",),
    run=_visibility,
    bounds=lambda _: {"visibility": (0.0, 1.0)},
    law=Law(
        text="triangles sorted once serve as triangles sorted for the call do: largest difference",
        deviation=_sorted_or_not,
        limit=float(torch.finfo(torch.float32).eps),
    ),
    skip=lambda subject: None if subject.area_lights else "no area light",
    turns=False,
)

PASS = Pass(
    name="occluders",
    summary="sorts the triangles for sampled area lights, once while they stand still",
    makes=OCCLUDERS,
    applies=applies,
    by_settings=True,
    run=run,
    settings=settings(
        "what casts shadows",
        {kind: {"soft_shadow.occluders": kind} for kind in ("rebuilt", "images", "scene")},
        context={"area_shadows": "sampled", "soft_shadow.light_samples": 16},
    ),
    amounts=amounts,
    one_cost=True,
    hard=(HARD,),
)
