"""Keyframes of streams inside a renderer, with what each session's pictures leave for the next one."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchrender.effects.upsampling.outlines import mean_of_places, smooth_outlines
from torchrender.errors import ExposureWarning
from torchrender.image import Image
from torchrender.passes.picture import resample
from torchrender.pipeline.history import Kept
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.wire.cameras import cameras_of
from torchrender_service.logs import heard
from torchrender_service.renderers.engine import render_image
from torchrender_service.renderers.jobs import BITS_STILL, Bounds, MakeKeyframe, MakeLayers, SmoothKeyframe
from torchrender_service.renderers.keeping.lasting import LastingParts
from torchrender_service.renderers.keeping.sizes import bytes_of
from torchrender_service.renderers.keyframes import Stamp, enough_bits, first_message, layer_message, mirror_message
from torchrender_service.renderers.streaming.beginnings import Beginnings
from torchrender_service.renderers.streaming.carrying import carried_picture, moved_aside, smooth_edges
from torchrender_service.renderers.streaming.glass import CARRYING_NEEDS, veiled
from torchrender_service.renderers.streaming.layers import (
    cameras_around,
    extra_layers,
    mirror_layer,
    typical_depth,
    worth_sending,
)
from torchrender_service.renderers.streaming.quick import as_bright, quickest
from torchrender_service.renderers.streaming.rest import framed, with_maps_at_hand
from torchrender_service.renderers.streaming.session import ASIDE, Begun, Made, Refinement, SessionState
from torchrender_service.renderers.streaming.wishes import in_words_of, picture_bounds
from torchrender_service.renderers.viewing.appearance import brightest, options_of, wish_of

MAX_SESSIONS = 256
MAX_BYTES = 2**31
"""Of what is kept, where nothing else is said."""
STREAM = "stream"
"""The use whose pace streams share."""
STREAMED = RenderOptions(upscaling="joint", fixed=(resample.PASS.name,))
"""The depth of all pixels is sent anyway, and colours must not stick to the wrong surface when the view moves."""
SELDOM = 8
"""Keyframes of a moving view between two looks at what a session keeps: one picture takes as much as the next."""
MAX_REFINED = 4
"""Refinements that are kept to be gone on with: each holds a whole picture."""


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
        self._beginnings = Beginnings()
        self.evictions = 0

    @property
    def bytes(self) -> int:
        """Of what is each session's own."""
        return sum(state.bytes for state in self._sessions.values()) + self._beginnings.bytes

    @torch.no_grad()
    def make(self, scene: Scene, job: MakeKeyframe, revision: int = 0) -> dict[str, Any]:
        """The message of layer 0 and what the server needs to place the next keyframe."""
        state = self._state(job)
        begin = time.perf_counter()
        scene_s = None if job.scene_s is None else scene.looped(job.scene_s)
        scene = state.as_wished(scene if scene_s is None else scene.at(scene_s), wish_of(job))
        camera = cameras_of(job.camera)
        bounds = picture_bounds(job, state.packing_ms)
        made = self._picture(scene, camera, state, job, bounds)
        doubts = heard(ExposureWarning)  # the exposure is part of the message
        made = replace(made, plan=in_words_of(job, made.plan) | ({"warnings": doubts} if doubts else {}))
        image, past = made.image, made.history
        render_ms = 1e3 * (time.perf_counter() - begin)
        depth = image.visibility.depth[0]
        typical = typical_depth(depth)
        around = cameras_around(camera, depth, job.extra_layers, direction=job.direction, baseline=job.baseline)
        mirrors = made.mirrors if job.mirrors and worth_sending(made.mirrors) else None
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
        begun = Begun(stamp, image, made.options, past, around, mirrors)
        light = image.radiance[0]
        self._refined.pop(job.session, None)
        if job.still:
            refined = Refinement(job, begun, scene, camera, bounds, brightest(stamp), made.plan, render_ms=render_ms)
            light = light.clamp(max=refined.brightest)
            refined.begin(made)
            self._refined[job.session] = refined
            while len(self._refined) > MAX_REFINED:
                self._refined.popitem(last=False)
            light = smooth_edges(image, light, ASIDE)
        else:
            light = _as_smooth(image, light.clamp(max=brightest(stamp)), preview=job.preview)
        messages = [first_message(stamp, camera, depth, light, render_ms=render_ms, plan=made.plan)]
        if mirrors is not None:
            messages.append(mirror_message(stamp, mirrors))
        state.begun = begun if around else None
        state.unweighed += 1
        if job.still or state.unweighed >= SELDOM or not state.bytes:
            self._weigh(job, state)
        if not job.preview:
            state.packing_ms = 1e3 * (time.perf_counter() - begin) - render_ms
        return {
            "messages": messages,
            "extra_layers": len(around),
            "typical_depth": typical,
        }

    @torch.no_grad()
    def make_layers(self, job: MakeLayers) -> dict[str, Any]:
        """The messages of the extra layers; none where the session has gone on meanwhile."""
        state = self._sessions.get(job.session)
        begun = None if state is None else state.begun
        if state is None or begun is None or begun.stamp.id != job.id:
            return {"messages": []}
        state.begun = None
        begin = time.perf_counter()
        image = begun.image
        scene = begun.past.given or image.scene
        layers = extra_layers(scene, image.visibility, begun.around, begun.options, begun.past)
        each_ms = 1e3 * (time.perf_counter() - begin) / len(layers)
        messages = [layer_message(begun.stamp, k + 1, layer, render_ms=each_ms) for k, layer in enumerate(layers)]
        return {"messages": messages}

    @torch.no_grad()
    def smooth(self, job: SmoothKeyframe) -> dict[str, Any]:
        """One more picture of a refinement, or all that take their light from the first, as far as they can; ``left``
        tells how many are missing, with the last comes the message.

        Nothing is left and no message comes where the session has gone on meanwhile.
        """
        state, refined = self._sessions.get(job.session), self._refined.get(job.session)
        if state is None or refined is None:
            return {"messages": [], "left": 0}
        begin = time.perf_counter()
        cameras, options = refined.next_cameras, options_of(STREAMED, refined.job.off)
        if refined.bounds.max_error is not None:
            options = refined.begun.options  # chosen for that
        base = refined.base
        lights = None if base is None else moved_aside(refined.scene, cameras, base, options, refined.begun.past)
        if lights is not None:
            for light in lights:
                refined.add(light)
        else:
            first = refined.light is None
            of = refined.scene, cameras[0], state, refined.job, refined.bounds
            made = self._at_rest(*of, keep=first, refined=refined)
            refined.take(made, whole=not veiled(refined.scene, refined.camera, options))
        begun = refined.begun
        refined.render_ms += 1e3 * (time.perf_counter() - begin)
        left = 1 + len(ASIDE) - refined.count
        if left:
            return {"messages": [], "left": left}
        assert refined.light is not None
        del self._refined[job.session]
        stamp = replace(begun.stamp, id=job.id, samples=refined.count)
        image, light = begun.image, refined.light / refined.count
        state.lit.improve(refined.scene, refined.job.off, image, light)
        self._beginnings.keep(refined.job.scene.id, state)
        depth = image.visibility.depth[0]
        messages = [first_message(stamp, refined.camera, depth, light, render_ms=refined.render_ms, plan=refined.plan)]
        if begun.mirrors is not None:
            messages.append(mirror_message(stamp, begun.mirrors))
        state.begun = replace(begun, stamp=stamp) if begun.around else None
        return {"messages": messages, "left": 0, "extra_layers": len(begun.around)}

    def forget(self, *, session: str | None = None, scene: str | None = None) -> None:
        """Drop what is kept for a session, or for new sessions of a scene."""
        if scene is not None:
            self._beginnings.forget(scene)
        if session is not None:
            self._sessions.pop(session, None)
            self._refined.pop(session, None)

    def clear(self) -> None:
        """Drop everything: all sessions start anew."""
        self.evictions += len(self._sessions)
        self._sessions.clear()
        self._refined.clear()
        self._beginnings.clear()

    def _weigh(self, job: MakeKeyframe, state: SessionState) -> None:
        """Note what a session has of its own, and make room."""
        state.unweighed = 0
        own: list[Any] = [kept.value for kept in state.history.kept.values() if not _is_shared(kept)]
        own += [state.lit.pictures, state.lit.quick, state.lit.gathered]
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
            state = self._beginnings.begin(job.scene.id, self._lasting.get(job.scene.id, STREAM).shared())
            self._sessions[job.session] = state
        self._sessions.move_to_end(job.session)
        while len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        return state

    def _picture(self, scene: Scene, camera: Cameras, state: SessionState, job: MakeKeyframe, bounds: Bounds) -> Made:
        """Layer 0, out of pictures at rest as far as these show it, and else anew."""
        options = options_of(STREAMED, job.off)
        lit = state.lit
        pictures = lit.of(scene, job.off) if job.still else lit.for_moving(scene, job.off)
        if job.bounds.max_error is None and not (job.still and job.bounds.budget_ms):
            past = replace(state.history.shared(), sequence=False) if job.still else state.history
            self._beginnings.lend(job.scene.id, lit)
            made = carried_picture(scene, camera, lit, pictures, past, options, budget_ms=bounds.budget_ms)
            if made is not None:
                state.history = replace(state.history.of_scene(scene), kept=made.history.kept)
                self._share_shaded(job.scene.id, state)
                return Made(made.image, made.plan, made.options, made.history, made.mirrors, carried=True)
        if job.still:
            return self._at_rest(scene, camera, state, job, bounds, keep=True)
        if job.preview:
            return self._preview(scene, camera, state, options)
        keeps = bounds.max_error is None and not veiled(scene, camera, options)
        options = replace(options, buffers=CARRYING_NEEDS) if job.mirrors or keeps else options
        options = options if bounds.max_error is not None else as_bright(options)
        image, plan = render_image(scene, camera, bounds, options, state.history)
        assert image.history is not None and image.plan is not None
        state.history = image.history
        self._lasting.put(job.scene.id, STREAM, image.history)
        mirrors = mirror_layer(image, camera) if job.mirrors or keeps else None
        if keeps and image.plan.options.supersample >= 1.0:
            lit.keep(scene, job.off, image, mirrors, quick=True)
            if job.scene.id not in self._beginnings:
                self._beginnings.keep(job.scene.id, state)
        return Made(image, plan, image.plan.options, image.history, mirrors)

    def _preview(self, scene: Scene, camera: Cameras, state: SessionState, options: RenderOptions) -> Made:
        """A picture without a search for settings; what it took teaches nothing about those with one."""
        image, plan = render_image(scene, camera, Bounds(), quickest(options), state.history)
        assert image.history is not None and image.plan is not None
        state.history = replace(image.history, pace=state.history.of_scene(scene).pace)
        return Made(image, plan, image.plan.options, image.history, None)

    def _share_shaded(self, scene: str, state: SessionState) -> None:
        """A few pixels, and what they were shaded with, serve other sessions at first."""
        self._lasting.put(scene, STREAM, replace(state.history, pace=self._lasting.get(scene, STREAM).pace))
        self._beginnings.keep_shaded(scene, state)

    def _at_rest(
        self,
        scene: Scene,
        camera: Cameras,
        state: SessionState,
        job: MakeKeyframe,
        bounds: Bounds,
        *,
        keep: bool,
        refined: Refinement | None = None,
    ) -> Made:
        """A picture of a view at rest: made anew, without reused reflections, and no part of the moving sequence.

        Args:
            keep: pictures of moving views may take its light.
            refined: that this is a picture of.
        """
        options = options_of(STREAMED, job.off)
        options = replace(options, buffers=CARRYING_NEEDS) if keep else options
        past = replace(state.history.shared(), sequence=False)
        if bounds == Bounds():
            options = with_maps_at_hand(scene, camera, options, past)
        image, plan = render_image(scene, camera, bounds, options, past)
        assert image.history is not None and image.plan is not None
        mirrors = mirror_layer(image, camera) if keep else None
        made = Made(image, plan, image.plan.options, image.history, mirrors)
        if refined is not None and refined.carried is not None and keep:
            made = framed(made, refined.carried, *refined.shown)
        if keep and made.options.supersample >= 1.0 and not veiled(scene, camera, options):
            state.lit.keep(scene, job.off, made.image, made.mirrors)
        state.history = replace(
            state.history.of_scene(scene), kept={**state.history.kept, **image.history.shared().kept}
        )
        return made


def _as_smooth(image: Image, light: Tensor, *, preview: bool) -> Tensor:
    """Light (H,W,3) of a moving view, about as smooth as a view at rest gets by several pictures."""
    if not preview:  # a small picture is spread over more pixels, which makes it smooth enough
        light = mean_of_places(image.visibility, light, ((0.0, 0.0), *ASIDE))
    return smooth_outlines(image.scene.geometry, image.visibility, light)


def _is_shared(kept: Kept) -> bool:
    return kept.buffer.lasting is not None and kept.buffer.lasting.shared
