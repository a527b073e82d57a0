"""Conventional depth images: the nearest surface in every pixel of every camera."""

from __future__ import annotations

from torchrender.depth.options import SamplingOptions
from torchrender.depth.samples import Samples
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry


def conventional(geometry: Geometry, cameras: Cameras, options: SamplingOptions) -> Samples:
    """First hits of all cameras."""
    return Samples.first_hits(rasterize_visibility(geometry, cameras, cull=options.cull))
