"""Point clouds that several tests draw."""

from __future__ import annotations

import torch

from torchrender.points.cloud import PointCloud


def sphere_cloud(count: int, *, seed: int = 0, radius: float | None = None, colored: bool = True) -> PointCloud:
    """Evenly spread points of the unit sphere (a Fibonacci spiral, slightly shaken)."""
    generator = torch.Generator().manual_seed(seed)
    k = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * k / count
    phi = k * (torch.pi * (3 - 5**0.5))
    ring = (1 - z * z).sqrt()
    position = torch.stack([ring * phi.cos(), ring * phi.sin(), z], dim=1)
    position = position + 0.2 * torch.randn(count, 3, generator=generator).double() / count**0.5
    position = torch.nn.functional.normalize(position, dim=1)
    return PointCloud(
        position=position,
        normal=position.float(),
        radius=torch.full((count,), (radius or 1.2) * (4 * torch.pi / count) ** 0.5),
        color=(0.5 + 0.5 * position).float() if colored else None,
    )


def sheet_cloud(side: int, *, z: float = 0.0, spacing: float = 0.05, color=(1.0, 1.0, 1.0), facing=1.0) -> PointCloud:
    """A square sheet of points in a plane of constant z whose normals point along +z (``facing`` -1: along -z)."""
    axis = (torch.arange(side, dtype=torch.float64) - (side - 1) / 2) * spacing
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    count = side * side
    return PointCloud(
        position=torch.stack([x, y, torch.full_like(x, z)], dim=-1).reshape(-1, 3),
        normal=torch.tensor([0.0, 0.0, facing]).expand(count, 3).contiguous(),
        radius=torch.full((count,), spacing),
        color=torch.tensor(color).expand(count, 3).contiguous(),
    )


def checkered_ground(*, spacing: float = 0.08, half_width: float = 4.0, depth: float = 24.0) -> PointCloud:
    """A ground plane of unit checkers, seen along -z: the far half is minified."""
    x = torch.arange(-half_width, half_width, spacing, dtype=torch.float64) + spacing / 2
    z = -torch.arange(1.0, depth, spacing, dtype=torch.float64) - spacing / 2
    zz, xx = torch.meshgrid(z, x, indexing="ij")
    position = torch.stack([xx, torch.zeros_like(xx), zz], dim=-1).reshape(-1, 3)
    count = len(position)
    return PointCloud(
        position=position,
        normal=torch.tensor([0.0, 1.0, 0.0]).expand(count, 3).contiguous(),
        radius=torch.full((count,), spacing),
        color=checker(position[:, 0], position[:, 2])[:, None].expand(count, 3).contiguous(),
    )


def checker(x: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    return ((x.floor() + z.floor()) % 2 == 0).float()


def joined(*clouds: PointCloud) -> PointCloud:
    return PointCloud(
        position=torch.cat([c.position for c in clouds]),
        normal=torch.cat([c.normal for c in clouds]),
        radius=torch.cat([c.radius for c in clouds]),
        color=torch.cat([c.color for c in clouds]),
    )


def psnr(image: torch.Tensor, reference: torch.Tensor) -> float:
    return float(-10 * torch.log10(((image.double() - reference.double()) ** 2).mean().clamp_min(1e-20)))


def random_cloud(count: int, seed: int = 0, spread: float = 100.0) -> PointCloud:
    g = torch.Generator().manual_seed(seed)
    return PointCloud(
        position=torch.randn(count, 3, generator=g).double() + 5.0,
        normal=torch.randn(count, 3, generator=g),
        radius=torch.rand(count, generator=g) * (spread - 1) * 1e-3 + 1e-3,
        color=torch.rand(count, 3, generator=g),
    )
