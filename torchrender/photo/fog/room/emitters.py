"""Light sources of a room as sets of small samples with an area each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.errors import InputError
from torchrender.photo.fog.room.calibrate import FACES


@dataclass(frozen=True, eq=False)
class Emitter:
    """A flat polygon that shines into the room, evenly and as a matt surface does."""

    corners: Tensor  # (m,3) float64
    normal: Tensor  # (3,) float64, into the room
    name: str
    pixels: tuple[tuple[float, float], ...]  # its marked polygon

    @property
    def area(self) -> float:
        """Square metres."""
        fan = self.corners[1:] - self.corners[0]
        cross = torch.linalg.cross(fan[:-1], fan[1:])
        return float((cross @ self.normal).sum().abs()) / 2

    @property
    def diameter(self) -> float:
        """Largest distance of two corners."""
        return float(torch.cdist(self.corners, self.corners).max())

    @property
    def centre(self) -> Tensor:
        """(3,) centre of its area."""
        fan = self.corners[1:] - self.corners[0]
        weight = torch.linalg.cross(fan[:-1], fan[1:]) @ self.normal
        thirds = (self.corners[0] * 3 + fan[:-1] + fan[1:]) / 3
        return (thirds * weight[:, None]).sum(dim=0) / weight.sum()

    def samples(self, per_side: int) -> tuple[Tensor, Tensor]:
        """Centres (S,3) and areas (S,) of the cells of a grid over the polygon, with what of each lies inside."""
        axis = int(self.normal.abs().argmax())
        a, b = (k for k in range(3) if k != axis)
        flat = self.corners[:, [a, b]]
        low, high = flat.amin(dim=0), flat.amax(dim=0)
        fine = 8
        count = per_side * fine
        shares = np.zeros((count, count), np.uint8)
        corners = ((flat - low) / (high - low).clamp_min(1e-12) * count * 16 - 8).round().int().numpy()
        cv2.fillPoly(shares, [corners.reshape(-1, 1, 2)], 1, lineType=cv2.LINE_8, shift=4)
        filled = torch.from_numpy(shares).double().reshape(per_side, fine, per_side, fine)
        if not bool((filled > 0).any()):
            return self.centre[None], torch.tensor([self.area])
        inside = filled.permute(0, 2, 1, 3).reshape(per_side * per_side, fine, fine)
        share = inside.sum(dim=(1, 2))
        cell = (torch.arange(fine) + 0.5) / fine
        v = (inside.sum(dim=2) @ cell.double()) / share.clamp_min(1e-12)
        u = (inside.sum(dim=1) @ cell.double()) / share.clamp_min(1e-12)
        row = torch.arange(per_side * per_side) // per_side
        column = torch.arange(per_side * per_side) % per_side
        kept = share > 0
        where = torch.stack([(column + u) / per_side, (row + v) / per_side], dim=1)[kept]
        places = self.centre.expand(int(kept.sum()), 3).clone()
        places[:, [a, b]] = low + where * (high - low)
        return places, self.area * share[kept] / share[kept].sum()


def emitter_of(corners: Tensor, wall: str, name: str, pixels: tuple[tuple[float, float], ...]) -> Emitter:
    """An emitter on a side of the room.

    Raises:
        InputError: no area, such as of a polygon seen edge on.
    """
    axis, side = FACES[wall]
    normal = torch.zeros(3, dtype=torch.float64)
    normal[axis] = -1.0 if side else 1.0
    made = Emitter(corners, normal, name, pixels)
    if not made.area > 1e-8 or not math.isfinite(made.area):
        raise InputError(f"{name} has no area on the {wall}: is it marked on another side?")
    return made


def patches_per_side(emitter: Emitter, kappa: float, limit: float) -> int:
    """Patches per side of a light, so that extinction times a patch's diameter is within the limit."""
    return max(1, min(8, math.ceil(kappa * emitter.diameter / limit - 1e-9)))
