"""Curvature as the shape descriptor of enhancement: of mesh vertices, or of whatever a picture shows.

``k = trace(grad h) / 3``, two thirds of the mean curvature; positive where the surface is convex. Source:
specification 10, section 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_tensor
from torchrender.effects.enhancement.derivatives import barycentric_gradients
from torchrender.kernels.enhancement.curvature import vertex_curvature as curvature_kernel
from torchrender.scene.mesh import Geometry

PERCENTILE = 0.95
"""Share of the surface whose curvature stays below the limit beta, where none is given."""

FLAT = 1e-3
"""Limits below one over a thousand sizes of a mesh, or distances of a picture, are rounding of what is flat."""


def face_curvature(corners: Tensor, corner_normals: Tensor) -> Tensor:
    """``k`` (F,) of triangles (F,3,3) with vertex normals (F,3,3); zero for degenerate ones."""
    return (corner_normals * barycentric_gradients(corners)).sum(dim=(-2, -1)) / 3.0


def vertex_curvature(vertices: Tensor, faces: Tensor, normals: Tensor) -> Tensor:
    """``k`` (V,) in 1/unit: area-weighted mean over the faces around each vertex; 0 for vertices without faces.

    Args:
        vertices: (V,3); faces: (F,3) integers; normals: (V,3) of the vertices, outwards.

    Differentiable in vertices and normals. Normals that stand on every face alone give zero.

    Raises:
        InputError: shapes that do not fit.
    """
    check_tensor("vertices", vertices, ("V", 3))
    check_tensor("faces", faces, ("F", 3))
    check_tensor("normals", normals, (len(vertices), 3))
    if vertices.requires_grad or normals.requires_grad:
        return _differentiable(vertices, faces.long(), normals)
    out = np.zeros(len(vertices))
    views = view(vertices, np.float64), view(faces, np.int32), view(normals, np.float32)
    curvature_kernel(*views, np.zeros((len(vertices), 2)), out)
    return torch.from_numpy(out).to(vertices.dtype)


def _differentiable(vertices: Tensor, faces: Tensor, normals: Tensor) -> Tensor:
    corners = vertices[faces]
    area = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=-1)
    bend = area * face_curvature(corners, normals.to(vertices.dtype)[faces])
    zero = torch.zeros(len(vertices), dtype=vertices.dtype)
    around = faces.reshape(-1)
    total = zero.index_add(0, around, bend.repeat_interleave(3))
    weight = zero.index_add(0, around, area.repeat_interleave(3))
    return torch.where(weight > 0, total / torch.where(weight > 0, weight, 1.0), 0.0)


@dataclass(frozen=True, eq=False)
class MeshCurvature:
    """Curvature of all vertices of a scene, as a share of the limit of their mesh."""

    relative: Tensor  # (V,) float32 k / beta
    smooth: Tensor  # (V,) bool: the vertex has a normal of its own; without one the mesh says nothing about curvature

    def smooth_faces(self, geometry: Geometry) -> Tensor:
        """(F,) bool: all three vertices have normals."""
        if not len(geometry.faces):
            return torch.zeros(1, dtype=torch.bool)
        return self.smooth[geometry.faces.long()].all(dim=1)


def mesh_curvature(geometry: Geometry, limit: float | None = None, *, centred: bool = False) -> MeshCurvature:
    """Curvature relative to ``limit`` (beta, 1/unit), or to the 95th percentile of each mesh.

    ``centred``: the median of each mesh is taken away first.
    """
    count = len(geometry.vertices)
    if geometry.normals is None or not count:
        return MeshCurvature(torch.zeros(count), torch.zeros(count, dtype=torch.bool))
    curvature = vertex_curvature(geometry.vertices, geometry.faces, geometry.normals).float()
    smooth = geometry.normals.abs().amax(dim=1) > 0
    if limit is not None and not centred:
        return MeshCurvature(relative_to(curvature, limit), smooth)
    relative = torch.zeros(count)
    for first, end in _vertex_runs(geometry):
        part = curvature[first:end]
        part = part - part.median() if centred else part
        low, high = geometry.vertices[first:end].aminmax(dim=0)
        beta = usual_limit(part, float((high - low).norm())) if limit is None else limit
        relative[first:end] = relative_to(part, beta)
    return MeshCurvature(relative, smooth)


def _vertex_runs(geometry: Geometry) -> list[tuple[int, int]]:
    """Vertices of each mesh; they stand together in the order of the meshes."""
    runs = geometry.runs.tolist()
    ends, end = [], 0
    for first, last in pairwise(runs):
        if last > first:
            low, high = geometry.faces[first:last].aminmax()
            if int(low) >= end:
                ends.append((int(low), int(high) + 1))
                end = int(high) + 1
            else:  # meshes that share vertices have one limit
                ends[-1] = (min(ends[-1][0], int(low)), max(end, int(high) + 1))
                end = ends[-1][1]
    return ends


def usual_limit(curvature: Tensor, extent: float) -> float:
    """95th percentile of the size of curvatures that are not zero; 0 if all are, or if that is flat for the extent."""
    size = curvature.abs().reshape(-1)
    size = size[size > 0]
    if not size.numel():
        return 0.0
    limit = float(size.kthvalue(min(int(PERCENTILE * size.numel()) + 1, size.numel())).values)
    return limit if limit * extent > FLAT else 0.0


def relative_to(curvature: Tensor, limit: float) -> Tensor:
    """``k / beta``; zero everywhere where the limit is: a flat surface has nothing to enhance."""
    return curvature / limit if limit > 0 else torch.zeros_like(curvature)


def strength(relative: Tensor, exponent: float = 1.0) -> Tensor:
    """``S`` in [-1,1] of curvatures relative to the limit: odd, and one from the limit on."""
    size = relative.abs().clamp(max=1.0)
    shaped = size if exponent == 1.0 else torch.where(size > 0, size.clamp_min(1e-30) ** exponent, 0.0)
    return relative.sign() * shaped


def picture_curvature(normals: Tensor, moves: Tensor, depth: Tensor, tolerance: float = 0.02) -> Tensor:
    """``k`` (B,H,W) in 1/unit of whatever a picture shows, from how its normals turn; 0 at edges of depth.

    Args:
        normals: (B,H,W,3) unit, towards the eye; 0 where nothing is.
        moves: (B,H,W,3,2) how the seen point moves per pixel to the right and down
            (:func:`~torchrender.effects.enhancement.derivatives.projection_gradient` over the focal lengths).
        depth: (B,H,W) camera z, +inf where nothing is.
        tolerance: a pixel is on an edge if a neighbour's depth is off its tangent plane by more than this share.
    """
    from kornia.filters import spatial_gradient  # a second to import: not for those who do not ask for it

    slope = spatial_gradient(normals.permute(0, 3, 1, 2), mode="sobel", order=1)  # (B,3,2,H,W)
    slope = slope.permute(0, 3, 4, 1, 2).to(moves.dtype)  # (B,H,W,3,2)
    # trace(grad n): the change of the normal along the surface, by the pseudo-inverse of the moves.
    metric = moves.transpose(-1, -2) @ moves
    a, b, d = metric[..., 0, 0], metric[..., 0, 1], metric[..., 1, 1]
    determinant = a * d - b * b
    turn = moves.transpose(-1, -2) @ slope  # (B,H,W,2,2)
    trace = d * turn[..., 0, 0] - b * (turn[..., 0, 1] + turn[..., 1, 0]) + a * turn[..., 1, 1]
    inside = smooth_inside(depth, tolerance) & (determinant > 1e-30)
    return torch.where(inside, trace / torch.where(inside, determinant, 1.0), 0.0).to(normals.dtype) / 3.0


def smooth_inside(depth: Tensor, tolerance: float) -> Tensor:
    """(B,H,W) bool: inverse depth goes on in all four directions as a plane's would: no silhouette is near."""
    nearness = torch.where(torch.isfinite(depth) & (depth > 0), 1.0 / depth.clamp_min(1e-30), 0.0)
    padded = torch.nn.functional.pad(nearness[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    inside = nearness > 0
    centre = padded[:, 1:-1, 1:-1]
    for before, after in (
        (padded[:, 1:-1, :-2], padded[:, 1:-1, 2:]),
        (padded[:, :-2, 1:-1], padded[:, 2:, 1:-1]),
    ):
        bend = (before + after - 2.0 * centre).abs()
        inside &= (before > 0) & (after > 0) & (bend <= tolerance * centre)
    return inside
