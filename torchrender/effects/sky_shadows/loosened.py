"""Sets of spheres whose points stay together while a mesh bends.

A sphere fitted in rest may hold points of two limbs that lie close by; when these part, it would have to span both.
Points that do not go with the others are given to spheres that need to grow least for them in all poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.effects.sky_shadows.fit import SphereSet

STRETCH = 0.35
"""Change of the distance to a sphere's middle point, in its radius, up to which points go with it."""


def loosened(spheres: SphereSet, rest: Tensor, faces: Tensor, poses: Sequence[Tensor]) -> SphereSet:
    """The set with other spheres for points that part from their own in some of the poses (V,3).

    Radii stay: those of a pose follow from its points.
    """
    if not poses or not len(faces):
        return spheres
    count = len(rest)
    vertex = torch.stack([rest.double(), *(p.detach().double() for p in poses)])  # (T,V,3)
    points = torch.cat([vertex, vertex[:, faces.long()].mean(dim=2)], dim=1)
    labels = torch.cat([spheres.vertex_sphere, spheres.face_sphere]).clone()
    free = torch.ones(points.shape[1], dtype=torch.bool)
    free[:count] = False
    free[faces.reshape(-1).long()] = True
    leaders, loose = _leaders(spheres, points, labels, free)
    centres = points[:, leaders]  # where each sphere's leader goes
    number = torch.bincount(labels[free & ~loose], minlength=len(leaders))
    centres = torch.where((number > 0)[None, :, None], centres, torch.inf)
    for part in loose.nonzero().reshape(-1).split(512):
        away = (points[:, part, None] - centres[:, None]).norm(dim=-1)  # (T,part,S)
        growth = (away - spheres.radii[None, None]).amax(dim=0)
        labels[part] = growth.nan_to_num(posinf=1e300).argmin(dim=1)
    return replace(spheres, vertex_sphere=labels[:count], face_sphere=labels[count:])


def _leaders(spheres: SphereSet, points: Tensor, labels: Tensor, free: Tensor) -> tuple[Tensor, Tensor]:
    """The point (S,) of each sphere that most of its points go with, and the points (N,) bool that do not."""
    count = len(spheres.radii)
    leaders, loose = torch.zeros(count, dtype=torch.int64), torch.zeros(len(labels), dtype=torch.bool)
    for k in range(count):
        mine = (free & (labels == k)).nonzero().reshape(-1)
        if not len(mine):
            continue
        tried = mine[:: max(1, len(mine) // 16)]
        away = (points[:, mine, None] - points[:, None, tried]).norm(dim=-1)  # (T,M,tried)
        change = (away - away[:1]).abs().amax(dim=0) <= STRETCH * spheres.radii[k]
        near = (points[0, tried] - spheres.centres[k]).norm(dim=-1)
        score = change.sum(dim=0).double() - 1e-3 * near / spheres.radii[k].clamp_min(1e-300)
        best = int(score.argmax())
        leaders[k] = tried[best]
        loose[mine[~change[:, best]]] = True
    return leaders, loose
