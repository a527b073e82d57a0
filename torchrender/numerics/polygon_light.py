"""Irradiance from a polygon of constant radiance, in closed form."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.checks import check_tensor


def polygon_irradiance(corners: Tensor, positions: Tensor, normals: Tensor) -> Tensor:
    """Irradiance (N,) at ``positions`` (3,N) with unit ``normals`` (3,N) from a convex polygon (K,3) of radiance one.

    Lambert's formula on the part of the polygon above the horizon: ``E = 1/2 sum_k theta_k (g_k . n)``, where edge k
    is seen under the angle ``theta_k`` and ``g_k`` is the unit normal of the plane through it and the receiver
    (Lambert 1760; Baum, Rushmeier and Winget, *Improving radiosity solutions through the use of analytically
    determined form-factors*, 1989). The sign is dropped: both sides of the polygon count. A receiver on the polygon
    or in its plane gives a finite value.

    Angles come from ``atan2`` and cross products use edge vectors, so that the relative error is about the rounding
    unit divided by the angle under which the polygon is seen.
    """
    check_tensor("corners", corners, ("K", 3))
    check_tensor("positions", positions, (3, "N"))
    check_tensor("normals", normals, (3, "N"))
    return seen_polygon(corners[:, :, None] - positions, (corners.roll(-1, 0) - corners)[:, :, None], normals)


def seen_polygon(to_corner: Tensor, edges: Tensor, normals: Tensor) -> Tensor:
    """The same for corners (K,3,N) as seen from the points, and edges (K,3,N) or (K,3,1) from each to the next."""
    height = (to_corner * normals).sum(1)  # (K,N) above the horizon
    after = height.roll(-1, 0)
    drop = height - after
    crosses = (height > 0) != (after > 0)
    # Where the edge meets the horizon, as a parameter along the edge; only read where it does.
    meet = torch.where(crosses, height / torch.where(crosses, drop, 1.0), 0.0).clamp(0.0, 1.0)
    rises, sinks = crosses & (after > 0), crosses & (height > 0)
    begin = torch.where(rises, meet, 0.0)
    end = torch.where(sinks, meet, torch.where((after > 0) | (height > 0), 1.0, 0.0))
    span = (end - begin)[:, None]

    first = to_corner + begin[:, None] * edges
    last = to_corner + end[:, None] * edges
    normal = torch.linalg.cross(to_corner, edges.expand_as(to_corner), dim=1)
    sine = normal.square().sum(1).sqrt()
    angle = torch.atan2(span[:, 0] * sine, (first * last).sum(1))
    facing = (normal * normals).sum(1)
    total = torch.where(sine > 0, facing / torch.where(sine > 0, sine, 1.0), 0.0) * torch.where(
        span[:, 0] > 0, angle, 0.0
    )
    return 0.5 * (total.sum(0) + _closing_edge(first, last, rises, sinks, normals)).abs()


def _closing_edge(first: Tensor, last: Tensor, rises: Tensor, sinks: Tensor, normals: Tensor) -> Tensor:
    """Share (N,) of the edge along the horizon, from where the polygon sinks below it to where it rises again."""
    leave = torch.where(sinks[:, None], last, 0.0).sum(0)
    enter = torch.where(rises[:, None], first, 0.0).sum(0)
    turn = (torch.linalg.cross(leave, enter, dim=0) * normals).sum(0)
    # Both points lie in the horizon plane, so their plane's normal is plus or minus the receiver's normal.
    return torch.atan2(turn, (leave * enter).sum(0))
