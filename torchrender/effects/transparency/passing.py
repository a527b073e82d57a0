"""How much of what lies behind a surface shows."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.numerics.split_sum import dielectric_albedo
from torchrender.scene.model import Scene
from torchrender.shading.ray_surface import ray_surface
from torchrender.shading.surface import Reader

CHUNK = 1 << 15
"""Points at a time: what they need stays in the processor's cache."""


def passing_light(
    scene: Scene, origins: Tensor, directions: Tensor, hits: RayHits, width: Tensor | float = 0.0
) -> tuple[Tensor, Tensor]:
    """What N surfaces, met by rays, send of their own light (N,), and let pass of the light behind them (N,3).

    A surface covers by its alpha and shows what lies behind by the rest. A thin wall lets pass, where it covers, its
    transmission times its colour of what it does not mirror; it bends no rays.

    Args:
        origins, directions: (N,3) of the rays that met them, any length.
        hits: what they met; no misses.
        width: number or (N,), of each ray at its hit, in scene units.
    """
    widths = torch.as_tensor(width, dtype=torch.float64).expand(len(hits.triangle))
    parts = []
    for rows in torch.arange(len(hits.triangle)).split(CHUNK):
        found = RayHits(hits.t[rows], hits.triangle[rows], hits.barycentric[rows])
        samples = ray_surface(scene, origins[rows], directions[rows], found, widths[rows])
        parts.append(_passing(scene, samples.image))
    if not parts:
        return torch.zeros(0), torch.zeros(0, 3)
    covered, behind = zip(*parts, strict=True)
    return torch.cat(covered), torch.cat(behind)


def _passing(scene: Scene, samples) -> tuple[Tensor, Tensor]:  # type: ignore[no-untyped-def]
    material = samples.material.reshape(-1)
    surface = Reader(scene, samples, torch.zeros(3, dtype=torch.float64)).surface(torch.arange(len(material)))
    blends = torch.tensor([*(m.blend for m in scene.materials), False])[material]
    covers = torch.where(blends, surface.alpha.clamp(0.0, 1.0), 1.0)
    cosine = (surface.normal * surface.to_eye).sum(0).clamp(0.0, 1.0)
    refraction = torch.cat([surface.weight[None], surface.excess])
    mirrored = dielectric_albedo(surface.dielectric.amax(0), refraction, cosine, surface.roughness)
    share = surface.transmission.clamp(0.0, 1.0) * (1.0 - surface.metallic) * (1.0 - mirrored)
    thin = (share * surface.base.clamp(0.0, 1.0)).T
    return covers, (1.0 - covers)[:, None] + covers[:, None] * thin
