"""Jobs of the service carried out by the package, inside a renderer process."""

from __future__ import annotations

from typing import Any

import msgspec

from torchrender.errors import CameraError
from torchrender.wire.cameras import header_of
from torchrender_service.renderers import jobs
from torchrender_service.renderers.engine import plan_image, tradeoff
from torchrender_service.renderers.photos.fog import FogPhotos
from torchrender_service.renderers.photos.style import style_photo
from torchrender_service.renderers.pictures import make_container, render_picture, reproject_picture
from torchrender_service.renderers.scene_cache import SceneCache, describe
from torchrender_service.renderers.stream_renderer import StreamRenderer
from torchrender_service.renderers.upload import validate
from torchrender_service.renderers.views import camera_of_view


class JobRunner:
    """Carries out one job after the other."""

    def __init__(self) -> None:
        self._scenes = SceneCache()
        self._streams = StreamRenderer()
        self._photos = FogPhotos()

    def run(self, job: jobs.Job) -> dict[str, Any]:
        """The result of a job as plain values.

        Raises:
            TorchRenderError: the job cannot be done; the message is fit for the client.
        """
        if isinstance(job, jobs.Forget):
            return self._forget(job)
        if isinstance(job, jobs.Validate):
            return validate(job)
        if isinstance(job, jobs.Reproject):
            return reproject_picture(job)
        if isinstance(job, jobs.Tradeoff):
            return tradeoff(job.name)
        if isinstance(job, jobs.MakeLayers):
            return self._streams.make_layers(job)
        if isinstance(job, jobs.PhotoJob):
            return self._photos.run(job)
        if isinstance(job, jobs.SmoothKeyframe):
            return self._streams.smooth(job)
        return self._run_in_scene(job)

    def _run_in_scene(self, job: jobs.SceneJob) -> dict[str, Any]:
        scene = self._scenes.get(job.scene)
        if isinstance(job, jobs.MakeKeyframe):
            return self._streams.make(scene, job)
        if isinstance(job, jobs.Render):
            return render_picture(scene, job)
        if isinstance(job, jobs.DepthImages):
            return make_container(scene, job)
        if isinstance(job, jobs.StylePhoto):
            return style_photo(scene, job)
        if isinstance(job, jobs.Plan):
            return plan_image(scene, camera_of_view(scene, job.view), job.bounds)
        if isinstance(job, jobs.Describe):
            return describe(scene)
        camera = camera_of_view(scene, job.view)
        if camera.orthographic:
            raise CameraError("streams need a perspective camera")
        return {"camera": msgspec.to_builtins(header_of(camera))}

    def _forget(self, job: jobs.Forget) -> dict[str, Any]:
        self._streams.forget(session=job.session, scene=job.scene)
        if job.scene is not None:
            self._scenes.forget(job.scene)
        return {}
