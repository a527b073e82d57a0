"""How often a surface winds about a point: 1 inside a closed mesh whose triangles face outwards, 0 outside."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def winding_number(corners: Tensor, points: Tensor) -> Tensor:
    """Generalised winding number (N,) of triangles (F,3,3) about points (N,3): the sum of their signed solid angles.

    Triangles that are seen edge-on, or hold the point, count nothing. Sources: Jacobson et al. 2013; Van Oosterom and
    Strackee 1983.
    """
    total = torch.zeros(len(points), dtype=torch.float64)
    for number, point in enumerate(points.double()):
        a, b, c = (corners.double() - point).unbind(1)
        la, lb, lc = a.norm(dim=-1), b.norm(dim=-1), c.norm(dim=-1)
        volume = (a * torch.linalg.cross(b, c)).sum(-1)
        rest = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        angle = torch.where(volume == 0, 0.0, 2.0 * torch.atan2(volume, rest))
        total[number] = angle.sum() / (4.0 * math.pi)
    return total
