"""Jobs of the service carried out by the package, inside a renderer process."""

from __future__ import annotations

import contextlib
import gc
import logging
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec

from torchrender.errors import CameraError
from torchrender.pipeline.doubts import looking_about
from torchrender.pipeline.history import RenderHistory
from torchrender.scene.model import Scene
from torchrender.wire.cameras import header_of
from torchrender_service.errors import out_of_memory
from torchrender_service.logs import heard, hearing
from torchrender_service.renderers import jobs
from torchrender_service.renderers.engine import plan_image, tradeoff
from torchrender_service.renderers.keeping.lasting import LastingParts
from torchrender_service.renderers.pictures import check_keyframes, make_container, render_picture, reproject_picture
from torchrender_service.renderers.scene_cache import SceneCache, describe, scene_at
from torchrender_service.renderers.streaming.ahead import FIRST_SIZE, first_keyframe, moved_aside, shared_parts
from torchrender_service.renderers.streaming.stream_renderer import STREAM, StreamRenderer
from torchrender_service.renderers.upload import validate
from torchrender_service.renderers.viewing.picking import find_pixel
from torchrender_service.renderers.viewing.survey import survey
from torchrender_service.renderers.views import camera_of_view, first_camera

if TYPE_CHECKING:
    from torchrender_service.renderers.photos.fog import FogPhotos

LOG = logging.getLogger("torchrender_service.renderers.job_runner")
FIRST_SCENE = "cornell_box"


SCENES_SHARE, LASTING_SHARE, SESSIONS_SHARE = 0.3, 0.15, 0.15
"""Of a renderer's memory: for scenes, for what their pictures share, and for what is each session's own. The rest is
for the picture that is made."""
USUAL_MB = 8192
"""What a renderer may take where nobody says."""


