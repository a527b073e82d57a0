"""Keyframes of streams inside a renderer, with what each session's pictures leave for the next one."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any

import torch

from service.cameras import cameras_of
from service.engine import render_image
from service.jobs import MakeKeyframe
from service.keyframes import Stamp, first_message, layer_message
from service.layers import cameras_around, extra_layers
from torchrender.history import RenderHistory
from torchrender.renderer import RenderOptions
from torchrender.scene.model import Scene

MAX_SESSIONS = 256
REFINE_MS = 250.0
"""A still picture is supersampled where it is expected to take no longer than four times this: nobody can interrupt it."""
_HISTORY_PIXELS = 2**23


@dataclass
class SessionState:
    """What the renderer remembers of a session."""

    history: RenderHistory
    render_ms: float = 0.0  # of the last moving picture


class StreamRenderer:
    """Makes keyframes."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[str, SessionState] = OrderedDict()

    def make(self, scene: Scene, job: MakeKeyframe) -> dict[str, Any]:
        """The messages of one keyframe and what the server needs to place the next one."""
        state = self._sessions.setdefault(job.session, SessionState(RenderHistory()))
        self._sessions.move_to_end(job.session)
        while len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        camera = cameras_of(job.camera)
        begin = time.perf_counter()
        options = self._options(state, job)
        # A refinement is made anew, without reused reflections, and leaves the moving sequence as it was.
        history = replace(state.history, reuse=None) if job.still else state.history
        image, plan = render_image(scene, camera, job.bounds, options, history)
        made = image.history or history
        if job.still:
            if state.history.given is None:
                state.history = replace(made, reuse=None)
        else:
            state.history = made
        first_ms = 1e3 * (time.perf_counter() - begin)
        if not job.still:
            state.render_ms = first_ms
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
        messages = [first_message(stamp, camera, depth, image.radiance[0], render_ms=first_ms, plan=plan)]
        begin = time.perf_counter()
        layers = extra_layers(scene, image.gbuffer, around, options, made)
        each_ms = 1e3 * (time.perf_counter() - begin) / max(1, len(layers))
        messages += [layer_message(stamp, k + 1, layer, render_ms=each_ms) for k, layer in enumerate(layers)]
        finite = depth[torch.isfinite(depth)]
        return {
            "messages": messages,
            "render_ms": first_ms + each_ms * len(layers),
            "typical_depth": float(finite.median()) if len(finite) else 0.0,
        }

    def forget(self, session: str) -> None:
        """Drop what is kept for a session."""
        self._sessions.pop(session, None)

    def _options(self, state: SessionState, job: MakeKeyframe) -> RenderOptions:
        fine = job.still and 0.0 < state.render_ms < REFINE_MS
        fine = fine and 4 * job.camera.width * job.camera.height <= _HISTORY_PIXELS
        return RenderOptions(supersample=2 if fine else 1)
