"""What rough mirrors show of a picture of the sky: the picture filtered with the GGX lobe, by roughness.

The lobe is the one of a surface that is looked at along its normal (Karis, *Real shading in Unreal Engine 4*, 2013):
directions of light mirrored at normals that are distributed as GGX has them, weighted by their cosine. It is summed
over a tree of cells, coarse where the lobe is flat and fine about its axis; a cell counts where its light comes from,
so that a lamp keeps its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.kernels.sky.lobe import SkyTree, lobe_mean
from torchrender.numerics.texels.scaling import scaled_bilinearly
from torchrender.scene.sky.irradiance import latlong_directions, solid_angles
from torchrender.scene.sky.octahedral import interpolate_nodes, node_directions

LEVELS = 8
"""Filtered images; image k has roughness (k + 1) / LEVELS."""

NODES = 129
"""Nodes per side of a filtered image."""

LEAST_NODES = 33
"""The same of pictures of a few rows."""

COARSER = (1, 2, 2, 2, 4, 4, 4, 4)
"""Of each image every so many nodes are summed, and those between are interpolated."""

ROOTS, FINEST = 16, 256
"""Rows of the coarsest and of the finest cells."""

DETAIL = 0.5
"""Width of a cell that is taken whole, in what the lobe varies over."""


@dataclass(frozen=True, eq=False)
class FilteredSky:
    """A picture of the sky as rough mirrors show it."""

    levels: Tensor  # (LEVELS,N,N,3) octahedral maps of roughness 1 / LEVELS, 2 / LEVELS ... 1

    @classmethod
    def of(cls, radiance: Tensor, rows: int | None = None) -> FilteredSky:
        """From a latitude-longitude picture (H,W,3); ``rows`` of one that it was interpolated from, where it was."""
        tree = sky_tree(radiance)
        fine = min(NODES, 2 * radiance.shape[0] + 1, max(LEAST_NODES, 4 * (rows or NODES) + 1))
        made = []
        for number, step in enumerate(COARSER, start=1):
            size = max((fine - 1) // step, 16) + 1
            normals = node_directions(size).reshape(-1, 3)
            level = torch.zeros(size * size, 3)
            lobe_mean(tree, normals.numpy(), ((number / LEVELS) ** 2, DETAIL), level.numpy())
            made.append(_finer(level.reshape(size, size, 3), fine))
        return cls(torch.stack(made))

    def __call__(self, directions: Tensor, roughness: Tensor, sharp: Tensor) -> Tensor:
        """Radiance (...,3) by unit direction (...,3) and roughness (...); ``sharp`` (...,3) is that of roughness 0."""
        place = roughness.clamp(0.0, 1.0) * LEVELS
        lower = place.detach().floor().long().clamp(0, LEVELS - 1)
        value = torch.zeros_like(sharp)
        for number in torch.unique(lower).tolist():
            chosen = lower == number
            towards = directions[chosen]
            near = sharp[chosen] if number == 0 else interpolate_nodes(self.levels[number - 1], towards)
            far = interpolate_nodes(self.levels[number], towards)
            value[chosen] = torch.lerp(near, far, (place[chosen] - number)[..., None].to(far.dtype))
        return value


def sky_tree(radiance: Tensor) -> SkyTree:
    """The cells of a latitude-longitude picture (H,W,3)."""
    pictures = [_cells(radiance, FINEST)]
    while pictures[-1].shape[0] > ROOTS:
        height, width, _ = pictures[-1].shape
        pictures.append(pictures[-1].reshape(height // 2, 2, width // 2, 2, -1).sum(dim=(1, 3)))
    pictures.reverse()
    starts = np.cumsum([0] + [p.shape[0] * p.shape[1] for p in pictures])
    cells = torch.cat([_packed(p) for p in pictures]).float().numpy()
    return SkyTree(cells, starts.astype(np.int64), ROOTS)


def _cells(radiance: Tensor, rows: int) -> Tensor:
    """Sums (rows,2 rows,7) over cells: luminance-weighted direction, solid angle, radiance times solid angle."""
    height, width, _ = radiance.shape
    finer = max(1, -(-rows // height)), max(1, -(-2 * rows // width))
    value = radiance.detach().double().repeat_interleave(finer[0], 0).repeat_interleave(finer[1], 1)
    height, width, _ = value.shape
    solid = solid_angles(height, width).expand(height, width)[..., None]
    light = value * solid
    # A little of the solid angle keeps the direction of a black cell defined.
    pull = light.mean(dim=-1, keepdim=True) + solid * (1e-6 * float(light.sum()) + 1e-30)
    parts = torch.cat([latlong_directions(height, width).double() * pull, solid, light], dim=-1)
    j, i = torch.arange(height) * rows // height, torch.arange(width) * (2 * rows) // width
    flat = torch.zeros(2 * rows * rows, 7, dtype=torch.float64)
    flat.index_add_(0, (j[:, None] * (2 * rows) + i).reshape(-1), parts.reshape(-1, 7))
    return flat.reshape(rows, 2 * rows, 7)


def _packed(sums: Tensor) -> Tensor:
    height, width, _ = sums.shape
    direction = torch.nn.functional.normalize(sums[..., :3], dim=-1, eps=1e-300)
    size = math.pi / height
    polar = (torch.arange(height, dtype=torch.float64) + 0.5) * size
    wide = torch.maximum(polar.sin() * (2 * math.pi / width), torch.tensor(size, dtype=torch.float64))
    return torch.cat([direction, sums[..., 3:], wide[:, None, None].expand(height, width, 1)], dim=-1).reshape(-1, 8)


def _finer(level: Tensor, size: int) -> Tensor:
    """The nodes of a coarser image (N,N,3) and those between them."""
    if len(level) == size:
        return level
    planes = level.permute(2, 0, 1)[None]
    between = scaled_bilinearly(planes, (size, size), align_corners=True)
    return between[0].permute(1, 2, 0).contiguous()
