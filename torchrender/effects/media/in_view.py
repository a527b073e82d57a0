"""Whether media show in pictures, and how much of these they fill: what a plan asks before anything is drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, RectLight
from torchrender.scene.medium import Medium

SAMPLES = (12, 16)
"""Rows and columns of rays that tell the share of a picture."""


def boxes_of(media: Sequence[Medium]) -> Tensor:
    """(M,2,3) float64 corners of the media that are not empty."""
    boxes = [torch.stack([m.low.double(), m.high.double()]) for m in media if not m.is_empty]
    return torch.stack(boxes) if boxes else torch.zeros(0, 2, 3, dtype=torch.float64)


def boxes_in_view(boxes: Tensor, cameras: Cameras) -> Tensor:
    """(M,) bool: a box (M,2,3) may reach into what one of the cameras sees; before the near plane counts, too."""
    seen = torch.zeros(len(boxes), dtype=torch.bool)
    for planes in cameras.frustum_planes():
        sides = planes[[0, 1, 2, 3, 5]]
        if not cameras.orthographic:  # from the eye on
            behind = planes[4].clone()
            behind[3] = behind[3] + float(cameras.near.max())
            sides = torch.cat([sides, behind[None]])
        centre, half = boxes.mean(1), (boxes[:, 1] - boxes[:, 0]) / 2
        reach = centre @ sides[:, :3].T + sides[:, 3] + half @ sides[:, :3].abs().T
        seen |= (reach >= 0).all(dim=1)
    return seen


def shadowed_by(boxes: Tensor, lights: Sequence[Light], size: float) -> Tensor:
    """(M',2,3) boxes around what media could keep light from, each with each light.

    Args:
        size: diagonal of the scene: nothing is farther away.
    """
    made = []
    corner = torch.cartesian_prod(*[torch.tensor([0, 1])] * 3)
    for box in boxes:
        corners = box[corner, torch.arange(3)]
        reach = size + float((box[1] - box[0]).norm())
        for light in lights:
            if isinstance(light, DirectionalLight):
                away = light.direction.double() * reach
            else:
                place = (light.centre if isinstance(light, RectLight) else light.position).double()
                if bool(((place >= box[0]) & (place <= box[1])).all()):
                    away = torch.cat([-torch.ones(1, 3), torch.ones(1, 3)]).double()[:, None] * reach
                else:
                    off = corners - place
                    away = off / off.norm(dim=1, keepdim=True).clamp_min(1e-300) * reach
            reached = torch.cat([corners, (corners + away).reshape(-1, 3)])
            made.append(torch.stack([reached.amin(0), reached.amax(0)]))
    return torch.stack(made) if made else torch.zeros(0, 2, 3, dtype=torch.float64)


def share_of_view(boxes: Tensor, cameras: Cameras) -> float:
    """About which share of the pictures' rays a box (M,2,3) lies on, in [0,1]."""
    if not len(boxes) or not len(cameras):
        return 0.0
    rows, columns = SAMPLES
    v = (torch.arange(rows, dtype=torch.float64) + 0.5) / rows * cameras.height
    u = (torch.arange(columns, dtype=torch.float64) + 0.5) / columns * cameras.width
    pixels = torch.stack(torch.meshgrid(u, v, indexing="xy"), dim=-1).expand(len(cameras), rows, columns, 2)
    origin, direction = (t.reshape(-1, 1, 3) for t in cameras.rays(pixels))
    safe = torch.copysign(direction.abs().clamp_min(1e-12), direction)
    a, b = (boxes[:, 0] - origin) / safe, (boxes[:, 1] - origin) / safe
    begin, end = torch.minimum(a, b).amax(-1).clamp_min(0.0), torch.maximum(a, b).amin(-1)
    share = float((end > begin).any(dim=1).double().mean())
    return share if math.isfinite(share) else 1.0
