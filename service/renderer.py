"""Jobs of the service carried out by the package: the inside of a renderer process."""

from __future__ import annotations

from typing import Any

import msgspec

from service.cameras import camera_of_view, header_of
from service.jobs import Describe, Forget, Job, Locate, MakeKeyframe
from service.scene_cache import SceneCache, describe
from service.stream_renderer import StreamRenderer
from torchrender.errors import CameraError


class Renderer:
    """Carries out one job after the other."""

    def __init__(self) -> None:
        self._scenes = SceneCache()
        self._streams = StreamRenderer()

    def run(self, job: Job) -> dict[str, Any]:
        """The result of a job as plain values.

        Raises:
            TorchRenderError: the job cannot be done; the message is fit for the client.
        """
        if isinstance(job, MakeKeyframe):
            return self._streams.make(self._scenes.get(job.scene), job)
        if isinstance(job, Describe):
            return describe(self._scenes.get(job.scene))
        if isinstance(job, Locate):
            return self._locate(job)
        if isinstance(job, Forget):
            return self._forget(job)
        raise NotImplementedError(type(job).__name__)

    def _locate(self, job: Locate) -> dict[str, Any]:
        camera = camera_of_view(self._scenes.get(job.scene), job.view)
        if camera.orthographic:
            raise CameraError("streams need a perspective camera")
        return {"camera": msgspec.to_builtins(header_of(camera))}

    def _forget(self, job: Forget) -> dict[str, Any]:
        if job.session is not None:
            self._streams.forget(job.session)
        if job.scene is not None:
            self._scenes.forget(job.scene)
        return {}
