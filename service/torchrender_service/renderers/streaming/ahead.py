"""What the first picture of a scene makes for all others, made before there is one: trees, shadow maps, hit shaders."""

from __future__ import annotations

from dataclasses import replace

from torchrender.pipeline.doubts import looking_about
from torchrender.pipeline.history import RenderHistory
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.wire.cameras import header_of
from torchrender.wire.messages import CameraHeader
from torchrender_service.renderers.jobs import LOSSLESS, QUALITY_MOVING, Bounds, MakeKeyframe, SceneSource, View
from torchrender_service.renderers.keeping.lasting import LastingParts
from torchrender_service.renderers.streaming.stream_renderer import STREAM, StreamRenderer
from torchrender_service.renderers.views import camera_of_view

FIRST_SIZE = (64, 36)
"""Of a first picture: what it makes for others takes as long as for a large one."""
ASIDE = 0.04
"""Of the scene's diagonal, from a first view to one that moves: most of it is known, the rest is shaded."""
_ALL = 2**62


def shared_parts(scene: Scene, source: SceneSource) -> RenderHistory | None:
    """What streams of a scene share, by a small keyframe of its first view; None where it has no streams."""
    camera = camera_of_view(scene, View(width=FIRST_SIZE[0], height=FIRST_SIZE[1]))
    if camera.orthographic:
        return None
    lasting = LastingParts(_ALL)
    with looking_about():
        StreamRenderer(lasting, _ALL).make(scene, first_keyframe("ahead", source, header_of(camera)))
    return lasting.get(source.id, STREAM)


def moved_aside(scene: Scene, camera: Cameras) -> Cameras:
    """The camera a step to its right."""
    matrix = camera.camera_from_world.clone()
    matrix[0, 0, 3] -= ASIDE * scene.diagonal
    return replace(camera, camera_from_world=matrix)


def first_keyframe(session: str, source: SceneSource, camera: CameraHeader, *, still: bool = False) -> MakeKeyframe:
    """A keyframe as a client without wishes gets it first."""
    return MakeKeyframe(
        session=session, scene=source, id=int(still), pose=0, time_ms=0.0, camera=camera, still=still,
        extra_layers=1, direction=(0.0, 0.0, 0.0), baseline=0.0, color="webp" if still else "jpeg",
        quality=LOSSLESS if still else QUALITY_MOVING, bounds=Bounds(), mirrors=True,
    )  # fmt: skip
