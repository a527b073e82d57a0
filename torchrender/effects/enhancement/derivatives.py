"""Derivatives of shading along a surface, and of the surface along the picture.

Rows (N,...) of points; a gradient of a number is a row vector (N,3), of a vector field a matrix (N,3,3) whose entry
(i,j) is the derivative of component i along coordinate j. All are plain torch in the type of their arguments, and
differentiable. Source: specification 10, section 3.
"""

from __future__ import annotations

import torch
from torch import Tensor

TINY_AREA = 1e-12
"""Twice the area of a triangle, in squares of its longest side, below which it has no gradients."""


def _outer(a: Tensor, b: Tensor) -> Tensor:
    return a[..., :, None] * b[..., None, :]


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(dim=-1, keepdim=True)


def row_times(row: Tensor, matrix: Tensor) -> Tensor:
    """Row vectors (...,K) times matrices (...,K,J)."""
    return (row[..., None, :] @ matrix)[..., 0, :]


def projection_gradient(rays: Tensor, normals: Tensor, depth: Tensor, axes: Tensor, grazing: float = 0.05) -> Tensor:
    """How the seen point moves with the image point: (N,3,2) scene units per focal length.

    Args:
        rays: (N,3) from the eye, scaled to depth 1.
        normals: (N,3) of the faces, towards the eye.
        depth: (N,) along the camera's axis.
        axes: (2,3) the image's directions to the right and down, as the rays are given.
        grazing: the cosine between ray and normal counts as at least this much.

    The columns are tangent to the face. The form without division by a component of the normal is finite for every
    face but those seen exactly edge-on, which ``grazing`` takes care of.
    """
    facing = _dot(normals, rays)
    facing = -torch.maximum(-facing, grazing * rays.norm(dim=-1, keepdim=True))
    columns = [axis - rays * (_dot(normals, axis.expand_as(normals)) / facing) for axis in axes]
    return depth[..., None, None] * torch.stack(columns, dim=-1)


def barycentric_gradients(corners: Tensor) -> Tensor:
    """Gradients (F,3,3) of the three barycentric weights over triangles (F,3 corners,3); zero for degenerate ones."""
    a, b, c = corners.unbind(-2)
    cross = torch.linalg.cross(b - a, c - a)
    square = (cross * cross).sum(dim=-1, keepdim=True)
    longest = torch.stack([b - a, c - b, a - c]).square().sum(dim=-1).amax(dim=0)[..., None]
    degenerate = square.sqrt() <= TINY_AREA * longest
    scaled = cross / torch.where(degenerate, 1.0, square)
    rows = [torch.linalg.cross(scaled, side) for side in (c - b, a - c, b - a)]
    return torch.where(degenerate[..., None], 0.0, torch.stack(rows, dim=-2))


def normal_gradient(
    corner_normals: Tensor, weights: Tensor, gradients: Tensor, fallback: Tensor
) -> tuple[Tensor, Tensor]:
    """Unit interpolated normals (N,3) and their gradients (N,3,3).

    Args:
        corner_normals: (N,3 corners,3); weights: (N,3); gradients: (N,3,3) of the weights.
        fallback: (N,3) normals where those of the corners cancel out.
    """
    summed = (weights[..., None] * corner_normals).sum(dim=-2)
    slope = (corner_normals[..., :, :, None] * gradients[..., :, None, :]).sum(dim=-3)
    length = summed.norm(dim=-1, keepdim=True)
    gone = length <= 1e-6
    normal = torch.where(gone, fallback, summed / torch.where(gone, 1.0, length))
    across = slope - _outer(normal, row_times(normal, slope))
    return normal, torch.where(gone[..., None], 0.0, across / torch.where(gone, 1.0, length)[..., None])


