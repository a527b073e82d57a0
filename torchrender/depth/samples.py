"""What sampling finds before it becomes depth images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import Recycler
from torchrender.buffers import DepthImages, VisibilityBuffer
from torchrender.depth.options import SamplingOptions
from torchrender.raster import surface_attributes
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color

_memory = Recycler(1 << 27)
_FIELDS = ("depth", "triangle", "object_id", "barycentric")


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
        return cls(seen, _filled(shape, np.int32, 0), _filled(shape, np.bool_, False))

    @classmethod
    def room_for(cls, cameras: Cameras) -> Samples:
        """Images of which every pixel is still to be written, in place or by :meth:`put`."""
        shape = (len(cameras), cameras.height, cameras.width)
        kinds = ((shape, np.float32), (shape, np.int64), (shape, np.int64), ((*shape, 2), np.float32))
        images = (torch.from_numpy(_memory.empty(*kind)) for kind in kinds)
        return cls.first_hits(VisibilityBuffer(cameras, *images))

    def put(self, number: int, one: Samples) -> None:
        """Store the samples of camera ``number``."""
        for name in _FIELDS:
            getattr(self.seen, name)[number] = getattr(one.seen, name)[0]
        self.layer[number], self.truncated[number] = one.layer[0], one.truncated[0]


def _filled(shape: tuple[int, ...], kind: type, value: float) -> Tensor:
    array = _memory.empty(tuple(shape), kind)
    array.fill(value)
    return torch.from_numpy(array)


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


def some_views(images: VisibilityBuffer, chosen: slice) -> VisibilityBuffer:
    """The chosen images, sharing memory."""
    parts = {name: getattr(images, name)[chosen] for name in _FIELDS}
    return VisibilityBuffer(cameras=images.cameras[chosen], **parts)
