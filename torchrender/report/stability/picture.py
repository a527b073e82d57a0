"""The record of the stability suite that is about no single pass: the whole picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.passes.hard import SMALL_SHADOW, HardEffect, Law, Outputs, Subject, displayed
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.report.stability.cases import Case

FEW = ClusterOptions(bin_factor=0.25)


def _picture(subject: Subject) -> Outputs:
    options = RenderOptions(shadow=SMALL_SHADOW, reflection=FEW)
    return {"radiance": render(subject.scene, subject.cameras, options=options).radiance}


def _alone(subject: Subject, outputs: Outputs) -> float:
    alone = _picture(subject.with_cameras(subject.cameras[0]))["radiance"]
    return float((displayed(alone) - displayed(outputs["radiance"][:1])).abs().mean())


def _limit(subject: Subject) -> Mapping[str, tuple[float, float]]:
    assert isinstance(subject, Case)
    return {"radiance": (0.0, replace(subject, scene=subject.scene.with_default_light()).radiance_limit)}


PICTURE = HardEffect(
    name="picture",
    modules=("renderer",),
    run=_picture,
    bounds=_limit,
    law=Law(
        text="the first picture alone is that of the two together: mean difference of display values",
        deviation=_alone,
        limit=0.01,
    ),
    turns=False,
    twins=0.04,  # of scenes whose every coordinate rounds otherwise
    rounding=0.04,  # glossy hits share what they found within cells: values at their borders move
)
