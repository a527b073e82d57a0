"""The pass ``ray_caster``: the scene's triangles, ready for rays. Lasts while they stand still."""

from __future__ import annotations

import math

from torchrender.passes.contract import Amounts, Pass, always
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, difference
from torchrender.passes.outlook import Outlook
from torchrender.pipeline.buffer import Buffer, Lasting, triangles_of
from torchrender.pipeline.frame import Frame
from torchrender.rays import RayCaster

RAY_CASTER = Buffer("ray_caster", RayCaster, lasting=Lasting(triangles_of))


def run(frame: Frame) -> RayCaster:
    """That of an earlier picture, brought up to date where triangles have moved, else a new one."""
    kept = frame.earlier(RAY_CASTER)
    if kept is not None:
        return kept
    before = frame.history.last(RAY_CASTER)
    moved = None if before is None else before.following(frame.scene.geometry)
    return RayCaster(frame.scene.geometry) if moved is None else moved


def amounts(outlook: Outlook) -> Amounts:
    """Once, and triangles to sort, if that was not done before."""
    return (0.0, 0.0) if outlook.kept(RAY_CASTER) is not None else (1.0, outlook.triangles)


def _first_hits(subject: Subject, backend: str = "auto") -> Outputs:
    caster = subject.caster if backend == "auto" else RayCaster(subject.scene.geometry, backend)
    origins, directions = (rays.reshape(-1, 3) for rays in subject.cameras.rays())
    hits = caster.first_hit(origins, directions)
    return {"length": hits.t / subject.unit, "triangle": hits.triangle, "barycentric": hits.barycentric}


HARD = HardEffect(
    name="ray_caster",
    about=VIEW,
    modules=("rays",),
    run=_first_hits,
    bounds=lambda _: {"length": (0.0, math.inf), "barycentric": (0.0, 1.0)},
    law=Law(
        text="two ray casters, Embree and the tree, agree: share of values where not",
        deviation=lambda s, found: difference(found, _first_hits(s, "bvh")),
        limit=0.0,
    ),
)

PASS = Pass(
    name="ray_caster",
    summary="sorts the triangles for rays, once while they stand still",
    makes=RAY_CASTER,
    applies=always("rays are cast"),
    run=run,
    amounts=amounts,
    hard=(HARD,),
)
