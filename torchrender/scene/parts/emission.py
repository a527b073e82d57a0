"""Light that surfaces emit, on the whole."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from torchrender.numerics.texture import channels_of
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh


def emitted_mean(meshes: Sequence[Mesh], materials: Sequence[Material]) -> float:
    """Radiance that surfaces emit, mean over the area of all: also that of a white box lit by it."""
    glow = [float(_mean_emission(m)) for m in materials]
    if not any(glow[mesh.material] > 0 for mesh in meshes):
        return 0.0
    areas = [_area(mesh) for mesh in meshes]
    return sum(a * glow[mesh.material] for a, mesh in zip(areas, meshes)) / max(sum(areas), 1e-300)


def _mean_emission(material: Material) -> Tensor:
    """Mean over texture and colours; what an unlit material shows counts as emitted."""
    if material.unlit:
        color, texture = material.diffuse, material.diffuse_texture
    else:
        color, texture = material.emission, material.emission_texture
    with torch.no_grad():
        mean = color if texture is None else color * channels_of(texture, 0, 3).mean((0, 1))
        return mean.mean()


def _area(mesh: Mesh) -> float:
    a, b, c = mesh.vertices.detach().double()[mesh.faces.long()].unbind(1)
    return float(torch.linalg.cross(b - a, c - a).norm(dim=-1).sum()) / 2
