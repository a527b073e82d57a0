"""The pass ``pane_shadow``: what see-through surfaces leave of each light."""

from __future__ import annotations

from dataclasses import replace

from torch import Tensor

from torchrender.effects.transparency.pane_shadow import pane_shadow, pane_shadows
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import LIGHTS, HardEffect, Law, Outputs, Subject, no_lights
from torchrender.passes.outlook import Outlook, Verdict, counted, no_shadows
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.rays import RayCaster
from torchrender.scene.model import Scene

PANE_SHADOW = Buffer("pane_shadow", Tensor)
"""Share (B,L,H,W) of each light that see-through surfaces let pass."""


def applies(outlook: Outlook) -> Verdict:
    """There are lights, and something that lets a part of them pass."""
    nothing = no_shadows(outlook)
    if nothing is not None:
        return nothing
    if outlook.scene.geometry.see_through is None:
        return Verdict(False, "nothing lets a part of the light pass")
    return Verdict(True, "partial light of " + counted(len(outlook.scene.lights), "light") + " behind panes")


def run(frame: Frame) -> Tensor:
    """Rays to each light."""
    scene = frame.scene
    return pane_shadows(scene, RayCaster(scene.geometry.panes), scene.lights, frame[GBUFFER])


def amounts(outlook: Outlook) -> Amounts:
    """Triangles to sort for rays; rays."""
    return (outlook.triangles, outlook.pixels * len(outlook.scene.lights))


def _paned(subject: Subject, opacity: float) -> tuple[Scene, RayCaster]:
    made = tuple(replace(m, blend=True, alpha_cutoff=None, opacity=opacity) for m in subject.scene.materials)
    scene = replace(subject.scene, materials=made)
    return scene, RayCaster(scene.geometry.panes)


def _shares(subject: Subject) -> Outputs:
    scene, panes = _paned(subject, 0.5)
    return {"share": pane_shadows(scene, panes, scene.lights, subject.gbuffer)}


def _clear(subject: Subject, outputs: Outputs) -> float:
    """Panes of no opacity cast no shadow."""
    del outputs
    scene, panes = _paned(subject, 0.0)
    return max(float((1.0 - pane_shadow(scene, panes, light, subject.gbuffer)).abs().max()) for light in scene.lights)


HARD = HardEffect(
    name="pane_shadow",
    about=LIGHTS,
    modules=("effects.transparency.pane_shadow",),
    run=_shares,
    bounds=lambda _: {"share": (0.0, 1.0)},
    law=Law(text="panes of no opacity take no light: largest difference", deviation=_clear, limit=1e-5),
    skip=no_lights,
)

PASS = Pass(
    name="pane_shadow",
    summary="finds what see-through surfaces leave of each light",
    makes=PANE_SHADOW,
    needs=(GBUFFER,),
    applies=applies,
    run=run,
    amounts=amounts,
    hard=(HARD,),
)
