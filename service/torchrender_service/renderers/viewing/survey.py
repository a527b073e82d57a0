"""What a viewer needs to move about in a scene: how, between which cameras, and what is in the way."""

from __future__ import annotations

import base64
from typing import Any

import msgspec
import numpy as np
import torch

from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.voxels.surface import voxelize_surface
from torchrender.wire.cameras import header_of, is_skewed

CELLS = 96
"""Along the longest side of the scene."""
MAX_CAMERAS = 64
SIZE = (640, 360)
"""Pixels of the cameras as they are told."""
AROUND = 200
"""Directions that are looked into from the middle of a scene."""
ENCLOSED = 0.75
"""Share of them that must meet the front of a wall for the scene to be a room."""


def controls_of(scene: Scene, camera: Cameras) -> str:
    """How to move: "walk" where the camera stands in the scene, or before a room; "orbit" around anything else."""
    if camera.orthographic:
        return "orbit"
    low, high = scene.bounds
    eye = torch.tensor(header_of(camera).world_from_camera, dtype=torch.float64)[3:12:4]
    if bool(((eye > low) & (eye < high)).all()):
        return "walk"
    return "walk" if _enclosed(scene) else "orbit"


def _enclosed(scene: Scene) -> bool:
    """Whether most ways from the middle end at the front of a surface: walls of rooms face inwards."""
    if not scene.geometry.triangle_count:
        return False
    low, high = scene.bounds
    number = torch.arange(AROUND, dtype=torch.float64) + 0.5
    height, angle = 1 - 2 * number / AROUND, number * (torch.pi * (1 + 5**0.5))
    flat = (1 - height.square()).sqrt()
    ways = torch.stack([flat * angle.cos(), height, flat * angle.sin()], dim=-1)
    middle = (0.5 * (low + high)).expand_as(ways)
    hits = RayCaster(scene.geometry).first_hit(middle.float().contiguous(), ways.float().contiguous())
    met = hits.triangle >= 0
    facing = (scene.geometry.face_normals[hits.triangle.clamp(min=0)].double() * ways).sum(-1) < 0
    return float((met & facing).double().mean()) >= ENCLOSED


def survey(scene: Scene) -> dict[str, Any]:
    """Cameras by name, and the cells that surfaces meet, as bits.

    ``bits``: base64, x fastest, then y, then z, the first cell in the lowest bit.
    """
    made = voxelize_surface(scene.geometry, CELLS)
    filled = made.dense()[0].numpy()  # (nz,ny,nx)
    packed = np.packbits(filled.reshape(-1), bitorder="little")
    cameras = {}
    for name in list(scene.cameras)[:MAX_CAMERAS]:
        camera = scene.camera(name, width=SIZE[0], height=SIZE[1])
        if not camera.orthographic and not is_skewed(camera):
            cameras[name[:80]] = msgspec.to_builtins(header_of(camera))
    return {
        "cameras": cameras,
        "obstacles": {
            "origin": made.grid.origin[0].tolist(),
            "cell": float(made.grid.cell[0]),
            "dims": list(made.grid.dims),
            "bits": base64.b64encode(packed.tobytes()).decode(),
        },
    }