def direction_gradient(directions: Tensor, distance: Tensor) -> Tensor:
    """Gradient (N,3,3) of the unit direction (N,3) to a fixed point at ``distance`` (N,); zero at infinity."""
    identity = torch.eye(3, dtype=directions.dtype)
    return -(identity - _outer(directions, directions)) / distance[..., None, None]


def cosine_gradient(normals: Tensor, to_light: Tensor, normal_slope: Tensor, light_slope: Tensor) -> Tensor:
    """Gradient (N,3) of ``max(n . w, 0)``; zero where the light is behind."""
    lit = _dot(normals, to_light) > 0
    return torch.where(lit, row_times(to_light, normal_slope) + row_times(normals, light_slope), 0.0)


def phong_gradient(
    normals: Tensor,
    to_light: Tensor,
    to_eye: Tensor,
    slopes: tuple[Tensor, Tensor, Tensor],
    exponent: Tensor,
) -> Tensor:
    """Gradient (N,3) of the Phong lobe ``max(r . w_o, 0)^exponent`` with ``r`` the mirrored light; zero if unlit.

    ``slopes`` are those of normal, direction to the light and direction to the eye; exponents (N,) are at least one.
    """
    normal_slope, light_slope, eye_slope = slopes
    cosine = _dot(normals, to_light)
    mirrored = 2.0 * cosine * normals - to_light
    turning = row_times(normals, light_slope) + row_times(to_light, normal_slope)
    mirrored_slope = 2.0 * (_outer(normals, turning) + cosine[..., None] * normal_slope) - light_slope
    along = _dot(mirrored, to_eye)
    lit = (cosine > 0) & (along > 0)
    factor = exponent[..., None] * torch.where(lit, along, 1.0) ** (exponent[..., None] - 1.0)
    change = row_times(mirrored, eye_slope) + row_times(to_eye, mirrored_slope)
    return torch.where(lit, factor * change, 0.0)


def smooth_step(distance: Tensor, sharpness: Tensor) -> Tensor:
    """Share of light (N,) at a signed distance from a shadow's edge: one on the lit side, where it is negative."""
    return torch.sigmoid(-2.0 * sharpness * distance)


def visibility_gradient(into_shadow: Tensor, distance: Tensor, sharpness: Tensor) -> Tensor:
    """Gradient (N,3) of :func:`smooth_step` along the unit direction ``into_shadow`` (N,3)."""
    share = smooth_step(distance, sharpness)
    return (-2.0 * sharpness * share * (1.0 - share))[..., None] * into_shadow


def irradiance_gradient(coefficients: Tensor, normals: Tensor) -> Tensor:
    """Derivative (N,3 channels,3) of order-2 harmonic irradiance along the normal (N,3).

    ``coefficients`` (9,3) of the radiance. Irradiance is a quadratic polynomial of the normal (Ramamoorthi and
    Hanrahan 2001); only its change across the sphere counts.
    """
    c = coefficients.to(normals.dtype) * DERIVATIVES.to(normals.dtype)[:, None]
    x, y, z = (v[..., None] for v in normals.unbind(-1))
    along_x = c[3] + y * c[4] + z * c[7] + x * c[8]
    along_y = c[1] + x * c[4] + z * c[5] - y * c[8]
    along_z = c[2] + y * c[5] + z * c[6] + x * c[7]
    slope = torch.stack([along_x, along_y, along_z], dim=-1)
    unit = normals[..., None, :]
    return slope - (slope * unit).sum(dim=-1, keepdim=True) * unit


_ZONAL = [0.0] + [2 * torch.pi / 3] * 3 + [torch.pi / 4] * 5
_CONSTANTS = [0.0] + [0.488603] * 3 + [1.092548, 1.092548, 6 * 0.315392, 1.092548, 1.092548]

DERIVATIVES = torch.tensor(_ZONAL, dtype=torch.float64) * torch.tensor(_CONSTANTS, dtype=torch.float64)
"""(9,) factor of each harmonic in the derivative of irradiance: zonal factor times that of its polynomial."""
