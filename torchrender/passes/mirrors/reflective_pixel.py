"""The pass ``reflective_pixel``: which rendered pixels mirror, and where to; and what all of mirrors share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch

from torchrender.arrays import view as numpy_view
from torchrender.effects.reflections.reflectors import ReflectivePixels, reflective_pixels
from torchrender.kernels.raster.project import visible_clusters
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, no_mirrors
from torchrender.passes.outlook import Outlook, Verdict, counted
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

REFLECTIVE_PIXEL = Buffer("reflective_pixel", ReflectivePixels)

REFLECTIVE_SHARE = "reflective_share"
"""Quantity: share of the rendered pixels that mirror."""


GLOSSY_SHARE = "glossy_share"
"""Quantity: share of the rendered pixels that mirror more than one direction."""


def reflectors_in_view(scene: Scene, cameras: Cameras) -> int:
    """Meshes that mirror whose bounding box meets the frustum of a camera."""
    if not len(scene.reflector_bounds):
        return 0
    bounds = numpy_view(scene.reflector_bounds, np.float64)
    seen: set[int] = set()
    for planes in cameras.frustum_planes():
        seen.update(visible_clusters(bounds, numpy_view(planes, np.float64))[0].tolist())
    return len(seen)


def applies(outlook: Outlook) -> Verdict:
    """Something mirrors."""
    if outlook.options.reflections == "off":
        return Verdict(False, "reflections are turned off")
    if not len(outlook.scene.reflector_bounds):
        return Verdict(False, "no material mirrors")
    if outlook.samples is not None:
        return Verdict(True, "some samples may mirror")
    in_view = outlook.fact(reflectors_in_view)
    if not in_view:
        return Verdict(False, "no reflector meets the view frustum")
    return Verdict(True, counted(in_view, "reflector") + " may be in view")


def mirrors(outlook: Outlook) -> Verdict:
    """Some pixel mirrors, or may."""
    verdict = applies(outlook)
    share = outlook.known.get(REFLECTIVE_SHARE)
    if not verdict.runs or share is None:
        return verdict
    if share == 0:
        return Verdict(False, "reflectors meet the view frustum, but no pixel shows one")
    return Verdict(True, f"{100 * share:.1f} % of the pixels mirror")


def reflective(outlook: Outlook) -> float:
    """Rendered pixels that mirror, in millions."""
    return outlook.share(REFLECTIVE_SHARE) * outlook.pixels


def glossy(outlook: Outlook) -> float:
    """Those that mirror more than one direction, as far as that is known."""
    return (outlook.share(GLOSSY_SHARE) if outlook.knows(GLOSSY_SHARE) else 0.0) * outlook.pixels


def run(frame: Frame) -> ReflectivePixels:
    """The reflective pixels of the G-buffer."""
    return reflective_pixels(frame.scene, frame[GBUFFER])


def found(frame: Frame) -> Mapping[str, float]:
    """The share that mirrors, and that of glossy ones."""
    pixels, count = frame[REFLECTIVE_PIXEL], max(frame[GBUFFER].material.numel(), 1)
    return {REFLECTIVE_SHARE: len(pixels) / count, GLOSSY_SHARE: int((pixels.gloss > 0).sum()) / count}


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels; those that mirror."""
    return (1.0, outlook.pixels, reflective(outlook))


def over_hits(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """What mirrors in a mirror is the hit shader's own business."""
    del history
    return replace(options, reflections="off")


def _directions(subject: Subject) -> Outputs:
    pixels = subject.pixels
    return {
        "length": pixels.direction.norm(dim=-1),
        "climb": (pixels.direction * pixels.geometric_normal).sum(-1),
        "depth": pixels.depth / subject.unit,
        "pixel": pixels.pixel,
    }


def _angles(subject: Subject, _: Outputs) -> float:
    pixels = subject.pixels
    arriving, leaving = (pixels.view * pixels.normal).sum(-1), (pixels.direction * pixels.normal).sum(-1)
    straight = (pixels.view - 2.0 * arriving[:, None] * pixels.normal) * pixels.geometric_normal
    bent = straight.sum(-1) < 0  # by a shading normal that would mirror into the surface
    return float(torch.where(bent, 0.0, (arriving + leaving).abs()).max()) if len(pixels) else 0.0


HARD = HardEffect(
    name="reflective_pixel",
    about=VIEW,
    modules=("effects.reflections.reflectors",),
    run=_directions,
    bounds=lambda _: {"length": (0.0, 1.0 + 1e-9), "climb": (-1e-9, 1.0 + 1e-9), "depth": (0.0, float("inf"))},
    law=Law(
        text="light leaves at the angle at which it arrives: largest difference of cosines",
        deviation=_angles,
        limit=1e-6,
    ),
    skip=no_mirrors,
)

PASS = Pass(
    name="reflective_pixel",
    summary="finds the pixels that mirror, and where to",
    makes=REFLECTIVE_PIXEL,
    needs=(GBUFFER,),
    applies=applies,
    run=run,
    amounts=amounts,
    checkpoint=found,
    over_hits=over_hits,
    hard=(HARD,),
)
