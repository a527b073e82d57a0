"""Non-redundant depth images: each keeps only what earlier ones do not have (specification 01, section 5)."""

from __future__ import annotations

from dataclasses import replace

import torch

from torchrender.buffers import VisibilityBuffer
from torchrender.depth.options import SamplingOptions
from torchrender.depth.samples import Samples, stack
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def pixel_nonredundant(
    scene: Scene, cameras: Cameras, images: VisibilityBuffer | None, options: SamplingOptions
) -> Samples:
    """The nearest non-redundant surface in every pixel, by pixel redundancy.

    Args:
        images: what image i is compared with: its first i images; None: the images found here.
    """
    views: list[Samples] = []
    for number in range(len(cameras)):
        known = images if images is not None or not views else stack(views, cameras[:number]).seen
        tests = None
        if number:
            assert known is not None
            tests = FragmentTests(earlier=first_views(known, number))
        seen = rasterize_visibility(scene.geometry, cameras[number], cull=options.cull, tests=tests)
        views.append(Samples.first_hits(seen))
    return stack(views, cameras)


def first_views(images: VisibilityBuffer, count: int) -> VisibilityBuffer:
    """The first ``count`` images."""
    return VisibilityBuffer(
        cameras=images.cameras[:count],
        depth=images.depth[:count],
        triangle=images.triangle[:count],
        object_id=images.object_id[:count],
        barycentric=images.barycentric[:count],
    )