class JobRunner:
    """Carries out one job after the other.

    Args:
        limit_mb: memory that the process may take; 0: as much as usual.
        scenes: where they come from; None: files and built-in ones.
        textures_mb: of a scene of a file, with all levels; 0: all.
    """

    def __init__(self, limit_mb: int = 0, scenes: SceneCache | None = None, textures_mb: int = 0) -> None:
        room = (limit_mb or USUAL_MB) * 2**20
        self._texture_bytes = textures_mb * 2**20 or None
        self._scenes = scenes or SceneCache(int(SCENES_SHARE * room), self._texture_bytes)
        self._lasting = LastingParts(int(LASTING_SHARE * room))
        self._streams = StreamRenderer(self._lasting, int(SESSIONS_SHARE * room))
        self._photos: FogPhotos | None = None
        self._made_ahead: dict[str, RenderHistory] = {}
        self._dropped = 0  # scenes

    @property
    def kept_bytes(self) -> int:
        """Of everything that is kept for later."""
        return self._scenes.bytes + self._lasting.bytes + self._streams.bytes

    @property
    def evictions(self) -> int:
        """Scenes and histories that were dropped to make room."""
        return self._scenes.evictions + self._lasting.evictions + self._streams.evictions

    def ahead(self, source: jobs.SceneSource | None, *, parts: bool = False) -> Callable[[], None] | None:
        """What must be done before a job about a scene, and may be done beside others in another thread; None: nothing.

        Args:
            parts: pictures of it come next: also what these share is made.
        """
        if source is None or (self._scenes.has(source) and not (parts and source.id not in self._lasting)):
            return None
        scene = self._scenes.ahead(source)

        def work() -> None:
            with contextlib.suppress(Exception), hearing(source.id):  # said to whoever needs it
                loaded = scene()
                made = shared_parts(loaded, source) if parts else None
                if made is not None:
                    self._made_ahead[source.id] = made

        return work

    def _take_made_ahead(self) -> None:
        """What another thread made becomes what pictures here begin with."""
        for name in list(self._made_ahead):
            parts = self._made_ahead.pop(name)
            if name not in self._lasting:
                self._lasting.put(name, STREAM, replace(parts, pace=None))

    def run(self, job: jobs.Job) -> dict[str, Any]:
        """The result of a job as plain values. Where memory is not enough, it is tried once more without all that was
        kept for later.

        Raises:
            TorchRenderError: the job cannot be done; the message is fit for the client.
        """
        try:
            return self._run(job)
        except Exception as error:
            if not out_of_memory(error):
                raise
            LOG.warning("out of memory during %s: what was kept is dropped", type(job).__name__)
        self._streams.clear()
        self._lasting.clear()
        self._scenes.clear()
        self._made_ahead.clear()
        self._photos = None
        gc.collect()
        return self._run(job)

    def tidy(self, job: jobs.Job) -> None:
        """After a job was answered. A scene that was dropped is held by cycles, with all its textures, until somebody
        looks for these: what was there after the start, which is most, is not looked through."""
        if isinstance(job, jobs.WarmUp) and "still" in job.views:
            gc.collect()
            gc.freeze()
        elif isinstance(job, jobs.Validate) or self._scenes.dropped != self._dropped:
            self._dropped = self._scenes.dropped
            gc.collect()

    def _run(self, job: jobs.Job) -> dict[str, Any]:
        if isinstance(job, jobs.Forget):
            return self._forget(job)
        if isinstance(job, jobs.WarmUp):
            return self._warm_up(job)
        if isinstance(job, jobs.Validate):
            return validate(job, self._texture_bytes)
        if isinstance(job, jobs.Reproject):
            return reproject_picture(job)
        if isinstance(job, jobs.CheckKeyframes):
            return check_keyframes(job)
        if isinstance(job, jobs.Tradeoff):
            return tradeoff(job.name)
        if isinstance(job, jobs.MakeLayers):
            return self._streams.make_layers(job)
        if isinstance(job, jobs.PhotoJob):
            return self._run_on_photo(job)
        if isinstance(job, jobs.SmoothKeyframe):
            with looking_about():
                return self._streams.smooth(job)
        return self._run_in_scene(job)

    def _run_in_scene(self, job: jobs.SceneJob) -> dict[str, Any]:
        self._take_made_ahead()
        scene = self._scenes.get(job.scene)
        if isinstance(job, jobs.MakeKeyframe):
            with looking_about():
                return self._streams.make(scene, job, self._scenes.revision(job.scene))
        if isinstance(job, jobs.Render | jobs.DepthImages | jobs.Plan):
            return self._run_at_a_time(scene_at(scene, job.time), job)
        if isinstance(job, jobs.StylePhoto):
            from torchrender_service.renderers.photos.style import style_photo  # see _run_on_photo

            return style_photo(scene, job)
        if isinstance(job, jobs.Describe):
            return describe(scene)
        if isinstance(job, jobs.Survey):
            return survey(scene)
        if isinstance(job, jobs.FindPixel):
            return find_pixel(scene, job)
        camera = first_camera(scene, job.view)
        if camera.orthographic:
            raise CameraError("streams need a perspective camera")
        return {"camera": msgspec.to_builtins(header_of(camera))}

    def _run_at_a_time(self, scene: Scene, job: jobs.Render | jobs.DepthImages | jobs.Plan) -> dict[str, Any]:
        if isinstance(job, jobs.Plan):
            return plan_image(scene, camera_of_view(scene, job.view), job.bounds)
        if isinstance(job, jobs.Render):
            made = render_picture(scene, job, self._lasting)
        else:
            made = make_container(scene, job)
        return {**made, "warnings": heard()}

    def _run_on_photo(self, job: jobs.PhotoJob) -> dict[str, Any]:
        if self._photos is None:
            # Half a second to import: streams need not wait for it at the start, nor renderers without photos.
            from torchrender_service.renderers.photos.fog import FogPhotos

            self._photos = FogPhotos()
        return self._photos.run(job)

    def _forget(self, job: jobs.Forget) -> dict[str, Any]:
        self._streams.forget(session=job.session, scene=job.scene)
        if job.scene is not None:
            self._made_ahead.pop(job.scene, None)
            self._lasting.forget(job.scene)
            self._scenes.forget(job.scene)
        return {}

    def _warm_up(self, job: jobs.WarmUp) -> dict[str, Any]:
        """A first keyframe of each kind with everything about it, of a small scene."""
        scene = self._scenes.get(jobs.SceneSource(id=FIRST_SCENE))
        first = camera_of_view(scene, jobs.View(width=FIRST_SIZE[0], height=FIRST_SIZE[1]))
        source, session = jobs.SceneSource(id=FIRST_SCENE), "warm-up"
        try:
            for kind in job.views:
                camera = first if kind != "carried" else moved_aside(scene, first)
                keyframe = first_keyframe(session, source, header_of(camera), still=kind == "still")
                self._streams.make(scene, keyframe)
                self._streams.make_layers(jobs.MakeLayers(session=session, id=keyframe.id))
        finally:  # also where it is taken back
            self._streams.forget(session=session)
        return {}
