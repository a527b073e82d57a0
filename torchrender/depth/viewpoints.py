"""Where the cameras of a set of depth images stand."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from torchrender.checks import check_range
from torchrender.errors import OptionError
from torchrender.scene.camera import Cameras, look_at_matrix
from torchrender.scene.model import Scene

DEFAULT_SPREAD = 0.2


def viewpoints_around(scene: Scene, camera: Cameras, count: int, *, spread: float = DEFAULT_SPREAD) -> Cameras:
    """``count`` cameras like ``camera`` (a batch of one) around its eye, all looking at the scene's centre.

    The eyes are the corners of a regular polygon that faces the centre; ``spread`` is the side of the triangle with
    the same circumscribed circle, in bounding-box diagonals, so that three viewpoints form the equilateral triangle
    of non-redundant sampling with that side. One viewpoint stays at the eye. Where the eye is at the scene's centre
    the view direction is kept instead.

    Raises:
        OptionError: ``count`` < 1, ``spread`` negative, or ``camera`` not a single camera.
    """
    check_range("count", count, 1)
    check_range("spread", spread, 0.0)
    if len(camera) != 1:
        raise OptionError(f"camera must be a single camera, got a batch of {len(camera)}")
    eye, diagonal = camera.eye[0], scene.diagonal or 1.0
    target = scene.bounds.mean(dim=0)
    distance = float((target - eye).norm())
    if distance < 1e-3 * diagonal:
        target = eye + camera.forward[0] * diagonal
    centre = look_at_matrix(eye, target, -camera.rotation[0, 1])
    right, down = centre[0, :3], centre[1, :3]
    radius = 0.0 if count == 1 else spread * diagonal / math.sqrt(3.0)
    matrices = []
    for number in range(count):
        # The first corner is the upper one: image y points down.
        angle = 2.0 * math.pi * number / count - math.pi / 2
        position = eye + radius * (math.cos(angle) * right + math.sin(angle) * down)
        matrices.append(look_at_matrix(position, target, -down))
    near, far = (value.expand(count).contiguous() for value in (camera.near, camera.far))
    if not camera.orthographic:
        # The ring may come closer to the scene or reach farther than the camera that it was built from.
        near, far = torch.minimum(near, torch.tensor(1e-3 * diagonal)), torch.full_like(far, math.inf)
    return replace(
        camera,
        camera_from_world=torch.stack(matrices),
        intrinsics=camera.intrinsics.expand(count, 3, 3).contiguous(),
        near=near,
        far=far,
    )
