"""Which surfaces clustered reflections miss."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import RayHits, VisibilityBuffer
from torchrender.effects.reflections.cluster_cameras import ClusterCameras
from torchrender.effects.reflections.cluster_images import cluster_camera, cluster_image, mirror_view
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.effects.reflections.reflectors import ReflectivePixels
from torchrender.scene.model import Scene


def occlusion_errors(
    scene: Scene, pixels: ReflectivePixels, made: ClusterCameras, hits: RayHits, options: ClusterOptions | None = None
) -> Tensor:
    """(N,) bool: the true first hit of a pixel's mirrored ray is not in the depth image of its cluster.

    It is missing if it projects outside, or if ``|z - D| > 1e-3 z + 2 g / max(|n.d|, 0.1)`` in all of the nearest 2 x 2
    texels (specification 03, section 9). Rays that hit nothing miss nothing.

    Args:
        hits: of :func:`torchrender.effects.reflections.reflectors.reflected_rays`, by the ray caster.
    """
    options = options or ClusterOptions()
    missed = torch.zeros(len(pixels), dtype=torch.bool)
    geometry = scene.geometry
    normals = geometry.face_normals
    for number in range(len(made)):
        rows = made.clusters.members(number)
        t, triangle = hits.t[rows], hits.triangle[rows]
        point = pixels.position[rows] + torch.where(torch.isfinite(t), t, 0.0)[:, None] * pixels.direction[rows]
        normal = normals[triangle.clamp_min(0)].double()
        if not bool(made.usable[number]):
            absent = torch.ones(len(rows), dtype=torch.bool)
        elif bool(made.planar[number]):
            found = mirror_view(geometry, pixels, made, number, scene.diagonal).hits.t
            width = pixels.pixel_angle[rows] * (pixels.length[rows] + torch.where(torch.isfinite(t), t, 0.0))
            facing = (normal * pixels.direction[rows]).sum(-1).abs().clamp_min(0.1)
            absent = ~((found - t).abs() <= 1e-3 * (pixels.length[rows] + t) + 2.0 * width / facing)
        else:
            seen = cluster_image(geometry, cluster_camera(made, number), pixels.position[rows], options.cull)
            absent = ~_recorded(seen, point, normal)
        missed[rows] = absent & torch.isfinite(t)
    return missed


def _recorded(seen: VisibilityBuffer, point: Tensor, normal: Tensor) -> Tensor:
    """(N,) bool: one of the 2 x 2 texels nearest to the projections of points (N,3) stores their depth."""
    camera = seen.cameras
    uv, depth = (x[0] for x in camera.project(point[None]))
    ray = torch.nn.functional.normalize(point - camera.eye[0], dim=-1, eps=1e-300)
    facing = (normal * ray).sum(-1).abs().clamp_min(0.1)
    tolerance = 1e-3 * depth + 2.0 * camera.footprint(depth[None])[0] / facing
    front = depth >= camera.near[0]
    uv = torch.where(front[:, None], uv, -1.0)
    limit = torch.tensor([camera.width, camera.height])
    inside = front & (uv >= 0).all(-1) & (uv < limit).all(-1)
    corner = (uv - 0.5).floor()
    found = torch.zeros_like(inside)
    for step in ((0, 0), (1, 0), (0, 1), (1, 1)):
        at = torch.minimum((corner + torch.tensor(step)).clamp_min(0).long(), limit - 1)
        found |= (seen.depth[0, at[:, 1], at[:, 0]].double() - depth).abs() <= tolerance
    return inside & found
