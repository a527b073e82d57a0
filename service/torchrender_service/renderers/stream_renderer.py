"""Keyframes of streams inside a renderer, with what each session's pictures leave for the next one."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Any

from torch import Tensor

from torchrender.image import Image
from torchrender.passes.picture import resample
from torchrender.pipeline.history import Kept, RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.wire.cameras import cameras_of
from torchrender_service.renderers.engine import render_image
from torchrender_service.renderers.jobs import BITS_STILL, Bounds, MakeKeyframe, MakeLayers, SmoothKeyframe
from torchrender_service.renderers.keeping.lasting import LastingParts
from torchrender_service.renderers.keeping.sizes import bytes_of
from torchrender_service.renderers.keyframes import Stamp, enough_bits, first_message, layer_message, mirror_message
from torchrender_service.renderers.layers import (
    MIRRORS_NEED,
    Layer,
    cameras_around,
    extra_layers,
    mirror_layer,
    typical_depth,
)
from torchrender_service.renderers.viewing.appearance import Exposure, Wish, as_wished, brightest, options_of, wish_of

MAX_SESSIONS = 256
MAX_BYTES = 2**31
"""Of what is kept, where nothing else is said."""
STREAM = "stream"
"""The use whose pace streams share."""
MOVING_BUDGET_MS = 150.0
"""Time for a moving keyframe where the session asks for no other."""
STILL_FACTOR = 4.0
"""A refinement may take this many times the budget."""
PACKING_SHARE = 0.5
"""Of the budget, at most, that is kept free for making messages."""
STREAMED = RenderOptions(upscaling="joint", fixed=(resample.PASS.name,))
"""The depth of all pixels is sent anyway, and colours must not stick to the wrong surface when the view moves."""
ASIDE = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
"""Pixels by which the further pictures of a refinement are moved: with the first, five places in every pixel."""
MAX_REFINED = 4
"""Refinements that are kept to be gone on with: each holds a whole picture."""


@dataclass(frozen=True, eq=False)
class Begun:
    """A keyframe whose extra layers are still to be made."""

    stamp: Stamp
    image: Image
    past: RenderHistory
    around: list[Cameras]
    mirrors: Layer | None = None


@dataclass(eq=False)
class Refinement:
    """A picture of a view at rest, and the light of all its pictures so far."""

    begun: Begun
    scene: Scene
    camera: Cameras
    bounds: Bounds
    options: RenderOptions
    brightest: float  # radiance that can be displayed at most
    render_ms: float
    light: Tensor | None = None  # (H,W,3) sum over the pictures
    count: int = 0

    def add(self, image: Image) -> None:
        """One more picture."""
        light = image.radiance[0].clamp(max=self.brightest)
        self.light = light if self.light is None else self.light + light
        self.count += 1


@dataclass
class SessionState:
    """What the renderer remembers of a session."""

    history: RenderHistory
    packing_ms: float = 0.0  # from the last picture to its message
    begun: Begun | None = None
    wished: tuple[Scene, Wish, Scene] | None = None  # a scene, what was wished for, and what it is then
    exposure: Exposure = field(default_factory=Exposure)
    bytes: int = 0  # of what is this session's own

    def as_wished(self, scene: Scene, wish: Wish) -> Scene:
        """The scene with the media and lights that the session wishes for: the same one while the wish is."""
        if self.wished is None or self.wished[0] is not scene or self.wished[1] != wish:
            self.wished = (scene, wish, as_wished(scene, wish))
        return self.wished[2]


class StreamRenderer:
    """Makes keyframes.

    Args:
        lasting: what pictures of one scene share: maps, ray caster, pace.
        max_bytes: of what is each session's own, all together; the session that was quiet longest starts anew first.
    """

    def __init__(self, lasting: LastingParts | None = None, max_bytes: int = MAX_BYTES) -> None:
        self._lasting = lasting or LastingParts(MAX_BYTES)
        self._max = max_bytes
        self._sessions: OrderedDict[str, SessionState] = OrderedDict()
        self._refined: OrderedDict[str, Refinement] = OrderedDict()
        self.evictions = 0

    @property
    def bytes(self) -> int:
        """Of what is each session's own."""
        return sum(state.bytes for state in self._sessions.values())

    def make(self, scene: Scene, job: MakeKeyframe, revision: int = 0) -> dict[str, Any]:
        """The message of layer 0 and what the server needs to place the next keyframe."""
        state = self._state(job)
        begin = time.perf_counter()
        scene_s = None if job.scene_s is None else scene.looped(job.scene_s)
        scene = state.as_wished(scene if scene_s is None else scene.at(scene_s), wish_of(job))
        camera = cameras_of(job.camera)
        bounds = _bounds(job, state.packing_ms)
        image, plan, past = self._picture(scene, camera, state, job, bounds)
        render_ms = 1e3 * (time.perf_counter() - begin)
        depth = image.visibility.depth[0]
        typical = typical_depth(depth)
        around = cameras_around(camera, depth, job.extra_layers, direction=job.direction, baseline=job.baseline)
        mirrors = mirror_layer(image, camera) if job.mirrors else None
        stamp = Stamp(
            id=job.id,
            layers=1 + len(around) + (mirrors is not None),
            pose=job.pose,
            time_ms=job.time_ms,
            still=job.still,
            bits=BITS_STILL if job.still else enough_bits(job.camera.fx, float(depth.min()), typical),
            color=job.color,
            quality=job.quality,
            scene_s=scene_s,
            revision=revision,
            settings=job.settings,
            exposure=state.exposure.of(image, job.exposure, still=job.still),
            tone_map=job.tone_map,
        )
        messages = [first_message(stamp, camera, depth, image.radiance[0], render_ms=render_ms, plan=plan)]
        if mirrors is not None:
            messages.append(mirror_message(stamp, mirrors))
        begun = Begun(stamp, image, past, around, mirrors)
        state.begun = begun if around else None
        self._refined.pop(job.session, None)
        if job.still:
            options = options_of(STREAMED, job.off)
            refined = Refinement(begun, scene, camera, bounds, options, brightest(stamp), render_ms=render_ms)
            refined.add(image)
            self._refined[job.session] = refined
            while len(self._refined) > MAX_REFINED:
                self._refined.popitem(last=False)
        self._weigh(job, state)
        state.packing_ms = 1e3 * (time.perf_counter() - begin) - render_ms
        return {
            "messages": messages,
            "extra_layers": len(around),
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
        scene = begun.past.given or image.scene
        layers = extra_layers(scene, image.visibility, begun.around, image.plan.options, begun.past)
        each_ms = 1e3 * (time.perf_counter() - begin) / len(layers)
        messages = [layer_message(begun.stamp, k + 1, layer, render_ms=each_ms) for k, layer in enumerate(layers)]
        return {"messages": messages}

    def smooth(self, job: SmoothKeyframe) -> dict[str, Any]:
        """One more picture of a refinement; ``left`` tells how many are missing, with the last comes the message.

        Nothing is left and no message comes where the session has gone on meanwhile. One picture at a time, so that
        a view that moves again waits for none but that one.
        """
        state, refined = self._sessions.get(job.session), self._refined.get(job.session)
        if state is None or refined is None:
            return {"messages": [], "left": 0}
        begin = time.perf_counter()
        camera, begun = refined.camera, refined.begun
        aside = camera.sub_camera(*ASIDE[refined.count - 1], camera.width, camera.height)
        image, plan = _at_rest(refined.scene, aside, refined.bounds, begun.past, refined.options)
        refined.add(image)
        assert refined.light is not None
        refined.render_ms += 1e3 * (time.perf_counter() - begin)
        left = 1 + len(ASIDE) - refined.count
        if left:
            return {"messages": [], "left": left}
        del self._refined[job.session]
        stamp = replace(begun.stamp, id=job.id, samples=refined.count)
        depth, light = begun.image.visibility.depth[0], refined.light / refined.count
        messages = [first_message(stamp, camera, depth, light, render_ms=refined.render_ms, plan=plan)]
        if begun.mirrors is not None:
            messages.append(mirror_message(stamp, begun.mirrors))
        state.begun = replace(begun, stamp=stamp) if begun.around else None
        return {"messages": messages, "left": 0, "extra_layers": len(begun.around)}

    def forget(self, *, session: str | None = None) -> None:
        """Drop what is kept for a session."""
        if session is not None:
            self._sessions.pop(session, None)
            self._refined.pop(session, None)

    def clear(self) -> None:
        """Drop everything: all sessions start anew."""
        self.evictions += len(self._sessions)
        self._sessions.clear()
        self._refined.clear()

    def _weigh(self, job: MakeKeyframe, state: SessionState) -> None:
        """Note what a session has of its own, and make room."""
        own = [kept.value for kept in state.history.kept.values() if not _is_shared(kept)]
        begun = None if state.begun is None else state.begun.image.buffers
        refined = self._refined.get(job.session)
        state.bytes = bytes_of(own, begun, None if refined is None else (refined.light, refined.begun.image.buffers))
        while self.bytes > self._max and len(self._sessions) > 1:
            name = next(iter(self._sessions))
            self.forget(session=name)
            self.evictions += 1

    def _state(self, job: MakeKeyframe) -> SessionState:
        state = self._sessions.get(job.session)
        if state is None:
            state = self._sessions[job.session] = SessionState(self._lasting.get(job.scene.id, STREAM).shared())
        self._sessions.move_to_end(job.session)
        while len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        return state

    def _picture(
        self, scene: Scene, camera: Cameras, state: SessionState, job: MakeKeyframe, bounds: Bounds
    ) -> tuple[Image, dict[str, Any], RenderHistory]:
        """Layer 0, its plan, and what it left for the extra layers."""
        options = options_of(STREAMED, job.off)
        options = replace(options, buffers=MIRRORS_NEED) if job.mirrors else options
        if not job.still:
            image, plan = render_image(scene, camera, bounds, options, state.history)
            assert image.history is not None
            state.history = image.history
            self._lasting.put(job.scene.id, STREAM, image.history)
            return image, plan, image.history
        image, plan = _at_rest(scene, camera, bounds, state.history, options)
        assert image.history is not None
        return image, plan, image.history


def _is_shared(kept: Kept) -> bool:
    return kept.buffer.lasting is not None and kept.buffer.lasting.shared


def _at_rest(
    scene: Scene, camera: Cameras, bounds: Bounds, past: RenderHistory, options: RenderOptions
) -> tuple[Image, dict[str, Any]]:
    """A picture of a refinement: made anew, without reused reflections, and no part of the moving sequence."""
    return render_image(scene, camera, bounds, options, replace(past.shared(), sequence=False))


def _bounds(job: MakeKeyframe, packing_ms: float) -> Bounds:
    """What the picture of layer 0 may cost, which then takes ``packing_ms`` to become a message."""
    budget, error = job.bounds.budget_ms, job.bounds.max_error
    if budget is None and error is None and not job.still:
        budget = MOVING_BUDGET_MS
    if budget is not None:
        budget *= STILL_FACTOR if job.still else 1.0
        budget -= min(packing_ms, PACKING_SHARE * budget)
    return Bounds(budget_ms=budget, max_error=error)
