"""The pass ``mesh_curvature``: the shape descriptor of enhancement. Lasts while the triangles stand still."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from torchrender.effects.enhancement.curvature import MeshCurvature, mesh_curvature
from torchrender.passes.contract import Amounts, Pass, always
from torchrender.passes.hard import SHAPE, HardEffect, Law, Outputs, Subject
from torchrender.passes.outlook import Outlook
from torchrender.pipeline.buffer import Buffer, Lasting, triangles_of
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.options import RenderOptions


def _limit(options: RenderOptions) -> tuple[Any, ...]:
    wish = options.enhance
    return (None, False) if wish is None else (wish.limit, wish.centred)


MESH_CURVATURE = Buffer("mesh_curvature", MeshCurvature, lasting=Lasting(triangles_of, _limit))


def run(frame: Frame) -> MeshCurvature:
    """That of an earlier picture, else a new one."""
    wish = frame.options.enhance
    earlier, geometry = frame.earlier(MESH_CURVATURE), frame.scene.geometry
    if earlier is not None or wish is None:
        return earlier or mesh_curvature(geometry)
    return mesh_curvature(geometry, wish.limit, centred=wish.centred)


def amounts(outlook: Outlook) -> Amounts:
    """Once, and triangles, if that was not done before."""
    return (0.0, 0.0) if outlook.kept(MESH_CURVATURE) is not None else (1.0, outlook.triangles)


def _curvature(subject: Subject) -> Outputs:
    return {"relative": mesh_curvature(subject.scene.geometry).relative}


def _turned_inside_out(subject: Subject, outputs: Outputs) -> float:
    geometry = subject.scene.geometry
    if geometry.normals is None:
        return 0.0
    other = mesh_curvature(replace(geometry, normals=-geometry.normals)).relative
    return float((other + outputs["relative"]).abs().max())


HARD = HardEffect(
    name="mesh_curvature",
    about=SHAPE,
    modules=("effects.enhancement.curvature",),
    run=_curvature,
    bounds=lambda _: {"relative": (-math.inf, math.inf)},
    law=Law(text="normals to the other side turn the sign: largest sum", deviation=_turned_inside_out, limit=0.0),
)

PASS = Pass(
    name="mesh_curvature",
    summary="measures how vertices bend, once while they stand still",
    makes=MESH_CURVATURE,
    applies=always("curvature is asked for"),
    run=run,
    amounts=amounts,
    hard=(HARD,),
)
