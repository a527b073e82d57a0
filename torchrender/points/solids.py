"""Points as small solids of triangles, where only triangles can be drawn."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.points.cloud import PointCloud
from torchrender.scene.mesh import Mesh

MAX_POINTS = 400_000
"""More are thinned out evenly: eight triangles each."""
_CORNERS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_FACES = ((0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5))
SHARE = 0.7
"""Of a point's radius, which is that of a disc that overlaps its neighbours."""
GREY = 0.7


def point_mesh(cloud: PointCloud, *, material: int = 0, max_points: int = MAX_POINTS) -> Mesh:
    """A mesh with an octahedron for every point, in the point's colour; radii that are not known are estimated.

    Args:
        material: index into the scene's materials; white keeps the points' colours.
        max_points: of more points every n-th is taken, and made as much larger.
    """
    count = len(cloud.position)
    step = -(-count // max_points)
    position, radius = cloud.position[::step], _radii(cloud)
    size = SHARE * step**0.5 * radius[::step].double()
    kept = len(position)
    corners = torch.tensor(_CORNERS, dtype=torch.float64)
    vertices = (position[:, None] + size[:, None, None] * corners).reshape(-1, 3)
    faces = (6 * torch.arange(kept)[:, None, None] + torch.tensor(_FACES)).reshape(-1, 3)
    color = torch.full((count, 3), GREY) if cloud.color is None else cloud.color
    colors = color[::step].repeat_interleave(6, dim=0).clamp(min=0.0)
    return Mesh(vertices=vertices, faces=faces, colors=colors, material=material, name=cloud.name)


def _radii(cloud: PointCloud) -> Tensor:
    """(P,) of each point; of 3D Gaussians the mean standard deviation."""
    if cloud.spread is not None:
        return (cloud.spread.diagonal(dim1=-2, dim2=-1).sum(-1) / 3).sqrt()
    upright = torch.tensor([0.0, 1.0, 0.0]).expand(len(cloud.position), 3)
    radius = replace(cloud, normal=upright).completed().radius  # no normals to estimate
    assert radius is not None
    return radius
