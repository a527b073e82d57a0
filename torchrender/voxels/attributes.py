"""Multi-valued voxels: normal, colour, texture coordinate, material and density. Source: specification 05, section 6.

Values are kept for occupied cells only. A fragment is the part of one triangle in one cell; a cell's value is the mean
of its fragments, weighted by their areas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import check_finite, options_of
from torchrender.errors import InputError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.voxels.bits import count_runs
from torchrender.kernels.voxels.cells import Soup
from torchrender.kernels.voxels.fragments import visit, weigh
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.scene.triangles import check_scene
from torchrender.voxels.coverage import surface_alpha, surface_colors
from torchrender.voxels.grid import WORD, VoxelGrid, Voxels, empty_words, flat
from torchrender.voxels.mesh_arguments import mesh_arguments
from torchrender.voxels.surface import SurfaceOptions, checked_mesh, place, room, voxelize_surface

SHORT = 1e-6  # of a mean normal, below which the largest fragment's normal counts
SOLID = 1 / 8  # of the surface in a cell: with less of it, the cell lies in a hole
SEEN = 1 / 512  # opacity below which what blends is not there
LEAST_WEIGHT = 1e-12  # of a fragment that only touches its cell, squared cells


@dataclass(frozen=True, eq=False)
class SurfaceFragments:
    """The parts of triangles in the surface cells of one grid, cell after cell, in the order of triangles."""

    voxels: Voxels
    cells: Tensor  # (N,3) int64 i, j, k
    lengths: Tensor  # (N,) int64 fragments of each cell
    triangle: Tensor  # (M,) int64
    barycentric: Tensor  # (M,2) float64 weights of the second and third vertex
    weight: Tensor  # (M,) float64 area, squared cells

    __repr__ = brief

    def mean(self, values: Tensor) -> Tensor:
        """(N,K) float32 weighted means of fragment values (M,K)."""
        weight = self.weight.clamp_min(LEAST_WEIGHT)
        sums = self._sum(values.double() * weight[:, None])
        return (sums / self._sum(weight)[:, None]).float()

    def total_weight(self) -> Tensor:
        """(N,) float64 area in each cell, squared cells."""
        return self._sum(self.weight)

    def largest(self) -> Tensor:
        """(N,) int64 row of each cell's fragment with the largest area; the first of equals."""
        if not len(self.lengths):
            return self.lengths
        most = torch.segment_reduce(self.weight, "max", lengths=self.lengths)
        cell = torch.repeat_interleave(torch.arange(len(self.lengths)), self.lengths)
        rows = torch.arange(len(self.triangle)).flip(0)
        hit = (self.weight == most[cell]).flip(0)
        first = torch.zeros_like(self.lengths)
        first[cell.flip(0)[hit]] = rows[hit]
        return first

    def interpolate(self, corners: Tensor) -> Tensor:
        """(M,K) values at the fragments from values at the corners of their triangles (M,3,K)."""
        u, v = self.barycentric.unbind(-1)
        weights = torch.stack([1.0 - u - v, u, v], dim=-1)
        return (weights[..., None] * corners.double()).sum(dim=1)

    def corner_weights(self) -> Tensor:
        """(M,3) float64 weights of the corners of their triangles."""
        u, v = self.barycentric.unbind(-1)
        return torch.stack([1.0 - u - v, u, v], dim=-1)

    def thinned(self, alpha: Tensor, limit: Tensor) -> SurfaceFragments:
        """Fragments (M,) whose ``alpha`` is above ``limit``, with that share of their area; cells without any go."""
        keep = alpha > limit
        cell = torch.repeat_interleave(torch.arange(len(self.lengths)), self.lengths)
        lengths = torch.zeros_like(self.lengths).index_add_(
            0, cell[keep], torch.ones(int(keep.sum()), dtype=torch.int64)
        )
        filled = lengths > 0
        cells = self.cells[filled]
        words = empty_words(self.voxels.grid)
        i, j, k = cells.unbind(-1)
        # Every cell has a bit of its own, so that adding them sets them.
        words[0].index_put_((k, j, i // WORD), torch.ones(len(i), dtype=torch.int64) << (i % WORD), accumulate=True)
        return SurfaceFragments(
            Voxels(words, self.voxels.grid, self.voxels.stats),
            cells,
            lengths[filled],
            self.triangle[keep],
            self.barycentric[keep],
            self.weight[keep] * alpha[keep],
        )

    def _sum(self, values: Tensor) -> Tensor:
        if not len(self.lengths):
            return values.new_zeros(0, *values.shape[1:])
        return torch.segment_reduce(values.contiguous(), "sum", lengths=self.lengths, axis=0)


def surface_fragments(
    vertices: Tensor, faces: Tensor, grid: VoxelGrid, options: SurfaceOptions | None = None
) -> SurfaceFragments:
    """Fragments of one mesh (1,V,3) in the cells that ``voxelize_surface`` finds.

    ``conservative``: triangles clipped to the cell, so that the weights add up to the area of the surface. ``thin``:
    the point on the column's centre line, with the area |N|/|N_c| that it stands for.

    Raises:
        InputError: as in :func:`~torchrender.voxels.surface.voxelize_surface`, or more than one grid.
    """
    if len(grid) != 1:
        raise InputError(f"fragments are of one grid, got {len(grid)}")
    options = options_of(options, SurfaceOptions)
    points, triangles = checked_mesh(vertices, faces, grid)
    voxels = voxelize_surface(vertices, faces, grid, options)
    words, thin = flat(voxels.words[0]), options.mode == "thin"
    per_word = np.zeros(len(words), np.int64)
    count_runs(words, 1, per_word)
    before = np.cumsum(per_word) - per_word
    cells = voxels.cells()
    lengths = np.zeros(len(cells), np.int64)
    soup = Soup(points[0], triangles, *place(grid, 0), thin)
    where = (soup, room(grid), thread_count(), (words, before))
    visit(*where, lengths, np.zeros(0, np.int32), np.zeros(1, np.int64))
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(lengths)])
    found = np.zeros(starts[-1], np.int32)
    visit(*where, starts[:-1].copy(), found, np.zeros(1, np.int64))
    barycentric, weight = np.zeros((len(found), 2)), np.zeros(len(found))
    weigh(soup, cells.numpy(), starts, found, barycentric, weight)
    tensors = (torch.from_numpy(a) for a in (lengths, found.astype(np.int64), barycentric, weight))
    return SurfaceFragments(voxels, cells, *tensors)


