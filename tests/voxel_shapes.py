"""Meshes and slow twins for the voxel tests."""

from __future__ import annotations

import numpy as np
import torch
import trimesh
from torch import Tensor

from torchrender.voxels.grid import VoxelGrid

SLACK = 1e-9


def unit_grid(*dims: int) -> VoxelGrid:
    """Cells of size one from the origin on."""
    nx, ny, nz = dims if len(dims) == 3 else (dims[0],) * 3
    return VoxelGrid(torch.zeros(1, 3), torch.ones(1), (nx, ny, nz))


def ball_grid(n: int, half: float = 1.1) -> VoxelGrid:
    """n cells per side over [-half, half]^3."""
    return VoxelGrid(torch.full((1, 3), -half, dtype=torch.float64), torch.tensor([2 * half / n]).double(), (n, n, n))


def icosphere(level: int = 4, radius: float = 1.0) -> tuple[Tensor, Tensor]:
    """Vertices (1,V,3) float64 and faces (F,3)."""
    mesh = trimesh.creation.icosphere(level, radius)
    return torch.from_numpy(np.array(mesh.vertices))[None], torch.from_numpy(np.array(mesh.faces))


def cube(low: float, high: float) -> tuple[Tensor, Tensor]:
    """An axis-aligned cube, 12 faces that turn outwards."""
    mesh = trimesh.creation.box(bounds=[[low] * 3, [high] * 3])
    return torch.from_numpy(np.array(mesh.vertices))[None], torch.from_numpy(np.array(mesh.faces))


def together(*meshes: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Several meshes as one."""
    vertices, faces, count = [], [], 0
    for v, f in meshes:
        vertices.append(v)
        faces.append(f + count)
        count += v.shape[1]
    return torch.cat(vertices, dim=1), torch.cat(faces)


def cell_indices(dims: tuple[int, int, int]) -> Tensor:
    """(nz,ny,nx,3) i, j, k."""
    nx, ny, nz = dims
    k, j, i = torch.meshgrid(torch.arange(nz), torch.arange(ny), torch.arange(nx), indexing="ij")
    return torch.stack([i, j, k], dim=-1)


def inside_convex(vertices: Tensor, faces: Tensor, grid: VoxelGrid, subbits: int = 8) -> Tensor:
    """(nz,ny,nx) bool: centres on the inner side of every face of a convex mesh, vertices snapped as in the fill."""
    units = 1 << subbits
    snapped = ((vertices[0] - grid.origin[0]) / grid.cell[0] * units).round()
    corners = snapped[faces]
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    limit = (normal * corners[:, 0]).sum(dim=1)
    centres = cell_indices(grid.dims).reshape(-1, 3).double() * units + units / 2
    # Between the spheres inside and around the body every face is asked, elsewhere no face needs to be.
    middle, length = snapped.mean(dim=0), normal.norm(dim=1).clamp_min(1e-30)
    whole = length > 1e-6
    inner = ((limit - normal @ middle) / length)[whole].amin()
    away = (centres - middle).norm(dim=1)
    inside = away < inner - 1
    between = (~inside & (away <= (snapped - middle).norm(dim=1).amax() + 1)).nonzero().reshape(-1)
    for part in between.split(4096):
        inside[part] = (centres[part] @ normal.T <= limit).all(dim=1)
    nx, ny, nz = grid.dims
    return inside.reshape(nz, ny, nx)


def box_test(triangle: np.ndarray, dims: tuple[int, int, int]) -> np.ndarray:
    """(nz,ny,nx) bool: cells that meet a triangle (3,3) in cell units, by thirteen axes; none without area.

    The slow twin of the conservative mode.
    """
    centres = cell_indices(dims).numpy() + 0.5
    edges = np.roll(triangle, -1, axis=0) - triangle
    normal = np.cross(edges[0], edges[1])
    met = np.ones(centres.shape[:3], bool)
    if not normal.any():
        return ~met
    axes = [*np.eye(3), normal, *(np.cross(e, unit) for e in edges for unit in np.eye(3))]
    for axis in axes:
        at, middle = triangle @ axis, centres @ axis
        radius = (0.5 + SLACK) * np.abs(axis).sum()
        met &= (at.min() <= middle + radius) & (at.max() >= middle - radius)
    return met


def column_test(triangle: np.ndarray, dims: tuple[int, int, int]) -> np.ndarray:
    """The slow twin of the thin mode: column by column, in plain coordinates."""
    marked = np.zeros(dims[::-1], bool)
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    if not normal.any():
        return marked
    d = int(np.argmax(np.abs(normal)))
    a, b = (axis for axis in range(3) if axis != d)
    for ib in range(dims[b]):
        for ia in range(dims[a]):
            point = np.array([ia + 0.5, ib + 0.5])
            corners = triangle[:, [a, b]]
            areas = []
            for e in range(3):
                p, q = corners[e], corners[(e + 1) % 3]
                areas.append((q[0] - p[0]) * (point[1] - p[1]) - (q[1] - p[1]) * (point[0] - p[0]))
            if min(areas) < 0 < max(areas):
                continue
            weights = np.array([areas[1], areas[2], areas[0]]) / sum(areas)
            k = int(np.floor(weights @ triangle[:, d]))
            if 0 <= k < dims[d]:
                cell = np.zeros(3, int)
                cell[a], cell[b], cell[d] = ia, ib, k
                marked[cell[2], cell[1], cell[0]] = True
    return marked
