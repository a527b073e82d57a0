"""Holes in textured triangles (leaves, fences): one bit per texel says whether the surface is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.scene.material import Material


@dataclass(frozen=True, eq=False)
class Cutout:
    """Texel masks of the materials that have holes.

    A point is solid if its nearest texel is; texture coordinates repeat, (0,0) is the lower left corner.
    """

    mask: Tensor  # (F,) int32 row of ``table`` for each triangle, -1 where it is solid
    table: Tensor  # (K,3) int64 offset into ``texels``, height, width
    texels: Tensor  # (N,) uint8, 1 where solid

    @property
    def triangles(self) -> Tensor:
        """(M,) int64 triangles that may have holes."""
        return (self.mask >= 0).nonzero().reshape(-1)


def build_cutout(materials: Sequence[Material], material_of: Tensor) -> Cutout | None:
    """Masks for triangles (F,) of the given materials; None if no triangle has holes."""
    rows = torch.full((max(len(materials), 1),), -1, dtype=torch.int32)
    table: list[tuple[int, int, int]] = []
    texels: list[Tensor] = []
    offset = 0
    for index, material in enumerate(materials):
        texture = material.diffuse_texture
        if material.alpha_cutoff is None or texture is None or texture.shape[2] != 4:
            continue
        solid = texture[..., 3] * material.opacity >= material.alpha_cutoff
        if bool(solid.all()):
            continue
        rows[index] = len(table)
        table.append((offset, texture.shape[0], texture.shape[1]))
        texels.append(solid.to(torch.uint8).reshape(-1))
        offset += solid.numel()
    mask = rows[material_of]
    if not table or not bool((mask >= 0).any()):
        return None
    return Cutout(mask, torch.tensor(table, dtype=torch.int64), torch.cat(texels))


def missing_triangles(
    materials: Sequence[Material], material_of: Tensor, faces: Tensor, alpha: Tensor | None
) -> Tensor | None:
    """(F,) bool: triangles whose alpha, textures left out, is below their material's cut-off; None: there are none.

    Vertices' alpha (V,) counts as its mean over a triangle.
    """
    limits = torch.tensor([m.alpha_cutoff or 0.0 for m in materials] or [0.0])[material_of]
    if not bool((limits > 0).any()):
        return None
    opacity = torch.tensor([m.opacity for m in materials])[material_of]
    if alpha is not None:
        opacity = opacity * alpha[faces.long()].mean(dim=1)
    missing = opacity < limits
    return missing if bool(missing.any()) else None
