"""Points as triangles, where only triangles can be drawn: discs along normals, small solids where none is known."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.points.cloud import PointCloud
from torchrender.scene.mesh import Mesh

MAX_POINTS = 400_000
"""More are thinned out evenly: four triangles each, eight where no normal is known."""
_HEXAGON = ((1.0, 0.0), (0.5, 0.75**0.5), (-0.5, 0.75**0.5), (-1.0, 0.0), (-0.5, -(0.75**0.5)), (0.5, -(0.75**0.5)))
_FAN = ((0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5))
_CORNERS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_FACES = ((0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5))
SHARE = 0.7
"""Of a point's radius, for a solid: the radius is that of a disc that overlaps its neighbours."""
GREY = 0.7


def point_mesh(cloud: PointCloud, *, material: int = 0, max_points: int = MAX_POINTS) -> Mesh:
    """A mesh with a hexagon across the normal of every point, in the point's colour; it faces where the normal points.

    3D Gaussians and points without a normal give octahedra. Radii that are not known are estimated.

    Args:
        material: index into the scene's materials; white keeps the points' colours.
        max_points: of more points every n-th is taken, and made as much larger.
    """
    count = len(cloud.position)
    step = -(-count // max_points)
    position = cloud.position[::step]
    radius = (step**0.5 * _radii(cloud)[::step].double())[:, None, None]
    known = cloud.normal if cloud.spread is None else None
    normal = torch.zeros(len(position), 3) if known is None else known[::step]
    flat = (normal != 0).any(dim=1)
    along, across = _axes(normal.double())
    hexagon = torch.tensor(_HEXAGON, dtype=torch.float64)[None]
    disc = hexagon[..., :1] * along[:, None] + hexagon[..., 1:] * across[:, None]
    solid = SHARE * torch.tensor(_CORNERS, dtype=torch.float64)
    offset = radius * torch.where(flat[:, None, None], disc, solid)
    first = 6 * torch.arange(len(position))[:, None, None]
    faces = ((first + torch.tensor(_FAN))[flat], (first + torch.tensor(_FACES))[~flat])
    color = torch.full((count, 3), GREY) if cloud.color is None else cloud.color
    return Mesh(
        vertices=(position[:, None] + offset).reshape(-1, 3),
        faces=torch.cat([part.reshape(-1, 3) for part in faces]),
        colors=color[::step].repeat_interleave(6, dim=0).clamp(min=0.0),
        material=material,
        name=cloud.name,
    )


def _axes(normal: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors (P,3) that form a right-handed frame with each normal: a turn about it is from one to the other.

    Duff and others, Building an orthonormal basis, revisited, JCGT 2017.
    """
    x, y, z = normal.unbind(dim=1)
    sign = torch.where(z < 0, -1.0, 1.0).double()
    scale = -1.0 / (sign + z)
    mixed = x * y * scale
    along = torch.stack([1.0 + sign * x * x * scale, sign * mixed, -sign * x], dim=1)
    return along, torch.stack([mixed, sign + y * y * scale, -y], dim=1)


def _radii(cloud: PointCloud) -> Tensor:
    """(P,) of each point; of 3D Gaussians the mean standard deviation."""
    if cloud.spread is not None:
        return (cloud.spread.diagonal(dim1=-2, dim2=-1).sum(-1) / 3).sqrt()
    upright = torch.tensor([0.0, 1.0, 0.0]).expand(len(cloud.position), 3)
    radius = replace(cloud, normal=upright).completed().radius  # no normals to estimate
    assert radius is not None
    return radius
