"""Which surfaces clustered reflections miss."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.effects.reflections.clusters.bundle import ClusterCameras
from torchrender.effects.reflections.clusters.images import mirror_view
from torchrender.effects.reflections.clusters.layers import LayerImages, batches, draw_images
from torchrender.effects.reflections.clusters.shading import RAYS, ray_ends
from torchrender.effects.reflections.reflectors import START, ReflectivePixels, reflected_rays
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
    normals = scene.geometry.face_normals
    for number in (made.usable & made.planar).nonzero().reshape(-1).tolist():
        rows = made.clusters.members(number)
        t = hits.t[rows]
        found = mirror_view(scene.geometry, pixels, made, number).hits.t
        width = pixels.pixel_angle[rows] * (pixels.length[rows] + torch.where(torch.isfinite(t), t, 0.0))
        facing = (normals[hits.triangle[rows].clamp_min(0)] * pixels.direction[rows]).sum(-1).abs().clamp_min(0.1)
        missed[rows] = ~((found - t).abs() <= 1e-3 * (pixels.length[rows] + t) + 2.0 * width / facing)
    curved = (made.usable & ~made.planar).nonzero().reshape(-1)
    for numbers in batches(made, curved, 1, RAYS) if len(curved) else ():
        place = torch.full((len(made),), -1, dtype=torch.int64)
        place[numbers] = torch.arange(len(numbers))
        rows = (place[made.clusters.cluster] >= 0).nonzero().reshape(-1)
        part = pixels.select(rows)
        rays, image = reflected_rays(part), place[made.clusters.cluster[rows]]
        ends = ray_ends(part, rays, scene.diagonal, options)
        sent = (rays, image, (START * rays.width, ends))
        images = draw_images(scene.geometry, pixels, made, numbers, [sent], options.layers)
        t = torch.where(torch.isfinite(hits.t[rows]), hits.t[rows], 0.0)
        point = part.position + t[:, None] * part.direction
        missed[rows] = ~_recorded(images, image, point, normals[hits.triangle[rows].clamp_min(0)].double())
    unusable = ~made.usable[made.clusters.cluster]
    return (missed | unusable) & torch.isfinite(hits.t)


def _recorded(images: LayerImages, image: Tensor, point: Tensor, normal: Tensor) -> Tensor:
    """(N,) bool: one of the 2 x 2 texels nearest to the projections of points (N,3) stores their depth in a layer."""
    eye, look, box, size, near, first = (torch.from_numpy(a)[image] for a in images.views)
    own = (look @ (point - eye)[..., None])[..., 0]
    depth = own[:, 2].clamp_min(1e-300)
    step = (box[:, 2:] - box[:, :2]) / size
    facing = (normal * torch.nn.functional.normalize(point - eye, dim=-1, eps=1e-300)).sum(-1).abs().clamp_min(0.1)
    tolerance = 1e-3 * depth + 2.0 * depth * step.amax(dim=1) / facing
    uv = (own[:, :2] / depth[:, None] - box[:, :2]) / step
    inside = (own[:, 2] >= near) & (uv >= 0).all(-1) & (uv < size).all(-1)
    corner = (torch.where(inside[:, None], uv, 0.0) - 0.5).floor()
    layers = torch.from_numpy(images.layers.depth)
    found = torch.zeros_like(inside)
    for shift in ((0, 0), (1, 0), (0, 1), (1, 1)):
        at = torch.minimum((corner + torch.tensor(shift)).clamp_min(0).long(), size - 1)
        stored = layers[first + at[:, 1] * size[:, 0] + at[:, 0]].double()
        found |= ((stored - depth[:, None]).abs() <= tolerance[:, None]).any(dim=1)
    return inside & found
