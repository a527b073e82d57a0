"""What reprojection does to fog: keyframes seen from beside, beside pictures from there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import torch

from torchrender.buffers import DepthImages, VisibilityBuffer
from torchrender.image import Image
from torchrender.pipeline.options import RenderOptions
from torchrender.reconstruct.reproject import reproject
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene

SCENES = ("hall", "street_lamp")
STEPS = (0.05, 0.1, 0.2, 0.4)
"""Steps to the side, scene units: metres."""


def after_steps(width: int, scenes: Sequence[str] = SCENES) -> list[dict[str, Any]]:
    """Mean error, as a share of the mean, of keyframes after steps to the side; with media, and in clear air.

    Only pixels count that the keyframe knows: what it never saw is missing with and without media.
    """
    rows: list[dict[str, Any]] = []
    for name in scenes:
        scene = load(name)
        usual = next(iter(scene.cameras.values()))
        camera = usual.scaled(width / usual.width)
        rows += [
            {"scene": name, "step": step, "fog": fog, "clear": clear}
            for step, fog, clear in zip(
                STEPS, _errors(scene, camera, media=True), _errors(scene, camera, media=False), strict=True
            )
        ]
    return rows


def _errors(scene: Scene, camera: Cameras, *, media: bool) -> list[float]:
    options = RenderOptions(media=media)
    keyframe = _keyframe(render(scene, camera, options=options))
    found = []
    for step in STEPS:
        beside = _beside(camera, step)
        wanted = render(scene, beside, options=options).radiance
        drawn = reproject(keyframe, beside)
        off = (drawn.color - wanted).abs()[drawn.valid]
        found.append(float(off.mean() / wanted[drawn.valid].mean()))
    return found


def _beside(camera: Cameras, step: float) -> Cameras:
    """The same view from ``step`` further to the right."""
    matrix = camera.camera_from_world.clone()
    matrix[:, 0, 3] -= step
    return replace(camera, camera_from_world=matrix)


def _keyframe(image: Image) -> DepthImages:
    """What a stream sends of a picture: surfaces, and all light that arrives from their direction, fog's too."""
    seen = image.gbuffer
    kept = {field.name: getattr(seen, field.name) for field in fields(VisibilityBuffer)}
    return DepthImages(
        **kept,
        position=seen.position,
        normal=seen.geometric_normal,
        color=image.radiance,
        layer=torch.zeros(seen.depth.shape, dtype=torch.int32),
        truncated=torch.zeros(seen.depth.shape, dtype=torch.bool),
        parameters={},
    )