@dataclass(frozen=True, eq=False)
class VoxelAttributes:
    """Mean attributes of the occupied cells of B grids."""

    voxels: Voxels
    cells: tuple[Tensor, ...]  # B times (N,3) int64 i, j, k
    values: tuple[Tensor, ...]  # B times (N,K) float32
    weight: tuple[Tensor, ...]  # B times (N,) float64 surface area, squared cells

    __repr__ = brief

    def dense(self) -> Tensor:
        """(B,nz,ny,nx,K) float32; zero in empty cells."""
        return torch.stack([spread(v, c, self.voxels.grid) for v, c in zip(self.values, self.cells, strict=True)])


def spread(values: Tensor, cells: Tensor, grid: VoxelGrid) -> Tensor:
    """(nz,ny,nx,...) with ``values`` (N,...) at ``cells`` (N,3), zero elsewhere."""
    nx, ny, nz = grid.dims
    out = values.new_zeros(nz, ny, nx, *values.shape[1:])
    i, j, k = cells.unbind(-1)
    out[k, j, i] = values
    return out


def voxelize_attributes(
    vertices: Tensor, faces: Tensor, attributes: Tensor, grid: VoxelGrid, options: SurfaceOptions | None = None
) -> VoxelAttributes:
    """Surface voxels with attributes interpolated from vertices (B,V,K) or from face corners (B,F,3,K).

    Raises:
        InputError: as in :func:`~torchrender.voxels.surface.voxelize_surface`; attributes of another shape or not
            finite.
    """
    shapes = {(len(grid), vertices.shape[-2]), (len(grid), faces.shape[0], 3)}
    if tuple(attributes.shape[:-1]) not in shapes:
        wanted = f"({len(grid)}, {vertices.shape[-2]}, K) or ({len(grid)}, {faces.shape[0]}, 3, K)"
        raise InputError(f"attributes must have shape {wanted}, got {tuple(attributes.shape)}")
    check_finite("attributes", attributes)
    parts, values = [], []
    for b in range(len(grid)):
        fragments = surface_fragments(vertices[b][None], faces, grid[b], options)
        own = attributes[b] if attributes.dim() == 4 else attributes[b][faces.long()]
        values.append(fragments.mean(fragments.interpolate(own[fragments.triangle])))
        parts.append(fragments)
    voxels = Voxels(torch.cat([f.voxels.words for f in parts]), grid)
    return VoxelAttributes(voxels, tuple(f.cells for f in parts), tuple(values), tuple(f.total_weight() for f in parts))


@dataclass(frozen=True, eq=False)
class SurfaceVoxels:
    """A scene's surface as voxels of one grid, N cells in the order of ``voxels.cells()``."""

    voxels: Voxels
    cells: Tensor  # (N,3) int64 i, j, k
    normal: Tensor  # (N,3) float32, unit length
    color: Tensor  # (N,3) float32 linear diffuse colour, textures included
    uv: Tensor  # (N,2) float32 texture coordinates, zero where the scene has none
    material: Tensor  # (N,) int64 of the largest fragment
    density: Tensor  # (N,) float32 surface area over the area of a cell's side, at most 1
    opacity: Tensor | None = None  # (N,) float32 mean opacity of what blends, which is in the density; None: all opaque

    __repr__ = brief

    @property
    def grid(self) -> VoxelGrid:
        """Where the cells lie."""
        return self.voxels.grid


