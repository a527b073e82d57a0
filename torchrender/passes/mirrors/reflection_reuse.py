"""The pass ``reflection_reuse``: what mirrors of a sequence show, out of those of a key frame."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer
from torchrender.effects.reflections.reflectors import ReflectivePixels, mirrored_share, reflective_pixels
from torchrender.effects.reflections.reuse import ReuseState, reuse_reflections
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.effects.reflections.traced import trace_reflections
from torchrender.passes.contract import Amounts, Buffers, Pass
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, no_mirrors
from torchrender.passes.light.direct_light import MIRROR_SHARE, with_share
from torchrender.passes.mirrors.air import before_mirrors, shadows_in_air
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.mirrors.key_frame import KEY_FRAME, KeptReflections, reuses, usable
from torchrender.passes.mirrors.onward import mirror_shader, onward_of
from torchrender.passes.mirrors.reflections import OWN, REFLECTIONS, mean_color_error
from torchrender.passes.mirrors.reflective_pixel import REFLECTIVE_PIXEL, reflective
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.passes.settings import settings
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions


def applies(outlook: Outlook) -> Verdict:
    """There is something to use again."""
    verdict = reuses(outlook)
    if not verdict.runs:
        return verdict
    if not usable(outlook):
        return Verdict(False, "nothing to use again: this picture is a key frame")
    return Verdict(True, "a sequence: what was mirrored is used again, the rest traced")


def run(frame: Frame) -> tuple[ReflectionLayer, KeptReflections]:
    """Out of the history, as far as it goes; the scattered rest by rays."""
    pixels, gbuffer, options, shader = frame[REFLECTIVE_PIXEL], frame[GBUFFER], frame.options, mirror_shader(frame)
    onward = onward_of(frame, shader)

    def trace(chosen: ReflectivePixels) -> ReflectionLayer:
        return trace_reflections(frame[RAY_CASTER], chosen, shader, options.tracing, onward=onward)

    kept = frame.earlier(KEY_FRAME)
    share = mirrored_share(frame.scene, gbuffer, pixels)
    made = reuse_reflections(pixels, gbuffer, trace, None if kept is None else kept.state, options.reuse, share)
    return made.layer, KeptReflections(made.state, made.report)


def asks(outlook: Outlook) -> Buffers:
    """Where lights reach the media, as mirrors in mirrors show them."""
    return shadows_in_air(outlook) if before_mirrors(outlook.scene, outlook.options) else ()


def amounts(outlook: Outlook) -> Amounts:
    """Once; reflective pixels."""
    return (1.0, reflective(outlook))


def alone(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Other samples are part of no sequence."""
    del history
    return replace(options, reuse=None)


def _next_frame(subject: Subject) -> Subject:
    """The cameras moved a little, across the view."""
    matrix = subject.cameras.camera_from_world.clone()
    matrix[:, 0, 3] -= 0.02 * subject.scene.diagonal
    return subject.with_cameras(replace(subject.cameras, camera_from_world=matrix))


def _frame(subject: Subject, seen: GBuffer, state: ReuseState | None) -> tuple[Tensor, ReuseState]:
    pixels = reflective_pixels(subject.scene, seen)
    made = reuse_reflections(pixels, seen, lambda p: trace_reflections(subject.caster, p, subject.shader), state)
    return made.layer.color, made.state


def _reused(subject: Subject) -> Outputs:
    found: dict[str, torch.Tensor] = {}
    state = None
    frames = {"key": subject.gbuffer, "still": subject.gbuffer, "moved": _next_frame(subject).gbuffer}
    for name, seen in frames.items():
        found[name], state = _frame(subject, seen, state)
    return found


HARD = HardEffect(
    name="reflection_reuse",
    parallel=False,
    about=VIEW,
    modules=("effects.reflections.reuse",),
    run=_reused,
    bounds=lambda s: dict.fromkeys(("key", "still", "moved"), (0.0, s.radiance_limit)),
    law=Law(
        text="the second frame of a camera that stands still is the first: mean difference of display values",
        deviation=lambda s, found: mean_color_error(found["still"], found["key"], s),
        limit=0.02,
    ),
    skip=no_mirrors,
    turns=False,  # what no ray answers comes from a cube map along the axes
    rounding=0.04,  # glossy hits share what they found within cells: values at their borders move
    twins=0.04,
)

PASS = Pass(
    name="reflection_reuse",
    summary="mirrors of a sequence out of those of a key frame",
    makes=REFLECTIONS,
    also=(KEY_FRAME,),
    needs=(GBUFFER, REFLECTIVE_PIXEL, HIT_SHADER, RAY_CASTER, MIRROR_SHARE),
    asks=asks,
    applies=applies,
    run=with_share(run),
    settings=settings(
        "what is good enough",
        {
            "loose": {"reuse": ReuseOptions(contrast=0.3, ratio=0.9, key_frame_threshold=0.5)},
            "usual": {"reuse": ReuseOptions()},
            "off": {"reuse": None},
        },
    ),
    amounts=amounts,
    by_settings=True,
    own=OWN,
    off="off",
    measured_with={"reflections": "traced"},
    continues=KEY_FRAME,
    over_samples=alone,
    over_hits=alone,
    hard=(HARD,),
)
