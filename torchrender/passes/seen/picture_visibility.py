"""The pass ``picture_visibility``: what every pixel of the picture sees, where fewer are rendered."""

from __future__ import annotations

import math

from torchrender.buffers import VisibilityBuffer
from torchrender.passes.contract import Amounts, Pass, always
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, difference
from torchrender.passes.outlook import Outlook
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.raster import rasterize_visibility

PICTURE_VISIBILITY = Buffer("picture_visibility", VisibilityBuffer)


def run(frame: Frame) -> VisibilityBuffer:
    """Depth and ids at the picture's size."""
    return rasterize_visibility(frame.scene.geometry, frame.cameras)


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels of the picture; triangles."""
    return (1.0, outlook.picture_pixels, outlook.triangles)


def _seen(subject: Subject) -> Outputs:
    seen = rasterize_visibility(subject.scene.geometry, subject.cameras)
    return {"depth": seen.depth / subject.unit, "triangle": seen.triangle, "barycentric": seen.barycentric}


def _as_gbuffer(subject: Subject, outputs: Outputs) -> float:
    whole = subject.gbuffer
    wanted = {"depth": whole.depth / subject.unit, "triangle": whole.triangle, "barycentric": whole.barycentric}
    return difference(outputs, wanted, 0.0)


HARD = HardEffect(
    name="picture_visibility",
    about=VIEW,
    modules=("raster",),
    run=_seen,
    bounds=lambda _: {"depth": (0.0, math.inf), "barycentric": (0.0, 1.0)},
    law=Law(
        text="a G-buffer of the same cameras sees the same: share of values where not",
        deviation=_as_gbuffer,
        limit=0.0,
    ),
)

PASS = Pass(
    name="picture_visibility",
    summary="draws depth and ids of all pixels, where fewer are rendered",
    makes=PICTURE_VISIBILITY,
    applies=always("guides the scaling"),
    run=run,
    amounts=amounts,
    hard=(HARD,),
)
