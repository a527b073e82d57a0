"""The pass ``composite``: blends whatever layers the picture has, in the order that they declare."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.effects.reflections.reflectors import blend_reflections
from torchrender.effects.reflections.traced import environment_reflections
from torchrender.passes.contract import Amounts, Pass, always
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, radiance_bounds
from torchrender.passes.light.direct_light import DIRECT_LIGHT
from torchrender.passes.outlook import Outlook
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.senses import difference, few
from torchrender.pipeline.buffer import Buffer, Order
from torchrender.pipeline.frame import Frame
from torchrender.shade import shade

COMPOSITE = Buffer("composite", Tensor)
"""Radiance (B,H,W,3) of the rendered pixels."""


def run(frame: Frame) -> Tensor:
    """All layers over each other."""
    gbuffer = frame[GBUFFER]
    radiance: Tensor | None = None
    for layer, value in frame.layers():
        under = torch.zeros(*gbuffer.covered.shape, 3) if radiance is None else radiance
        radiance = layer.blend(frame.scene, gbuffer, under, value)
    return torch.zeros(*gbuffer.covered.shape, 3) if radiance is None else radiance


def senses(frame: Frame) -> dict[str, float]:
    """How much of the picture is mirrored: what layers change of it, where one of them is reflections."""
    direct = frame.get(DIRECT_LIGHT)
    if direct is None or not any(layer.order == Order.REFLECTION for layer, _ in frame.layers()):
        return {}
    return {"reflections": difference(frame, few(frame[COMPOSITE]), few(direct))}


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels."""
    return (1.0, outlook.pixels)


def _blended(subject: Subject) -> Outputs:
    direct = shade(subject.scene, subject.gbuffer)
    layer = environment_reflections(subject.pixels, subject.shader)
    return {"radiance": blend_reflections(subject.scene, subject.gbuffer, direct, layer)}


def _others_untouched(subject: Subject, outputs: Outputs) -> float:
    error = (outputs["radiance"] - shade(subject.scene, subject.gbuffer)).abs().amax(dim=-1).reshape(-1)
    error[subject.pixels.pixel] = 0.0
    return float(error.max()) if error.numel() else 0.0


HARD = HardEffect(
    name="composite",
    about=VIEW,
    modules=("effects.reflections.reflectors",),
    run=_blended,
    bounds=radiance_bounds,
    law=Law(
        text="pixels that do not mirror stay as they are: largest difference", deviation=_others_untouched, limit=0.0
    ),
    turns=False,  # what no ray answers comes from a cube map along the axes
)

PASS = Pass(
    name="composite",
    summary="blends all layers",
    makes=COMPOSITE,
    needs=(GBUFFER,),
    blends=True,
    applies=always("layers are blended"),
    run=run,
    amounts=amounts,
    senses=senses,
    hard=(HARD,),
)
