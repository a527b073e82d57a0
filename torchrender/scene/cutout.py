"""Holes in triangles (leaves, fences): one byte per texel says whether the surface is there.

Alpha is that of the texture, times the material's opacity, times what the vertices carry. A byte holds the first two in
units of the cutoff, so that all wraps, transforms and sets of coordinates are settled before a triangle is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchrender.kernels.raster.records import SOLID
from torchrender.numerics.texture import channels_of
from torchrender.scene.material import WRAPS, Material


@dataclass(frozen=True, eq=False)
class Cutout:
    """Texels of the materials that have holes.

    A point is solid if its nearest texel times the opacity of the vertices is at least :data:`SOLID`.
    """

    mask: Tensor  # (F,) int32 row of ``table`` for each triangle, -1 where it is solid
    table: Tensor  # (K,4) int64 offset into ``texels``, height, width, wraps: along u plus three times along v
    texels: Tensor  # (N,) uint8 alpha over cutoff, times SOLID
    vertices: Tensor  # (V,3) float32 texture coordinates as the textures lie, opacity

    @property
    def triangles(self) -> Tensor:
        """(M,) int64 triangles that may have holes."""
        return (self.mask >= 0).nonzero().reshape(-1)


class Corners(NamedTuple):
    """What the V vertices of F triangles carry; None: nothing of the kind."""

    faces: Tensor  # (F,3)
    uv: Tensor | None  # (V,2)
    uv1: Tensor | None  # (V,2)
    alpha: Tensor | None  # (V,)


def build_cutout(materials: Sequence[Material], material_of: Tensor, corners: Corners, count: int) -> Cutout | None:
    """Texels for triangles (F,) of the given materials, with ``count`` vertices; None if no triangle has holes."""
    rows = torch.full((max(len(materials), 1),), -1, dtype=torch.int32)
    table: list[tuple[int, int, int, int]] = []
    texels: list[Tensor] = []
    offset = 0
    for index, material in enumerate(materials):
        alpha = _alpha(material)
        if alpha is None or (corners.alpha is None and bool((alpha >= SOLID).all())):
            continue
        sampler = material.sampler("diffuse_texture")
        wraps = WRAPS.index(sampler.wrap_u) + 3 * WRAPS.index(sampler.wrap_v)
        rows[index] = len(table)
        table.append((offset, alpha.shape[0], alpha.shape[1], wraps))
        texels.append(alpha.reshape(-1))
        offset += alpha.numel()
    mask = rows[material_of]
    if not table or not bool((mask >= 0).any()):
        return None
    placed = _placed(materials, material_of, corners, count)
    return Cutout(mask, torch.tensor(table, dtype=torch.int64), torch.cat(texels), placed)


def _alpha(material: Material) -> Tensor | None:
    """(H,W) uint8 alpha over cutoff, times SOLID; None without a cutoff."""
    if material.alpha_cutoff is None:
        return None
    texture = material.diffuse_texture
    alpha = torch.ones(1, 1) if texture is None or texture.shape[2] < 4 else channels_of(texture, 3, 4).detach()[..., 0]
    alpha = alpha * material.opacity
    share = alpha / max(material.alpha_cutoff, 1e-6)
    # A cutoff of zero is met by everything; rounding must not move a texel over the cutoff.
    value = torch.where(share >= 1.0, (share * SOLID).clamp(SOLID, 255), (share * SOLID).clamp(0, SOLID - 1).floor())
    return torch.where(alpha >= material.alpha_cutoff, value.clamp_min(SOLID), value).to(torch.uint8)


def _placed(materials: Sequence[Material], material_of: Tensor, corners: Corners, count: int) -> Tensor:
    """(V,3) coordinates as the textures lie, and opacity."""
    placed = torch.zeros(count, 3)
    placed[:, 2] = 1.0 if corners.alpha is None else corners.alpha
    for index in torch.unique(material_of).tolist():
        if materials[index].alpha_cutoff is None:
            continue
        chosen = corners.faces[material_of == index].reshape(-1).long().unique()
        sampler = materials[index].sampler("diffuse_texture")
        uv = corners.uv if sampler.uv_set == 0 else corners.uv1
        if uv is not None:
            matrix = sampler.transform.double()
            placed[chosen, :2] = (uv[chosen].double() @ matrix[:, :2].T + matrix[:, 2]).float()
    return placed
