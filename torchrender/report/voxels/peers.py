"""Voxels by trimesh, Open3D and PyVista, measured against the exact set of cells on their own grids."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch

from torchrender.scene.mesh import Geometry
from torchrender.voxels.grid import VoxelGrid, Voxels
from torchrender.voxels.solid import voxelize_solid
from torchrender.voxels.surface import voxelize_surface

SURFACES = ("trimesh", "open3d", "pyvista")


@dataclass(frozen=True, eq=False)
class PeerCells:
    """Cells (N,3) that a peer marked, on the grid that it chose."""

    cells: np.ndarray
    grid: VoxelGrid


Work = Callable[[], Callable[[], PeerCells]]


def peer_surface(name: str, geometry: Geometry, cell: float) -> tuple[PeerCells | None, float, str]:
    """Cells, seconds, and why there are none."""
    return _measured(name, {"trimesh": _trimesh, "open3d": _open3d, "pyvista": _pyvista}[name], geometry, cell)


def peer_solid(name: str, geometry: Geometry, cell: float) -> tuple[PeerCells | None, float, str]:
    """The same for the inside; Open3D has none."""
    if name == "open3d":
        return None, 0.0, "has no solid voxels"
    return _measured(name, {"trimesh": _trimesh_solid, "pyvista": _pyvista_solid}[name], geometry, cell)


def _measured(
    name: str, work: Callable[[Geometry, float], Work], geometry: Geometry, cell: float
) -> tuple[PeerCells | None, float, str]:
    if importlib.util.find_spec(name) is None:
        return None, 0.0, "not installed (pip install torchrender[bench])"
    try:
        ready = work(geometry, cell)
        begin = time.perf_counter()
        listed = ready()  # the peer's own work; reading its result comes after
        seconds = time.perf_counter() - begin
        return listed(), seconds, ""
    except Exception as error:  # whatever a peer raises is a finding, not a failure of the study
        return None, 0.0, f"failed: {type(error).__name__}: {error}"[:120]


def agreement(found: PeerCells, geometry: Geometry, solid: bool) -> dict[str, float]:
    """Shares of the exact cells that are missing, and of the peer's that should not be there."""
    mesh = geometry.vertices[None], geometry.faces, found.grid
    exact = voxelize_solid(*mesh)[0] if solid else voxelize_surface(*mesh)
    nx, ny, nz = found.grid.dims
    dense = torch.zeros(1, nz, ny, nx, dtype=torch.bool)
    i, j, k = torch.from_numpy(np.ascontiguousarray(found.cells)).long().unbind(-1)
    inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny) & (k >= 0) & (k < nz)
    dense[0, k[inside], j[inside], i[inside]] = True
    own = Voxels.from_dense(dense, found.grid)
    count = max(exact.count, 1)
    return {
        "cells": own.count,
        "missing": (exact - own).count / count,
        "extra": (own - exact).count / max(own.count, 1),
    }


def _grid(origin: np.ndarray, cell: float, cells: np.ndarray, geometry: Geometry) -> VoxelGrid:
    high = geometry.bounds[1].numpy()
    most = np.maximum(np.ceil((high - origin) / cell).astype(int) + 2, cells.max(axis=0, initial=0) + 1)
    return _placed(origin, cell, most)


def _placed(origin: np.ndarray, cell: float, counts: np.ndarray) -> VoxelGrid:
    nx, ny, nz = (int(n) for n in counts)
    start = torch.tensor(origin.tolist(), dtype=torch.float64)
    return VoxelGrid(start[None], torch.tensor([cell], dtype=torch.float64), (nx, ny, nz))


def _trimesh(geometry: Geometry, cell: float) -> Work:
    import trimesh

    mesh = trimesh.Trimesh(geometry.vertices.numpy(), geometry.faces.numpy(), process=False)

    def run() -> Callable[[], PeerCells]:
        return partial(_of_trimesh, mesh.voxelized(cell), geometry, cell)

    return run


