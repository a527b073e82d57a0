"""Depth peeling: layer after layer of surfaces from one viewpoint (Everitt, *Interactive order-independent
transparency*, 2001)."""

from __future__ import annotations

from dataclasses import replace

import torch

from torchrender.depth.options import SamplingOptions
from torchrender.depth.samples import Samples, stack
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def central_camera(cameras: Cameras) -> Cameras:
    """One camera at the centroid of the eyes, with the mean orientation and intrinsics; sees all depths they see.

    The mean rotation is the nearest rotation to the mean of the matrices. Where they cancel out, the first camera's is
    taken.
    """
    u, sizes, v = torch.linalg.svd(cameras.rotation.mean(dim=0))
    rotation = u @ torch.diag(torch.tensor([1.0, 1.0, float(torch.linalg.det(u @ v).sign())], dtype=torch.float64)) @ v
    if float(sizes[1]) < 1e-6:
        rotation = cameras.rotation[0]
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ cameras.eye.mean(dim=0)
    return replace(
        cameras,
        camera_from_world=matrix[None],
        intrinsics=cameras.intrinsics.mean(dim=0, keepdim=True),
        near=cameras.near.amin(dim=0, keepdim=True),
        far=cameras.far.amax(dim=0, keepdim=True),
    )


def peel(scene: Scene, cameras: Cameras, options: SamplingOptions) -> Samples:
    """Layer l of camera l; the cameras are copies of one.

    Layer l is the nearest surface more than ``eps_t`` behind layer l-1, so that shared edges and coplanar duplicates
    do not use up layers.
    """
    views: list[Samples] = []
    tests = None
    for number in range(len(cameras)):
        seen = rasterize_visibility(scene.geometry, cameras[number], cull=options.cull, tests=tests)
        shape = seen.triangle.shape
        layer = torch.full(shape, number, dtype=torch.int32)
        if views:
            before = views[-1]
            # Where nothing is left, the count of surfaces stops growing.
            count = before.layer + before.seen.covered.to(torch.int32)
            layer = torch.where(seen.covered, layer, count)
        views.append(Samples(seen, layer, torch.zeros(shape, dtype=torch.bool)))
        tests = FragmentTests(beyond=step_past(seen.depth, scene, options), skip=seen.triangle)
    return stack(views, cameras)


def step_past(depth: torch.Tensor, scene: Scene, options: SamplingOptions) -> torch.Tensor:
    """Depth float64 at which a search goes on behind a surface at ``depth``; +inf stays."""
    depth = depth.double()
    return depth + options.eps_relative * depth + options.eps_scene * scene.diagonal
