"""What the materials tell mirrors, point by point: normals with their maps, widths of lobes."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.scene.model import Scene
from torchrender.shading.fused import is_of, read_fused
from torchrender.shading.surface import Reader
from torchrender.shading.variables import wants_gradient


def mirror_values(scene: Scene, samples: GBuffer | RaySurface, rows: Tensor) -> tuple[Tensor, Tensor]:
    """Shading normals (N,3) and lobe widths (N,) float64 in [0,1] of samples in flat rows (N,)."""
    material = samples.material.reshape(-1).index_select(0, rows)
    present = torch.bincount(material, minlength=len(scene.materials)).nonzero().reshape(-1).tolist()
    used = [scene.materials[number] for number in present]
    if all(m.normal_texture is None and m.metallic_roughness_texture is None for m in used):
        return samples.normal.reshape(-1, 3).index_select(0, rows), scene.material_table.gloss[material]
    if is_of(samples, scene) and not wants_gradient(scene):
        normal, roughness = read_fused(scene, samples, rows)
    else:
        surface = Reader(scene, samples, torch.zeros(3, dtype=torch.float64)).surface(rows)
        normal, roughness = surface.normal.T, surface.roughness
    physical = torch.tensor([m.is_physical for m in scene.materials] or [False])[material]
    return normal, torch.where(physical, roughness.double(), scene.material_table.gloss[material])