def voxelize_scene(scene: Scene, grid: VoxelGrid | int, options: SurfaceOptions | None = None) -> SurfaceVoxels:
    """Surface voxels of a scene with normals, colours, texture coordinates, materials and densities.

    Normals that cancel leave that of the largest fragment. Holes of textures are empty: a cell counts where more than
    :data:`SOLID` of the surface in it is there. What blends counts with its opacity in the density.

    Args:
        grid: one grid; or a number, of cells along the longest side of the scene.

    Raises:
        InputError: no scene, or more than one grid.
    """
    geometry = check_scene("scene", scene).geometry
    vertices, faces, grid = mesh_arguments(scene, grid, None)
    fragments = surface_fragments(vertices, faces, grid, options)
    alpha = surface_alpha(scene, fragments.triangle, fragments.corner_weights(), float(grid.cell[0]))
    opacity = None
    if alpha is not None:
        limits = scene_limits(scene, fragments.triangle)
        kept = alpha[alpha > limits]
        fragments = fragments.thinned(alpha, limits)
        kept = torch.where(_holed(scene, fragments.triangle), 1.0, kept)  # holes are places, not panes
        opacity = 1.0 / fragments.mean(1.0 / kept[:, None])[:, 0]
    largest = fragments.largest()
    normals = _normals(geometry, fragments)
    normal = fragments.mean(normals)
    cancelled = normal.norm(dim=1) < SHORT
    normal[cancelled] = normals[largest[cancelled]].float()
    uv = _corners(geometry.uv, geometry, fragments)
    coordinates = torch.zeros(len(fragments.triangle), 2) if uv is None else fragments.interpolate(uv)
    return SurfaceVoxels(
        voxels=fragments.voxels,
        cells=fragments.cells,
        normal=torch.nn.functional.normalize(normal, dim=1, eps=1e-30),
        color=fragments.mean(
            surface_colors(scene, fragments.triangle, fragments.corner_weights(), float(grid.cell[0]))
        ),
        uv=fragments.mean(coordinates),
        material=geometry.material[fragments.triangle[largest]],
        density=fragments.total_weight().clamp_max(1.0).float(),
        opacity=opacity,
    )


def scene_limits(scene: Scene, triangle: Tensor) -> Tensor:
    """(M,) share of the surface below which fragments of these triangles are empty."""
    holed = _holed(scene, triangle)
    return torch.where(holed, SOLID, SEEN).double()


def _holed(scene: Scene, triangle: Tensor) -> Tensor:
    """(M,) whether triangles are of a material whose texture cuts holes."""
    holed = torch.tensor([m.alpha_cutoff is not None for m in scene.materials])
    return holed[scene.geometry.material[triangle]]


def _corners(values: Tensor | None, geometry: Geometry, fragments: SurfaceFragments) -> Tensor | None:
    """(M,3,K) vertex values at the corners of each fragment's triangle."""
    return None if values is None else values[geometry.faces[fragments.triangle].long()]


def _normals(geometry: Geometry, fragments: SurfaceFragments) -> Tensor:
    """(M,3) float64 shading normals, the face's own where there are none."""
    own = geometry.face_normals[fragments.triangle].double()
    corners = _corners(geometry.normals, geometry, fragments)
    if corners is None:
        return own
    smooth = fragments.interpolate(corners)
    length = smooth.norm(dim=1, keepdim=True)
    return torch.where(length > SHORT, smooth / length.clamp_min(SHORT), own)


def encode_normals(normals: Tensor) -> Tensor:
    """(N,2) uint8 of unit normals (N,3): octahedral, below 1 degree of error (specification 06, section 5)."""
    n = normals.double()
    n = n / n.abs().sum(dim=1, keepdim=True).clamp_min(1e-30)
    folded = (1.0 - n[:, [1, 0]].abs()) * torch.where(n[:, :2] < 0, -1.0, 1.0)
    square = torch.where(n[:, 2:] < 0, folded, n[:, :2])
    return ((square * 0.5 + 0.5) * 255.0 + 0.5).floor().clamp(0, 255).to(torch.uint8)


def decode_normals(codes: Tensor) -> Tensor:
    """(N,3) float32 unit normals that :func:`encode_normals` stored."""
    square = codes.double() / 255.0 * 2.0 - 1.0
    z = 1.0 - square.abs().sum(dim=1, keepdim=True)
    folded = (1.0 - square[:, [1, 0]].abs()) * torch.where(square < 0, -1.0, 1.0)
    return torch.nn.functional.normalize(torch.cat([torch.where(z < 0, folded, square), z], dim=1), dim=1).float()
