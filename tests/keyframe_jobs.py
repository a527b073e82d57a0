"""Jobs for keyframes, and how far these are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from torchrender.renderer import render
from torchrender.wire.cameras import header_of
from torchrender.wire.codec import display_bytes
from torchrender.wire.containers import KeyframeImage, read_container
from torchrender_service.renderers.jobs import Bounds, MakeKeyframe, SceneSource
from torchrender_service.renderers.streaming.stream_renderer import STREAMED

HUNDRED = Bounds(budget_ms=100.0)
STILL = {"still": True, "bounds": Bounds(), "color": "webp", "quality": 100}
LOSSLESS_COLOR = {"color": "webp", "quality": 100}


def job(scene, number: int = 0, **rest) -> MakeKeyframe:
    given = {
        "session": "one",
        "scene": SceneSource(id="cornell_box"),
        "id": number,
        "pose": number,
        "time_ms": 0.0,
        "camera": header_of(scene.camera(width=64, height=48)),
        "still": False,
        "extra_layers": 0,
        "direction": (0.0, 0.0, 0.0),
        "baseline": 0.0,
        "color": "jpeg",
        "quality": 85,
        "bounds": HUNDRED,
    }
    return MakeKeyframe(**given | rest)


def picture_of(data: bytes) -> KeyframeImage:
    return read_container(data, max_pixels=10**6, max_images=1)[0]


def aside(scene, right: float):
    """The camera of the jobs, moved along its own x axis by a share of the scene's size."""
    camera = scene.camera(width=64, height=48)
    matrix = camera.camera_from_world.clone()
    matrix[0, 0, 3] -= right * scene.diagonal
    return replace(camera, camera_from_world=matrix)


def error(data: bytes, scene, camera, options=STREAMED) -> float:
    """Mean difference of a keyframe's colours to those of a picture without bounds."""
    wanted = display_bytes(render(scene, camera, options=options).radiance[0]).astype(float)
    return float(np.abs(picture_of(data).codes.numpy() - wanted).mean())
