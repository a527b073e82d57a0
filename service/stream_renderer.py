"""Keyframes of streams inside a renderer, with what each session's pictures leave for the next one."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any

import torch

from service.cameras import cameras_of
from service.engine import render_image
from service.jobs import Bounds, MakeKeyframe
from service.keyframes import Stamp, first_message, layer_message
from service.layers import cameras_around, extra_layers
from service.upscale import surface_colors
from torchrender.history import RenderHistory
from torchrender.image import Image
from torchrender.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

MAX_SESSIONS = 256
MOVING_BUDGET_MS = 150.0
"""Time for a moving keyframe where the session asks for no other."""
STILL_FACTOR = 4.0
"""A refinement may take this many times the budget."""
REFINE_MS = 150.0
"""Without a budget a refinement is supersampled where the one before it took less: nobody can interrupt it."""
MAX_FINE_PIXELS = 2**23


@dataclass
class SessionState:
    """What the renderer remembers of a session."""

    history: RenderHistory
    layers_ms: float = 0.0  # extra layers of the last moving keyframe
    still_ms: float = 0.0  # layer 0 of the last refinement that was not supersampled


class StreamRenderer:
    """Makes keyframes."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[str, SessionState] = OrderedDict()
        self._scenes: dict[str, RenderHistory] = {}  # what sessions of one scene share: maps, ray caster, pace

    def make(self, scene: Scene, job: MakeKeyframe) -> dict[str, Any]:
        """The messages of one keyframe and what the server needs to place the next one."""
        state = self._state(job)
        camera = cameras_of(job.camera)
        begin = time.perf_counter()
        image, plan, past = self._picture(scene, camera, state, job)
        first_ms = 1e3 * (time.perf_counter() - begin)
        depth = image.gbuffer.depth[0]
        around = cameras_around(camera, depth, job.layers, direction=job.direction, baseline=job.baseline)
        stamp = Stamp(
            id=job.id,
            layers=1 + len(around),
            pose=job.pose,
            time_ms=job.time_ms,
            still=job.still,
            color=job.color,
            quality=job.quality,
        )
        colors = surface_colors(image)
        messages = [first_message(stamp, camera, depth, colors, render_ms=first_ms, plan=plan)]
        begin = time.perf_counter()
        assert image.plan is not None
        layers = extra_layers(image.scene, image.gbuffer, around, image.plan.options, past)
        layers_ms = 1e3 * (time.perf_counter() - begin)
        if not job.still:
            state.layers_ms = layers_ms
        each_ms = layers_ms / max(1, len(layers))
        messages += [layer_message(stamp, k + 1, layer, render_ms=each_ms) for k, layer in enumerate(layers)]
        finite = depth[torch.isfinite(depth)]
        return {
            "messages": messages,
            "render_ms": first_ms + layers_ms,
            "typical_depth": float(finite.median()) if len(finite) else 0.0,
        }

    def forget(self, *, session: str | None = None, scene: str | None = None) -> None:
        """Drop what is kept for a session or a scene."""
        if session is not None:
            self._sessions.pop(session, None)
        if scene is not None:
            self._scenes.pop(scene, None)

    def _state(self, job: MakeKeyframe) -> SessionState:
        state = self._sessions.get(job.session)
        if state is None:
            state = self._sessions[job.session] = SessionState(self._scenes.get(job.scene.id, RenderHistory()))
        self._sessions.move_to_end(job.session)
        while len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        return state

    def _picture(
        self, scene: Scene, camera: Cameras, state: SessionState, job: MakeKeyframe
    ) -> tuple[Image, dict[str, Any], RenderHistory]:
        """Layer 0, its plan, and what it left for the extra layers."""
        bounds, options = _bounds(state, job), None
        if not job.still:
            image, plan = render_image(scene, camera, bounds, options, state.history)
            assert image.history is not None
            state.history = image.history
            self._scenes[job.scene.id] = replace(image.history, reuse=None, report=None)
            return image, plan, image.history
        free = bounds.budget_ms is None and bounds.max_error is None
        fine = free and self._affordable(state, job)
        options = RenderOptions(supersample=2.0) if fine else None
        begin = time.perf_counter()
        # A refinement is made anew, without reused reflections, and leaves the moving sequence as it was.
        image, plan = render_image(scene, camera, bounds, options, replace(state.history, reuse=None, wanted=False))
        if free and not fine:
            state.still_ms = 1e3 * (time.perf_counter() - begin)
        assert image.history is not None
        return image, plan, image.history

    def _affordable(self, state: SessionState, job: MakeKeyframe) -> bool:
        pixels = 4 * job.camera.width * job.camera.height
        return 0.0 < state.still_ms < REFINE_MS and pixels <= MAX_FINE_PIXELS


def _bounds(state: SessionState, job: MakeKeyframe) -> Bounds:
    """What layer 0 may cost: the budget is for the whole keyframe, and a refinement gets more of it."""
    budget, error = job.bounds.budget_ms, job.bounds.max_error
    if job.still:
        return Bounds(budget_ms=None if budget is None else STILL_FACTOR * budget, max_error=error)
    if budget is None and error is None:
        budget = MOVING_BUDGET_MS
    if budget is not None:
        budget = max(budget - state.layers_ms, budget / 2)
    return Bounds(budget_ms=budget, max_error=error)
