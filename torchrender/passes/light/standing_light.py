"""Visibility of lights over the pictures of a sequence in which the eye stands still and something in the scene moves.

Where a pixel shows the same place as before, and nothing that moved was or is on the way to a light, its share of that
light is what it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.shadows.view_cameras import same_views
from torchrender.passes.light.standing_maps import lit_by
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.buffer import Buffer, Lasting
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.standing import is_still, swept
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light
from torchrender.scene.mesh import Mesh


@dataclass(frozen=True, eq=False)
class StandingLight:
    """What a picture found, and of what."""

    meshes: tuple[Mesh, ...]
    cameras: Cameras
    depth: Tensor  # (B,H,W)
    triangle: Tensor  # (B,H,W)
    visibility: Mapping[int, Tensor]  # (B,H,W) by number of the light


def _made_with(options: RenderOptions) -> tuple[Any, ...]:
    ways = (options.point_shadows, options.area_shadows, options.soft_shadow)
    return (options.shadows, options.shadow, options.supersample, *ways)


def buffer_of(name: str) -> Buffer[StandingLight]:
    """The buffer in which a pass keeps what the next picture may use again."""
    return Buffer(f"standing_{name}", StandingLight, lasting=Lasting(lit_by, _made_with, shared=False))


def kept_light(frame: Frame, found: Mapping[int, Tensor]) -> StandingLight:
    """For the next picture."""
    seen, nothing = frame[GBUFFER], torch.zeros(0)
    if not isinstance(seen, GBuffer) or not frame.history.sequence:
        return StandingLight((), frame.cameras[[]], nothing, nothing, {})
    return StandingLight(frame.scene.meshes, seen.cameras, seen.depth, seen.triangle, found)


def same_light(
    frame: Frame, buffer: Buffer[StandingLight], lights: Mapping[int, Light]
) -> dict[int, tuple[Tensor, Tensor]]:
    """By number of those lights of which something can be used again: visibility (B,H,W), and where it holds."""
    kept, seen, scene = frame.earlier(buffer), frame[GBUFFER], frame.scene
    if kept is None or not isinstance(seen, GBuffer) or kept.depth.shape != seen.depth.shape:
        return {}
    known = {number: light for number, light in lights.items() if number in kept.visibility}
    if not known or not same_views(kept.cameras, seen.cameras):
        return {}
    moved = swept(kept.meshes, scene.meshes)
    if moved is None:
        return {}
    same = (kept.triangle == seen.triangle) & (kept.depth == seen.depth)
    same &= is_still(scene, seen.triangle.reshape(-1), moved.meshes).reshape(same.shape)
    clear = moved.misses(seen.position.reshape(-1, 3), list(known.values()), scene.diagonal)
    masks = clear.T.reshape(len(known), *same.shape) & same
    return {number: (kept.visibility[number], mask) for number, mask in zip(known, masks, strict=True)}
