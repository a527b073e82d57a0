"""The pass ``key_frame``: keeps what mirrors of this picture show, for the next ones of a sequence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from torchrender.effects.reflections.reflectors import mirrored_share, reflected_rays
from torchrender.effects.reflections.reuse import ReuseReport, ReuseState, begin_reuse
from torchrender.effects.reflections.traced import trace_reflections
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, difference, no_mirrors
from torchrender.passes.mirrors.hit_shader import look_made_with
from torchrender.passes.mirrors.reflections import REFLECTIONS
from torchrender.passes.mirrors.reflective_pixel import REFLECTIVE_PIXEL, mirrors, reflective
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.buffer import Buffer, Lasting, look_of
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions


@dataclass(frozen=True, eq=False)
class KeptReflections:
    """What one picture's reflections leave for the next, and how they were made."""

    state: ReuseState
    report: ReuseReport


def _made_with(options: RenderOptions) -> tuple[Any, ...]:
    ways = (options.reflections, options.reflection, options.tracing, options.reuse, options.supersample)
    return (*look_made_with(options), *ways)


KEY_FRAME = Buffer("key_frame", KeptReflections, lasting=Lasting(look_of, _made_with, shared=False))


def reuse_report(history: RenderHistory | None) -> ReuseReport | None:
    """How the reflections of the last picture of a sequence were made; None if nothing mirrored."""
    kept = None if history is None else history.newest(KEY_FRAME)
    return None if kept is None else kept.report


def usable(outlook: Outlook) -> bool:
    """The history holds reflections that this picture can use again."""
    kept = outlook.kept(KEY_FRAME)
    return kept is not None and not kept.state.renew and len(kept.state.key.cameras) == len(outlook.cameras)


def reuses(outlook: Outlook) -> Verdict:
    """Pictures of a sequence may use reflections again."""
    verdict = mirrors(outlook)
    if not verdict.runs:
        return verdict
    if outlook.options.reuse is None:
        return Verdict(False, "reuse is turned off")
    if not outlook.history.sequence:
        return Verdict(False, "the picture is not part of a sequence: no history was given")
    if outlook.options.reflections == "environment":
        return Verdict(False, "one cube map costs less than reuse")
    if outlook.cameras.orthographic:
        return Verdict(False, "orthographic views have no moving eye")
    return verdict


def applies(outlook: Outlook) -> Verdict:
    """A sequence whose next pictures will need it."""
    verdict = reuses(outlook)
    if verdict.runs and outlook.history.moves:
        return Verdict(False, "something moves: the next picture could not use it")
    return Verdict(True, "the next pictures use it again") if verdict.runs else verdict


def run(frame: Frame) -> KeptReflections:
    """The key frame of the picture's own reflections."""
    gbuffer, pixels = frame[GBUFFER], frame[REFLECTIVE_PIXEL]
    share = mirrored_share(frame.scene, gbuffer, pixels)
    state, report = begin_reuse(pixels, gbuffer, frame[REFLECTIONS], frame.options.reuse, share)
    return KeptReflections(state, report)


def amounts(outlook: Outlook) -> Amounts:
    """Once; reflective pixels."""
    return (1.0, reflective(outlook))


def _kept(subject: Subject) -> Outputs:
    layer = trace_reflections(subject.caster, subject.pixels, subject.shader)
    key = begin_reuse(subject.pixels, subject.gbuffer, layer)[0].key
    near = key.reached[..., 3:] > 0
    length = torch.where(near, key.reached[..., :3] - key.surface[..., :3], 0.0).norm(dim=-1)
    return {"color": key.color, "length": length / subject.unit}


def _where_rays_hit(subject: Subject, outputs: Outputs) -> float:
    pixels = subject.pixels.select(subject.pixels.gloss <= 0)
    hits = reflected_rays(pixels).first_hits(subject.caster)
    wanted = torch.where(hits.hit, hits.t, 0.0).float() / subject.unit
    return difference({"length": outputs["length"].reshape(-1)[pixels.pixel]}, {"length": wanted}, 1e-3)


HARD = HardEffect(
    name="key_frame",
    parallel=False,
    about=VIEW,
    modules=("effects.reflections.key_frame",),
    run=_kept,
    bounds=lambda s: {"color": (0.0, s.radiance_limit), "length": (0.0, math.inf)},
    law=Law(
        text="kept points lie where mirrored rays hit: share of pixels whose distance differs",
        deviation=_where_rays_hit,
        limit=0.01,
    ),
    skip=no_mirrors,
    turns=False,  # what no ray answers comes from a cube map along the axes
    rounding=0.04,  # glossy hits share what they found within cells: values at their borders move
    twins=0.04,
)

PASS = Pass(
    name="key_frame",
    summary="keeps what mirrors show, for the next pictures of a sequence",
    makes=KEY_FRAME,
    needs=(GBUFFER, REFLECTIVE_PIXEL, REFLECTIONS),
    applies=applies,
    run=run,
    amounts=amounts,
    by_settings=True,
    for_next=True,
    hard=(HARD,),
)
