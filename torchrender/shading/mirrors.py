"""What the materials tell mirrors, point by point: normals with their maps, widths of lobes."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.scene.model import Scene
from torchrender.shading.surface import Reader


def mirror_values(scene: Scene, samples: GBuffer | RaySurface, rows: Tensor) -> tuple[Tensor, Tensor]:
    """Shading normals (N,3) and lobe widths (N,) float64 in [0,1] of samples in flat rows (N,)."""
    material = samples.material.reshape(-1).index_select(0, rows)
    present = torch.bincount(material, minlength=len(scene.materials)).nonzero().reshape(-1).tolist()
    used = [scene.materials[number] for number in present]
    if all(m.normal_texture is None and m.metallic_roughness_texture is None for m in used):
        return samples.normal.reshape(-1, 3).index_select(0, rows), scene.material_table.gloss[material]
    surface = Reader(scene, samples, torch.zeros(3, dtype=torch.float64)).surface(rows)
    physical = torch.tensor([m.is_physical for m in scene.materials] or [False])[material]
    return surface.normal.T, torch.where(physical, surface.roughness.double(), scene.material_table.gloss[material])
