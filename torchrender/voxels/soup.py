"""The inside of triangles that do not join, by generalised winding numbers. Source: specification 05, section 5.2."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.kernels.meshes.culling_clusters import spatial_order
from torchrender.kernels.voxels.winding import gather_clusters, winding_slice
from torchrender.voxels.grid import VoxelGrid, Voxels

CLUSTER = 64


def winding_numbers(points: np.ndarray, faces: np.ndarray, grid: VoxelGrid) -> Tensor:
    """(nz,ny,nx) float32 winding number at the cell centres of one grid: 1 inside a closed mesh that faces outwards."""
    nx, ny, nz = grid.dims
    order = spatial_order(points, faces, np.array([0, len(faces)], np.int64))
    cells = (points - grid.origin[0].numpy()) / float(grid.cell[0])
    corners = np.ascontiguousarray(cells[faces[order]])
    dipoles = np.zeros((-(-len(faces) // CLUSTER), 7))
    gather_clusters(corners, CLUSTER, dipoles)
    out = np.zeros((nz, ny, nx), np.float32)
    for k in range(nz):
        winding_slice(corners, CLUSTER, dipoles, k + 0.5, out[k])
    return torch.from_numpy(out)


def soup_words(points: np.ndarray, faces: np.ndarray, grid: VoxelGrid) -> Tensor:
    """(nz,ny,nw) bits of the cells whose winding number exceeds one half, in either direction."""
    if not len(faces):
        return Voxels.empty(grid).words[0]
    inside = winding_numbers(points, faces, grid).abs() > 0.5
    return Voxels.from_dense(inside[None], grid).words[0]