def _trimesh_solid(geometry: Geometry, cell: float) -> Work:
    import trimesh

    mesh = trimesh.Trimesh(geometry.vertices.numpy(), geometry.faces.numpy(), process=False)

    def run() -> Callable[[], PeerCells]:
        return partial(_of_trimesh, mesh.voxelized(cell).fill(), geometry, cell)

    return run


def _of_trimesh(found: Any, geometry: Geometry, cell: float) -> PeerCells:
    cells = np.asarray(found.sparse_indices)
    origin = np.asarray(found.transform)[:3, 3] - cell / 2  # its transform places the centres of cells
    return PeerCells(cells, _grid(origin, cell, cells, geometry))


def _open3d(geometry: Geometry, cell: float) -> Work:
    import open3d

    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(geometry.vertices.numpy()), open3d.utility.Vector3iVector(geometry.faces.numpy())
    )

    def run() -> Callable[[], PeerCells]:
        return partial(_of_open3d, open3d.geometry.VoxelGrid.create_from_triangle_mesh(mesh, cell), geometry, cell)

    return run


def _of_open3d(found: Any, geometry: Geometry, cell: float) -> PeerCells:
    cells = np.asarray([v.grid_index for v in found.get_voxels()]).reshape(-1, 3)
    return PeerCells(cells, _grid(np.asarray(found.origin), cell, cells, geometry))


def _polydata(geometry: Geometry) -> Any:
    import pyvista

    return pyvista.PolyData.from_regular_faces(geometry.vertices.numpy(), geometry.faces.numpy())


def _pyvista(geometry: Geometry, cell: float) -> Work:
    """VTK's voxel modeller: cells of which the centre lies within half a diagonal of the surface."""
    import vtk

    mesh = _polydata(geometry)
    low, high = geometry.bounds.numpy()
    counts = np.ceil((high - low) / cell).astype(int) + 2
    first = (low + high) / 2 - counts * cell / 2

    def run() -> Callable[[], PeerCells]:
        modeller = vtk.vtkVoxelModeller()
        modeller.SetInputData(mesh)
        modeller.SetSampleDimensions(*(int(n) for n in counts))
        last = first + counts * cell
        modeller.SetModelBounds(first[0], last[0], first[1], last[1], first[2], last[2])
        modeller.SetScalarTypeToUnsignedChar()
        modeller.SetMaximumDistance(0.5 * 3**0.5 * cell / float((last - first).max()))
        modeller.Update()
        return partial(_of_modeller, modeller.GetOutput(), counts)

    return run


def _of_modeller(image: Any, counts: np.ndarray) -> PeerCells:
    from vtk.util.numpy_support import vtk_to_numpy

    values = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(counts[::-1])
    spacing = np.array(image.GetSpacing())
    origin = np.array(image.GetOrigin()) - spacing / 2  # its points are the centres of cells
    return PeerCells(np.argwhere(values > 0)[:, ::-1], _placed(origin, float(spacing.mean()), counts))


def _pyvista_solid(geometry: Geometry, cell: float) -> Work:
    import pyvista

    mesh = _polydata(geometry)
    low, high = geometry.bounds.numpy()
    counts = np.ceil((high - low) / cell).astype(int) + 2
    first = (low + high) / 2 - counts * cell / 2

    def run() -> Callable[[], PeerCells]:
        reference = pyvista.ImageData(
            dimensions=tuple(int(n) for n in counts), spacing=(cell,) * 3, origin=tuple(first + cell / 2)
        )
        mask = mesh.voxelize_binary_mask(reference_volume=reference)
        return partial(_of_mask, mask, first, cell, counts)

    return run


def _of_mask(mask: Any, first: np.ndarray, cell: float, counts: np.ndarray) -> PeerCells:
    values = np.asarray(mask.point_data["mask"]).reshape(counts[::-1])
    return PeerCells(np.argwhere(values > 0)[:, ::-1], _placed(first, cell, counts))
