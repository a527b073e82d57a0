"""Reflections of a moving eye, out of those of a key frame; only what the key frame cannot tell is traced.

Warping an old picture by surface depth is wrong for mirrors, whose picture slides over the surface when the eye moves.
A key frame therefore keeps what every mirror pixel saw and how far away. For a new eye the same points are searched on
the mirrors, their colours move there, and the mirrors are then seen from the new view. Source: specification 04.

The scene must stand still between the pictures: whoever keeps the state drops it when anything changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer, ReflectionState
from torchrender.checks import options_of
from torchrender.clock import StepClock
from torchrender.effects.reflections.key_frame import (
    CAUSES,
    ReflectionKeyFrame,
    ReflectionMatches,
    make_key_frame,
    match_reflections,
)
from torchrender.effects.reflections.moved import FATES, shift_reflections, warp_to_view
from torchrender.effects.reflections.reflectors import ReflectivePixels, reflection_layer
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.errors import InputError

Trace = Callable[[ReflectivePixels], ReflectionLayer]
"""What some reflective pixels mirror, from any source that knows colour and distance."""


@dataclass(frozen=True, eq=False)
class ReuseState:
    """What one picture hands to the next."""

    key: ReflectionKeyFrame
    start: Tensor | None = None  # (N,2) int32 where the last picture's matches ended
    renew: bool = False  # the next picture is a key frame


@dataclass(frozen=True, kw_only=True)
class ReuseReport:
    """How the reflections of one picture were made."""

    key_frame: bool
    reflective: int  # pixels
    traced: int  # of these; all of a key frame
    next_key_frame: bool = False
    search_steps: float = 0.0  # mean over the key frame's pixels
    matches: Mapping[str, int] = field(default_factory=dict)  # key pixels by outcome of the search
    pixels: Mapping[str, int] = field(default_factory=dict)  # pixels of this picture by outcome of the look-up
    times_ms: Mapping[str, float] = field(default_factory=dict)

    @property
    def traced_share(self) -> float:
        """Of the reflective pixels; 0 where there are none."""
        return self.traced / self.reflective if self.reflective else 0.0


@dataclass(frozen=True, eq=False)
class ReusedReflections:
    """The reflections of B pictures, and what the next pictures need."""

    layer: ReflectionLayer
    state: ReuseState
    report: ReuseReport


def reuse_reflections(
    pixels: ReflectivePixels,
    gbuffer: GBuffer,
    trace: Trace,
    state: ReuseState | None = None,
    options: ReuseOptions | None = None,
    weight: Tensor | None = None,
) -> ReusedReflections:
    """What the reflective pixels mirror, from an earlier picture's state as far as it goes, by ``trace`` where not.

    Without a state, or with one that asks for it, the picture becomes a key frame: all its pixels are traced. If more
    than ``key_frame_threshold`` of the pixels of another picture are traced, the next one becomes a key frame.

    Args:
        pixels: all reflective pixels of the pictures in ``gbuffer``.
        state: of an earlier picture of the same still scene; another number of views starts anew.
        weight: (N,) share of what a pixel mirrors in its colour; None: one.

    Raises:
        InputError: orthographic cameras.
    """
    options = options_of(options, ReuseOptions)
    if gbuffer.cameras.orthographic:
        raise InputError("reflections are reused between perspective cameras only")
    if state is None or state.renew or len(state.key.cameras) != len(gbuffer.cameras):
        layer = trace(pixels)
        return ReusedReflections(layer, *begin_reuse(pixels, gbuffer, layer, options, weight))
    clock = StepClock()
    with clock.measure("match"):
        matches = match_reflections(state.key, gbuffer.cameras.eye, state.start, options)
    with clock.measure("shift"):
        moved = shift_reflections(state.key, matches, options)
    with clock.measure("warp"):
        warped = warp_to_view(state.key, moved, pixels, options, weight)
    with clock.measure("trace"):
        rest = (~warped.found).nonzero().reshape(-1)
        color, distance = warped.color.clone(), warped.distance.clone()
        origin = torch.full((len(pixels),), int(ReflectionState.REUSED))
        if len(rest):
            layer = trace(pixels.select(rest))
            place = pixels.pixel[rest]
            color[rest] = layer.color.reshape(-1, 3)[place]
            distance[rest] = layer.distance.reshape(-1)[place]
            origin[rest] = layer.state.reshape(-1)[place].long()
    with clock.measure("merge"):
        layer = reflection_layer(pixels, color, distance, origin)
    share = len(rest) / len(pixels) if len(pixels) else 0.0
    renew = share > options.key_frame_threshold
    report = ReuseReport(
        key_frame=False,
        reflective=len(pixels),
        traced=len(rest),
        next_key_frame=renew,
        search_steps=float(matches.steps.double().mean()) if len(matches.steps) else 0.0,
        matches=_counts(matches.cause, CAUSES),
        pixels=_counts(warped.state, FATES),
        times_ms=clock.elapsed_ms,
    )
    return ReusedReflections(layer, ReuseState(state.key, _start(state, matches), renew), report)


def begin_reuse(
    pixels: ReflectivePixels,
    gbuffer: GBuffer,
    layer: ReflectionLayer,
    options: ReuseOptions | None = None,
    weight: Tensor | None = None,
) -> tuple[ReuseState, ReuseReport]:
    """The state after a key frame, whose reflections ``layer`` are all known; other arguments and errors as above."""
    clock = StepClock()
    with clock.measure("key frame"):
        shares = None
        if weight is not None:
            shares = torch.zeros(gbuffer.depth.numel()).index_copy(0, pixels.pixel, weight.float())
            shares = shares.reshape(gbuffer.depth.shape)
        key = make_key_frame(gbuffer, layer, options_of(options, ReuseOptions), shares)
    report = ReuseReport(key_frame=True, reflective=len(pixels), traced=len(pixels), times_ms=clock.elapsed_ms)
    return ReuseState(key), report


def _start(state: ReuseState, matches: ReflectionMatches) -> Tensor:
    """Where the next walks begin: where these ended if that was a match, else where they began."""
    before = torch.zeros_like(matches.end) if state.start is None else state.start
    return torch.where(matches.valid[:, None], matches.end, before)


def _counts(values: Tensor, names: tuple[str, ...]) -> dict[str, int]:
    return dict(zip(names, torch.bincount(values.long(), minlength=len(names)).tolist(), strict=True))
