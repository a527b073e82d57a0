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
    uv: Tensor | None = None  # (V,2) float32 coordinates that the masks are read at; None: those of the geometry

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
        solid = _solid(material)
        if solid is None or bool(solid.all()):
            continue
        rows[index] = len(table)
        table.append((offset, solid.shape[0], solid.shape[1]))
        texels.append(solid.to(torch.uint8).reshape(-1))
        offset += solid.numel()
    mask = rows[material_of]
    if not table or not bool((mask >= 0).any()):
        return None
    return Cutout(mask, torch.tensor(table, dtype=torch.int64), torch.cat(texels))


def _solid(material: Material) -> Tensor | None:
    """(H,W) bool texels that are there, what is mirrored beside its picture; None for a material without holes."""
    cutoff, texture = material.alpha_cutoff, material.diffuse_texture
    if cutoff is None:
        return None
    if texture is None or texture.shape[2] != 4:
        return torch.full((1, 1), material.opacity >= cutoff)
    solid = texture.detach()[..., 3] * material.opacity >= cutoff
    sampler = material.sampler("diffuse_texture")
    if sampler.wrap_u == "mirror":
        solid = torch.cat([solid, solid.flip(1)], dim=1)
    if sampler.wrap_v == "mirror":
        solid = torch.cat([solid.flip(0), solid], dim=0)  # the lower half, which v counts first, is the picture
    return solid


def cutout_uv(
    materials: Sequence[Material], material_of: Tensor, faces: Tensor, sets: Sequence[Tensor | None], count: int
) -> Tensor:
    """(V,2) float32 coordinates for the masks: of the set and after the transform that each material's sampler names.

    Vertices belong to triangles of one material. ``sets`` are the two sets of coordinates of the ``count`` vertices. A
    picture that is clamped repeats here.
    """
    uv = torch.zeros(count, 2) if sets[0] is None else sets[0].clone()
    for index, material in enumerate(materials):
        if material.alpha_cutoff is None:
            continue
        sampler = material.sampler("diffuse_texture")
        rows = torch.unique(faces[material_of == index].long())
        source = sets[sampler.uv_set]
        if source is None or not len(rows):
            continue
        moved = source[rows] @ sampler.transform[:, :2].T + sampler.transform[:, 2]
        scale = torch.tensor([0.5 if w == "mirror" else 1.0 for w in (sampler.wrap_u, sampler.wrap_v)])
        uv[rows] = moved * scale
    return uv
