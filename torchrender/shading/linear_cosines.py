"""What a glossy surface mirrors of a polygon of constant radiance: linearly transformed cosines.

The lobe of GGX facets is taken as a clamped cosine under a linear transformation, whose inverse carries the polygon to
where Lambert's formula gives the share of the lobe that it fills (Heitz, Dupuy, Hill and Neubelt, *Real-time
polygonal-light shading with linearly transformed cosines*, 2016). The transformations are fitted by
:mod:`torchrender.tuning.linear_cosines` and kept in a file.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchrender.numerics.ggx import SMOOTHEST
from torchrender.numerics.lobe import frame
from torchrender.numerics.lobe_albedo import look_up
from torchrender.numerics.polygon_light import seen_polygon

SIZE = 32
"""Entries per axis."""
SMOOTHEST_ROW = 0.02
"""Roughness of the first row, which would be a perfect mirror."""
LEVEL_RAY = 1e-3
"""Least cosine between a ray and the plane that it meets."""
SHIPPED = Path(__file__).parents[1] / "data" / "linear_cosines.npy"


@cache
def linear_cosines() -> Tensor:
    """(S,S,5) float32 a, b, c, d, e, not to be written to; s is the sine to the eye.

    Row = roughness times S - 1, column = root of the cosine to the eye times S - 1. In the frame of the mirrored
    direction (third axis) and of the plane of eye and normal (first and third), the lobe is the cosine about the third
    axis under ``[[a, 0, s b], [0, c, 0], [s d, 0, e]]``.
    """
    with torch.inference_mode(False):
        return torch.from_numpy(np.load(SHIPPED))


@cache
def filled_up() -> Tensor:
    """(S,S,8) the table, its entries filled up with zeros: the kernel reads four numbers at once."""
    with torch.inference_mode(False):
        return torch.nn.functional.pad(linear_cosines(), (0, 3))


def nearest_point(to_corner: Tensor, mirrored: Tensor) -> Tensor:
    """Unit directions (3,N) to the points of parallelograms, with corners at (4,3,N), next to unit rays (3,N).

    Where a ray meets the parallelogram's plane, moved into it along its edges (as Karis' representative points, *Real
    shading in Unreal Engine 4*, 2013); rays that leave its lit side count as almost along it.
    """
    u, v = to_corner[1] - to_corner[0], to_corner[3] - to_corner[0]
    middle = to_corner[0] + 0.5 * (u + v)
    flat = torch.linalg.cross(u, v, dim=0)
    area = flat.square().sum(0).sqrt().clamp_min(1e-30)
    flat = flat / area
    along = (flat * middle).sum(0) / (flat * mirrored).sum(0).clamp_max(-LEVEL_RAY)
    offset = along * mirrored - middle
    p = (offset * torch.linalg.cross(v, flat, dim=0)).sum(0) / area
    q = (offset * torch.linalg.cross(flat, u, dim=0)).sum(0) / area
    return torch.nn.functional.normalize(middle + p.clamp(-0.5, 0.5) * u + q.clamp(-0.5, 0.5) * v, dim=0)


def mirrored_share(to_corner: Tensor, normal: Tensor, to_eye: Tensor, roughness: Tensor) -> Tensor:
    """Share (N,) in [0,1] of the GGX lobe that a convex polygon fills, whose corners lie at (K,3,N) from the points.

    Args:
        normal, to_eye: (3,N) unit; an eye below the surface counts as in its plane.
        roughness: (N,) taken as at least :data:`torchrender.numerics.ggx.SMOOTHEST`.

    Only the part of the lobe above the surface counts, so that a polygon over all of the sky fills it. Differentiable.
    """
    cosine = (normal * to_eye).sum(0).clamp(1e-4, 1.0 - 1e-7)
    sine = (1.0 - cosine * cosine).sqrt()
    a, b, c, d, e = look_up(linear_cosines().to(cosine.dtype), cosine, roughness.clamp_min(SMOOTHEST)).unbind(-1)
    b, d = sine * b, sine * d
    level = to_eye - (normal * to_eye).sum(0) * normal
    length = level.square().sum(0)
    upright = length < 1e-12  # the lobe is round there: any direction will do
    level = torch.where(upright, frame(normal.T)[0].T, level / torch.where(upright, 1.0, length).sqrt())
    across, along = sine * normal + cosine * level, cosine * normal - sine * level
    x, z = (to_corner * across).sum(1), (to_corner * along).sum(1)
    y = (to_corner * torch.linalg.cross(normal, level, dim=0)).sum(1)
    size = a * e - b * d
    moved = torch.stack([e * x - b * z, size / c * y, a * z - d * x], dim=1)
    up = torch.zeros_like(normal)
    up[2] = 1.0
    filled = seen_polygon(moved, moved.roll(-1, 0) - moved, up) / torch.pi
    # The plane of the surface, carried along, cuts the cosine lobe: what lies above it is a lune.
    tilt, height = a * sine + d * cosine, b * sine + e * cosine
    above = 0.5 * (1.0 + height / (tilt * tilt + height * height).sqrt().clamp_min(1e-12))
    return (filled / above.clamp_min(1e-3)).clamp_max(1.0)
