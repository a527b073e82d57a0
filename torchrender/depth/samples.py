"""What sampling finds before it becomes depth images."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import DepthImages, VisibilityBuffer
from torchrender.depth.options import SamplingOptions
from torchrender.raster import surface_attributes
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color


@dataclass(frozen=True, eq=False)
class Samples:
    """Depth, ids and barycentrics of B images, and how many surfaces lie before each sample."""

    seen: VisibilityBuffer
    layer: Tensor  # (B,H,W) int32
    truncated: Tensor  # (B,H,W) bool

    @classmethod
    def first_hits(cls, seen: VisibilityBuffer) -> Samples:
        """Samples before which nothing was skipped."""
        shape = seen.triangle.shape
        return cls(seen, torch.zeros(shape, dtype=torch.int32), torch.zeros(shape, dtype=torch.bool))


def depth_images(scene: Scene, samples: Samples, options: SamplingOptions) -> DepthImages:
    """The finished record, with positions, normals and, if asked for, colours."""
    seen = samples.seen
    surface = surface_attributes(scene, seen)
    color = diffuse_color(scene, surface) if options.shade else torch.zeros(*seen.triangle.shape, 3)
    return DepthImages(
        cameras=seen.cameras,
        depth=seen.depth,
        triangle=seen.triangle,
        object_id=seen.object_id,
        barycentric=seen.barycentric,
        position=surface.position,
        normal=surface.geometric_normal,
        color=color,
        layer=samples.layer,
        truncated=samples.truncated,
        parameters=options.parameters(),
    )


def stack(views: list[Samples], cameras: Cameras) -> Samples:
    """One set from samples of one camera each."""
    parts = {
        name: torch.cat([getattr(v.seen, name) for v in views])
        for name in ("depth", "triangle", "object_id", "barycentric")
    }
    return Samples(
        VisibilityBuffer(cameras=cameras, **parts),
        torch.cat([v.layer for v in views]),
        torch.cat([v.truncated for v in views]),
    )
