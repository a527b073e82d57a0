"""Tangent frames of triangles with normal maps: given ones, or derived as normal maps are baked.

The rule is that of Mikkelsen (*Simulation of wrinkled surfaces revisited*, 2008): corners that share position, normal
and texture coordinates, of triangles that map the texture the same way round, share one tangent: the mean of the
directions along u in their triangles, each in the plane of the normal and weighted by the corner's angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchrender.numerics.lobe import frame


@dataclass(frozen=True, eq=False)
class TangentTable:
    """Tangents at the corners of the triangles that need some."""

    row: Tensor  # (F,) int32 row of ``corners`` for each triangle, -1 where it needs none
    corners: Tensor  # (T,3,4) float32: along u, not necessarily unit; sign of the bitangent


@dataclass(frozen=True, eq=False)
class Corners:
    """What the tangents of T triangles are derived from."""

    position: Tensor  # (T,3,3) float64
    normal: Tensor  # (T,3,3) float64 unit
    uv: Tensor  # (T,3,2) float64, v up
    given: Tensor  # (T,3,4) float64, zero where none is given


def tangents_of(corners: Corners) -> Tensor:
    """Tangents (T,3,4) float32: the given ones, else derived ones. Never zero, whatever the texture coordinates."""
    derived = derive_tangents(corners.position, corners.normal, corners.uv)
    has = corners.given[..., :3].square().sum(-1, keepdim=True) > 0
    return torch.where(has, corners.given.float(), derived)


def derive_tangents(position: Tensor, normal: Tensor, uv: Tensor) -> Tensor:
    """Tangents (T,3,4) float32 of T triangles by the rule above; unit, at right angles to the normals.

    Args:
        position: (T,3,3) corners.
        normal: (T,3,3) unit normals there.
        uv: (T,3,2), v up. Where they span no area, any direction in the surface is taken.
    """
    position, normal, uv = position.double(), normal.double(), uv.double()
    edge, other = position[:, 1] - position[:, 0], position[:, 2] - position[:, 0]
    across, along = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]
    direction = (edge * along[:, 1:] - other * across[:, 1:]) * area.sign()[:, None]
    direction = normalize(direction, dim=-1, eps=1e-300)
    flat = direction[:, None] - (normal * direction[:, None]).sum(-1, keepdim=True) * normal
    flat = normalize(flat, dim=-1, eps=1e-300) * _angles(position, normal)[..., None]
    usable = torch.isfinite(flat).all(-1, keepdim=True) & (area != 0)[:, None, None]
    flat = torch.where(usable, flat, 0.0)
    sign = torch.where(area < 0, -1.0, 1.0).double()
    key = torch.cat([position, normal, uv, sign[:, None, None].expand(-1, 3, 1)], dim=-1).reshape(-1, 9)
    group = _groups(key)
    total = torch.zeros(int(group.max()) + 1 if len(group) else 0, 3, dtype=torch.float64)
    total.index_add_(0, group, flat.reshape(-1, 3))
    mean = total[group].reshape(-1, 3, 3)
    fallback = frame(normal.reshape(-1, 3))[0].reshape(-1, 3, 3)
    mean = torch.where(mean.square().sum(-1, keepdim=True) > 1e-20, normalize(mean, dim=-1, eps=1e-300), fallback)
    return torch.cat([mean, sign[:, None, None].expand(-1, 3, 1)], dim=-1).float()


def _angles(position: Tensor, normal: Tensor) -> Tensor:
    """Angles (T,3) at the corners, between the edges in the plane of the normal."""

    def in_plane(edge: Tensor) -> Tensor:
        return normalize(edge - (normal * edge).sum(-1, keepdim=True) * normal, dim=-1, eps=1e-300)

    before = in_plane(position.roll(1, 1) - position)
    after = in_plane(position.roll(-1, 1) - position)
    return torch.acos((before * after).sum(-1).clamp(-1.0, 1.0))


def _groups(key: Tensor) -> Tensor:
    """(N,) int64 number of each distinct row of (N,K) float64."""
    bits = (key + 0.0).contiguous().numpy().view(np.uint64)  # + 0: minus zero is zero
    mixed = np.zeros(len(bits), np.uint64)
    with np.errstate(over="ignore"):
        for column in range(bits.shape[1]):
            mixed = (mixed ^ bits[:, column]) * np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(29)
    return torch.from_numpy(np.unique(mixed, return_inverse=True)[1].reshape(-1).astype(np.int64))
