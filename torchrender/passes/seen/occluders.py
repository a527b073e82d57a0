"""The pass ``occluders``: the scene's triangles, sorted for sampled area lights. Lasts while they stand still."""

from __future__ import annotations

import torch

from torchrender.effects.shadows.soft_shadow import Occluders, SoftShadowOptions, occluders, soft_shadow
from torchrender.passes.contract import Amounts, Pass, always
from torchrender.passes.hard import LIGHTS, HardEffect, Law, Outputs, Subject
from torchrender.passes.outlook import Outlook
from torchrender.pipeline.buffer import Buffer, Lasting, triangles_of
from torchrender.pipeline.frame import Frame

OCCLUDERS = Buffer("occluders", Occluders, lasting=Lasting(triangles_of))


def run(frame: Frame) -> Occluders:
    """Those of an earlier picture, else new ones."""
    return frame.earlier(OCCLUDERS) or occluders(frame.scene.geometry)


def amounts(outlook: Outlook) -> Amounts:
    """Once, and triangles to sort, if that was not done before."""
    return (0.0, 0.0) if outlook.kept(OCCLUDERS) is not None else (1.0, outlook.triangles)


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
    applies=always("area lights are sampled"),
    run=run,
    amounts=amounts,
    hard=(HARD,),
)
