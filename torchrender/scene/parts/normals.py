"""Shading normals of vertices that have moved."""

from __future__ import annotations

import torch
from torch import Tensor


def shared_corners(vertices: Tensor, normals: Tensor) -> Tensor:
    """(V,) int64 the same number for vertices of one place and one normal, as along the seam of a texture."""
    alike = torch.cat([vertices.detach().float(), normals.detach().float()], dim=1)
    return torch.unique(alike, dim=0, return_inverse=True)[1]


def followed_normals(vertices: Tensor, faces: Tensor, shared: Tensor, before: Tensor) -> Tensor:
    """(V,3) unit means of the faces around each vertex, weighted by area; the same where ``shared`` (V,) is the same.

    Args:
        vertices: (V,3) where they are now.
        faces: (F,3).
        before: (V,3) kept where no face has an area.
    """
    a, b, c = vertices.detach()[faces].unbind(1)
    face = torch.linalg.cross(b - a, c - a)
    total = torch.zeros(len(vertices), 3, dtype=face.dtype)
    for corner in range(3):
        total.index_add_(0, shared[faces[:, corner]], face)
    found = torch.nn.functional.normalize(total, dim=-1, eps=1e-30)[shared].to(before.dtype)
    return torch.where(found.abs().sum(-1, keepdim=True) > 0, found, before)
