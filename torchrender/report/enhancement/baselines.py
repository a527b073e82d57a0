"""What people turn on today to read shape better, in its published form, on pictures (1,H,W)."""

from __future__ import annotations

import math

import kornia
import torch
from torch import Tensor

from torchrender.effects.enhancement.surface_image import SurfaceImage

RIM = 0.1
"""``alpha_r`` of Radiance Scaling: the intensity that stays."""


def unsharp_mask(picture: Tensor, covered: Tensor, sigma: float = 4.0, amount: float = 0.5) -> Tensor:
    """(1,H,W) picture plus what a blur takes away; the blur counts covered pixels only."""
    return picture + amount * (picture - _blurred(picture, covered, sigma))


def _blurred(picture: Tensor, covered: Tensor, sigma: float) -> Tensor:
    size = 2 * int(3 * sigma + 0.5) + 1
    mask = covered[:, None].to(picture.dtype)

    def blur(x: Tensor) -> Tensor:
        return kornia.filters.gaussian_blur2d(x, (size, size), (sigma, sigma), border_type="constant")

    return (blur(picture[:, None] * mask) / blur(mask).clamp_min(1e-9))[:, 0]


def high_pass(picture: Tensor, covered: Tensor, sigma: float = 3.0) -> Tensor:
    """(1,H,W) the picture without what a blur of the covered pixels keeps; 0 elsewhere."""
    return torch.where(covered, picture - _blurred(picture, covered, sigma), 0.0)


def picture_gradient(picture: Tensor, covered: Tensor, weight: float = 1.0) -> Tensor:
    """(1,H,W) picture plus the sum of its central differences."""
    slope = kornia.filters.spatial_gradient(picture[:, None], mode="diff", order=1)[:, 0]
    return torch.where(covered, picture + weight * slope.sum(dim=1), picture)


def normal_bend(surface: SurfaceImage) -> Tensor:
    """(1,H,W) screen-space mean curvature in [-1,1] from differences of the normals of the view; convex is positive."""
    rotation = surface.cameras.rotation.float()
    view = torch.einsum("bij,bhwj->bihw", rotation, surface.normal)
    slope = kornia.filters.spatial_gradient(view, mode="diff", order=1)  # (1,3,2,H,W)
    bend = slope[:, 0, 0] + slope[:, 1, 1]
    inside = torch.nn.functional.max_pool2d((~surface.covered)[:, None].float(), 3, 1, 1)[:, 0] == 0
    bend = torch.where(inside, bend, 0.0)
    scale = bend[inside].abs().quantile(0.95) if bool(inside.any()) else torch.ones(())
    return (bend / scale.clamp_min(1e-9)).clamp(-1.0, 1.0)


def radiance_scaling(intensity: Tensor, bend: Tensor, gamma: float = 1.0) -> Tensor:
    """(1,H,W) intensities in [0,1], scaled by ``sigma(c, delta)`` (Vergne et al. 2010)."""
    delta = intensity.clamp(0.0, 1.0)
    e = torch.exp(-gamma * bend)
    top = RIM * e + delta * (1.0 - RIM * (1.0 + e))
    bottom = RIM + delta * (e - RIM * (1.0 + e))
    return intensity * top / bottom


def eye_dome(picture: Tensor, surface: SurfaceImage, reach: int = 2, strength: float = 300.0) -> Tensor:
    """(1,H,W) eye-dome lighting (Boucheny 2009): darker where neighbours are nearer, by the logarithm of depth."""
    depth = torch.where(surface.covered, surface.depth, torch.inf).log2()
    padded = torch.nn.functional.pad(depth[:, None], (reach,) * 4, mode="replicate")[:, 0]
    height, width = depth.shape[1:]
    total = torch.zeros_like(depth)
    for j, i in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        row, column = reach + reach * j, reach + reach * i
        other = padded[:, row : row + height, column : column + width]
        total += torch.where(torch.isfinite(other) & torch.isfinite(depth), (depth - other).clamp_min(0.0), 0.0)
    return picture * torch.exp(-strength * total / 4)


def screen_occlusion(picture: Tensor, surface: SurfaceImage, samples: int = 16, radius: float = 0.03) -> Tensor:
    """(1,H,W) picture times screen-space ambient occlusion; ``radius`` in median depths."""
    g = torch.Generator().manual_seed(0)
    height, width = surface.depth.shape[1:]
    eye, reference = surface.cameras.eye[0], surface.reference_depth[..., None].double()
    direction = torch.nn.functional.normalize(torch.randn(samples, 3, generator=g, dtype=torch.float64), dim=-1)
    length = radius * (torch.arange(samples) + 1.0) / samples
    open_ = torch.zeros_like(surface.depth)
    for way, far in zip(direction, length):
        turned = torch.where((surface.normal.double() @ way)[..., None] < 0, -way, way)
        point = surface.position + far * reference * turned
        pixel, depth = surface.cameras.project(point)
        column, row = (pixel[..., k].floor().long() for k in (0, 1))
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        there = surface.depth[0][row.clamp(0, height - 1), column.clamp(0, width - 1)]
        near = (depth - there).abs() < 2 * radius * reference[..., 0]
        open_ += torch.where(inside & near & (there < depth - 1e-3 * reference[..., 0]), 0.0, 1.0)
    del eye
    return picture * torch.where(surface.covered, (open_ / samples).clamp(0.0, 1.0), 1.0)


def seen_from(picture: Tensor, distance_cm: float) -> Tensor:
    """(1,H,W) as it reaches an eye at a distance: blurred by one pixel for 50 cm."""
    sigma = distance_cm / 50.0
    size = 2 * math.ceil(3 * sigma) + 1
    return kornia.filters.gaussian_blur2d(picture[:, None], (size, size), (sigma, sigma))[:, 0]
