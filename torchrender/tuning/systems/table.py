"""The systems, in the order of the page."""

from __future__ import annotations

from torchrender.tuning.systems import depth_images, environment, points, voxels
from torchrender.tuning.systems.system import System

SYSTEMS: tuple[System, ...] = (
    environment.ENVIRONMENT,
    depth_images.SAMPLING,
    depth_images.RECONSTRUCTION,
    depth_images.REPROJECTION,
    voxels.VOXELS,
    points.POINTS,
)
