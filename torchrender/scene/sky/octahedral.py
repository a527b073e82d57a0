"""Functions on the sphere as square images: the octahedral map.

The sphere is projected onto an octahedron, whose lower half is folded out to a square (Cigolle et al., *A survey of
efficient representations for independent unit vectors*, 2014). Images hold values at nodes that include the square's
border, where the folded edges meet: each is one direction, so that interpolation is continuous everywhere.
"""

from __future__ import annotations

import torch
from torch import Tensor


def square_from_direction(directions: Tensor) -> Tensor:
    """Places (...,2) in [0,1]^2 of directions (...,3) of any length but zero; +y is the middle."""
    size = directions.abs().sum(dim=-1, keepdim=True).clamp_min(1e-30)
    x, y, z = (directions / size).unbind(-1)
    folded_x = torch.copysign(1.0 - z.abs(), x)
    folded_z = torch.copysign(1.0 - x.abs(), z)
    flat = torch.stack([torch.where(y < 0, folded_x, x), torch.where(y < 0, folded_z, z)], dim=-1)
    return (0.5 * flat + 0.5).clamp(0.0, 1.0)


def direction_from_square(square: Tensor) -> Tensor:
    """Unit directions (...,3) of places (...,2) in [0,1]^2."""
    x, z = (2.0 * square - 1.0).unbind(-1)
    y = 1.0 - x.abs() - z.abs()
    fold = (-y).clamp_min(0.0)
    folded = torch.stack([x - torch.copysign(fold, x), y, z - torch.copysign(fold, z)], dim=-1)
    return torch.nn.functional.normalize(folded, dim=-1)


def node_directions(size: int) -> Tensor:
    """(N,N,3) float32 unit directions of the nodes of an image; columns go along x, rows along z."""
    steps = torch.linspace(0.0, 1.0, size, dtype=torch.float64)
    square = torch.stack([steps.expand(size, size), steps[:, None].expand(size, size)], dim=-1)
    return direction_from_square(square).float()


def interpolate_nodes(image: Tensor, directions: Tensor) -> Tensor:
    """Values (...,C) of an image of nodes (N,N,C) in directions (...,3): bilinear; differentiable in both."""
    size = image.shape[0]
    scaled = square_from_direction(directions) * (size - 1)
    index = scaled.detach().long().clamp(0, size - 2)
    (column, row), (i, j) = (scaled - index).unbind(-1), index.unbind(-1)
    column, row, flat = column[..., None], row[..., None], image.reshape(size * size, -1)
    first = j * size + i
    upper = torch.lerp(flat[first], flat[first + 1], column)
    lower = torch.lerp(flat[first + size], flat[first + size + 1], column)
    return torch.lerp(upper, lower, row)
