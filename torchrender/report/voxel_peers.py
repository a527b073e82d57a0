"""Surface and solid voxels by trimesh, Open3D and PyVista, measured against the exact set of cells on their own grids."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from torchrender.geometry.voxel_grid import VoxelGrid, Voxels
from torchrender.geometry.voxel_solid import voxelize_solid
from torchrender.geometry.voxelize import voxelize_surface
from torchrender.scene.mesh import Geometry

SURFACES = ("trimesh", "open3d", "pyvista")


@dataclass(frozen=True, eq=False)
class PeerCells:
    """Cells (N,3) that a peer marked, on the grid that it chose."""

    cells: np.ndarray
    grid: VoxelGrid


def peer_surface(name: str, geometry: Geometry, cell: float) -> tuple[PeerCells | None, float, str]:
    """Cells, seconds, and why there are none."""
    return _measured(name, {"trimesh": _trimesh, "open3d": _open3d, "pyvista": _pyvista}[name], geometry, cell)


def peer_solid(name: str, geometry: Geometry, cell: float) -> tuple[PeerCells | None, float, str]:
    """The same for the inside; Open3D has none."""
    if name == "open3d":
        return None, 0.0, "has no solid voxels"
    return _measured(name, {"trimesh": _trimesh_solid, "pyvista": _pyvista_solid}[name], geometry, cell)


def _measured(
    name: str, work: Callable[[Geometry, float], Callable[[], PeerCells]], geometry: Geometry, cell: float
) -> tuple[PeerCells | None, float, str]:
    if importlib.util.find_spec(name) is None:
        return None, 0.0, "not installed (pip install torchrender[bench])"
    try:
        ready = work(geometry, cell)
        begin = time.perf_counter()
        found = ready()
        return found, time.perf_counter() - begin, ""
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
    return {"cells": own.count, "missing": (exact - own).count / count, "extra": (own - exact).count / max(own.count, 1)}


def _grid(origin: np.ndarray, cell: float, cells: np.ndarray, geometry: Geometry) -> VoxelGrid:
    high = geometry.bounds[1].numpy()
    most = np.maximum(np.ceil((high - origin) / cell).astype(int) + 2, cells.max(axis=0, initial=0) + 1)
    return VoxelGrid(torch.from_numpy(origin)[None], torch.tensor([cell], dtype=torch.float64), tuple(int(m) for m in most))  # type: ignore[arg-type]


def _trimesh(geometry: Geometry, cell: float) -> Callable[[], PeerCells]:
    import trimesh

    mesh = trimesh.Trimesh(geometry.vertices.numpy(), geometry.faces.numpy(), process=False)

    def run() -> PeerCells:
        return _of_trimesh(mesh.voxelized(cell), geometry, cell)

    return run


def _trimesh_solid(geometry: Geometry, cell: float) -> Callable[[], PeerCells]:
    import trimesh

    mesh = trimesh.Trimesh(geometry.vertices.numpy(), geometry.faces.numpy(), process=False)

    def run() -> PeerCells:
        return _of_trimesh(mesh.voxelized(cell).fill(), geometry, cell)

    return run


def _of_trimesh(found: Any, geometry: Geometry, cell: float) -> PeerCells:
    cells = np.asarray(found.sparse_indices)
    origin = np.asarray(found.transform)[:3, 3] - cell / 2  # its transform places the centres of cells
    return PeerCells(cells, _grid(origin, cell, cells, geometry))


def _open3d(geometry: Geometry, cell: float) -> Callable[[], PeerCells]:
    import open3d

    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(geometry.vertices.numpy()), open3d.utility.Vector3iVector(geometry.faces.numpy())
    )

    def run() -> PeerCells:
        found = open3d.geometry.VoxelGrid.create_from_triangle_mesh(mesh, cell)
        cells = np.asarray([v.grid_index for v in found.get_voxels()]).reshape(-1, 3)
        return PeerCells(cells, _grid(np.asarray(found.origin), cell, cells, geometry))

    return run


def _polydata(geometry: Geometry) -> Any:
    import pyvista

    return pyvista.PolyData.from_regular_faces(geometry.vertices.numpy(), geometry.faces.numpy())


def _pyvista(geometry: Geometry, cell: float) -> Callable[[], PeerCells]:
    """VTK's voxel modeller: cells of which the centre lies within half a diagonal of the surface."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    mesh = _polydata(geometry)
    low, high = geometry.bounds.numpy()
    counts = np.ceil((high - low) / cell).astype(int) + 2
    first = (low + high) / 2 - counts * cell / 2

    def run() -> PeerCells:
        modeller = vtk.vtkVoxelModeller()
        modeller.SetInputData(mesh)
        modeller.SetSampleDimensions(*(int(n) for n in counts))
        last = first + counts * cell
        modeller.SetModelBounds(first[0], last[0], first[1], last[1], first[2], last[2])
        modeller.SetScalarTypeToUnsignedChar()
        modeller.SetMaximumDistance(0.5 * 3**0.5 * cell / float((last - first).max()))
        modeller.Update()
        values = vtk_to_numpy(modeller.GetOutput().GetPointData().GetScalars()).reshape(counts[::-1])
        cells = np.argwhere(values > 0)[:, ::-1]
        spacing = np.array(modeller.GetOutput().GetSpacing())
        origin = np.array(modeller.GetOutput().GetOrigin()) - spacing / 2
        return PeerCells(cells, VoxelGrid(torch.from_numpy(origin)[None], torch.tensor([float(spacing.mean())]),
                                          tuple(int(n) for n in counts)))  # type: ignore[arg-type]  # fmt: skip

    return run


def _pyvista_solid(geometry: Geometry, cell: float) -> Callable[[], PeerCells]:
    import pyvista

    mesh = _polydata(geometry)
    low, high = geometry.bounds.numpy()
    counts = np.ceil((high - low) / cell).astype(int) + 2
    first = (low + high) / 2 - counts * cell / 2

    def run() -> PeerCells:
        reference = pyvista.ImageData(
            dimensions=tuple(int(n) for n in counts), spacing=(cell,) * 3, origin=tuple(first + cell / 2)
        )
        mask = mesh.voxelize_binary_mask(reference_volume=reference)
        values = np.asarray(mask.point_data["mask"]).reshape(counts[::-1])
        grid = VoxelGrid(torch.from_numpy(first)[None], torch.tensor([cell], dtype=torch.float64),
                         tuple(int(n) for n in counts))  # type: ignore[arg-type]  # fmt: skip
        return PeerCells(np.argwhere(values > 0)[:, ::-1], grid)

    return run
