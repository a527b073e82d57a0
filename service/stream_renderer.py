"""Keyframes of streams inside a renderer, with what each session's pictures leave for the next one."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any

from service.cameras import cameras_of
from service.engine import render_image
from service.jobs import BITS_STILL, Bounds, MakeKeyframe, MakeLayers
from service.keyframes import Stamp, enough_bits, first_message, layer_message
from service.layers import cameras_around, extra_layers, typical_depth
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
PACKING_SHARE = 0.5
"""Of the budget, at most, that is kept free for making messages."""
REFINE_MS = 150.0
"""Without a budget a refinement is supersampled where the one before it took less: nobody can interrupt it."""
STREAMED = RenderOptions(upscaling="joint", fixed=("resolve",))
"""The depth of all pixels is sent anyway, and colours must not stick to the wrong surface when the view moves."""
MAX_FINE_PIXELS = 2**23


@dataclass(frozen=True, eq=False)
class Begun:
    """A keyframe whose extra layers are still to be made."""

    stamp: Stamp
    image: Image
    past: RenderHistory
    around: list[Cameras]


@dataclass
class SessionState:
    """What the renderer remembers of a session."""

    history: RenderHistory
    packing_ms: float = 0.0  # from the last picture to its message
    still_ms: float = 0.0  # layer 0 of the last refinement that was not supersampled
    begun: Begun | None = None


class StreamRenderer:
    """Makes keyframes."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[str, SessionState] = OrderedDict()
        self._scenes: dict[str, RenderHistory] = {}  # what sessions of one scene share: maps, ray caster, pace

    def make(self, scene: Scene, job: MakeKeyframe) -> dict[str, Any]:
        """The message of layer 0 and what the server needs to place the next keyframe."""
        state = self._state(job)
        camera = cameras_of(job.camera)
        begin = time.perf_counter()
        image, plan, past = self._picture(scene, camera, state, job)
        render_ms = 1e3 * (time.perf_counter() - begin)
        depth = image.visibility.depth[0]
        typical = typical_depth(depth)
        around = cameras_around(camera, depth, job.layers, direction=job.direction, baseline=job.baseline)
        stamp = Stamp(
            id=job.id,
            layers=1 + len(around),
            pose=job.pose,
            time_ms=job.time_ms,
            still=job.still,
            bits=BITS_STILL if job.still else enough_bits(job.camera.fx, float(depth.min()), typical),
            color=job.color,
            quality=job.quality,
        )
        message = first_message(stamp, camera, depth, image.radiance[0], render_ms=render_ms, plan=plan)
        state.begun = Begun(stamp, image, past, around) if around else None
        state.packing_ms = 1e3 * (time.perf_counter() - begin) - render_ms
        return {
            "messages": [message],
            "layers": len(around),
            "typical_depth": typical,
        }

    def make_layers(self, job: MakeLayers) -> dict[str, Any]:
        """The messages of the extra layers; none where the session has gone on meanwhile."""
        state = self._sessions.get(job.session)
        begun = None if state is None else state.begun
        if state is None or begun is None or begun.stamp.id != job.id:
            return {"messages": []}
        state.begun = None
        begin = time.perf_counter()
        image = begun.image
        assert image.plan is not None
        layers = extra_layers(image.scene, image.visibility, begun.around, image.plan.options, begun.past)
        each_ms = 1e3 * (time.perf_counter() - begin) / len(layers)
        messages = [layer_message(begun.stamp, k + 1, layer, render_ms=each_ms) for k, layer in enumerate(layers)]
        return {"messages": messages}

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
        bounds = _bounds(job, state.packing_ms)
        if not job.still:
            image, plan = render_image(scene, camera, bounds, STREAMED, state.history)
            assert image.history is not None
            state.history = image.history
            self._scenes[job.scene.id] = replace(image.history, reuse=None, report=None)
            return image, plan, image.history
        free = bounds.budget_ms is None and bounds.max_error is None
        fine = free and self._affordable(state, job)
        options = replace(STREAMED, supersample=2.0 if fine else 1.0)
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


def _bounds(job: MakeKeyframe, packing_ms: float) -> Bounds:
    """What the picture of layer 0 may cost, which then takes ``packing_ms`` to become a message."""
    budget, error = job.bounds.budget_ms, job.bounds.max_error
    if budget is None and error is None and not job.still:
        budget = MOVING_BUDGET_MS
    if budget is not None:
        budget *= STILL_FACTOR if job.still else 1.0
        budget -= min(packing_ms, PACKING_SHARE * budget)
    return Bounds(budget_ms=budget, max_error=error)
