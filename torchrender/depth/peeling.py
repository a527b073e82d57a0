"""Depth peeling: layer after layer of surfaces from one viewpoint (Everitt, *Interactive order-independent
transparency*, 2001)."""

from __future__ import annotations

import torch

from torchrender.depth.options import SamplingOptions
from torchrender.depth.samples import Samples
from torchrender.depth.viewpoints import cameras_between
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def central_camera(cameras: Cameras) -> Cameras:
    """One camera at the centroid of the eyes, with the mean orientation and intrinsics; sees all depths they see."""
    return cameras_between(cameras, torch.full((1, len(cameras)), 1.0 / len(cameras), dtype=torch.float64))


def peel(scene: Scene, cameras: Cameras, options: SamplingOptions) -> Samples:
    """Layer l of camera l; the cameras are copies of one.

    Layer l is the nearest surface more than ``eps_t`` behind layer l-1, so that shared edges and coplanar duplicates
    do not use up layers.
    """
    found, tests = Samples.room_for(cameras), None
    for number in range(len(cameras)):
        seen = rasterize_visibility(scene.geometry, cameras[number], cull=options.cull, tests=tests)
        layer = torch.full(seen.triangle.shape, number, dtype=torch.int32)
        if number:
            # Where nothing is left, the count of surfaces stops growing.
            count = found.layer[number - 1] + found.seen.covered[number - 1].to(torch.int32)
            layer = torch.where(seen.covered, layer, count)
        found.put(number, Samples(seen, layer, torch.zeros_like(seen.covered)))
        tests = FragmentTests(beyond=step_past(seen.depth, scene, options), skip=seen.triangle)
    return found


def step_past(depth: torch.Tensor, scene: Scene, options: SamplingOptions) -> torch.Tensor:
    """Depth float64 at which a search goes on behind a surface at ``depth``; +inf stays."""
    depth = depth.double()
    return depth + options.relative_tolerance * depth + options.scene_tolerance * scene.diagonal
