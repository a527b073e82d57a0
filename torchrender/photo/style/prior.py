"""What designers keep to: ceiling and walls light, floor in the middle, furniture darker (chapter 4, optional term)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.photo.style.objects import StyleObjects
from torchrender.photo.style.views import object_boxes
from torchrender.scene.model import Scene

CEILING, WALL, FLOOR, FURNITURE = range(4)
ROLES = ("ceiling", "wall", "floor", "furniture")
LIGHTNESS = ((80.0, 100.0), (70.0, 100.0), (40.0, 75.0), (0.0, 65.0))
"""Range of L that costs nothing, for each role."""
_SPAN = 0.5  # of the scene's width or depth that a wall, floor or ceiling covers
_EDGE = 0.12  # of the scene's size: how near its border it lies
_FLAT = 0.15  # of the scene's size: how thin it is at most


def roles(scene: Scene, objects: StyleObjects) -> Tensor:
    """(m,) int64 role of each object, from its box in that of the scene: CEILING, WALL, FLOOR or FURNITURE.

    Wide and flat at the top or the bottom: ceiling or floor; high, wide and thin at a side: wall.
    """
    low, high = scene.bounds
    size = (high - low).clamp_min(1e-12)
    boxes = (object_boxes(scene, objects) - low) / size
    first, last = boxes[:, 0], boxes[:, 1]
    extent = last - first
    wide = (extent[:, 0] >= _SPAN) & (extent[:, 2] >= _SPAN)
    flat = extent[:, 1] <= _FLAT
    out = torch.full((len(objects),), FURNITURE, dtype=torch.int64)
    for axis, other in ((0, 2), (2, 0)):
        thin = extent[:, axis] <= _FLAT
        border = (first[:, axis] <= _EDGE) | (last[:, axis] >= 1 - _EDGE)
        out[thin & border & (extent[:, 1] >= _SPAN) & (extent[:, other] >= _SPAN)] = WALL
    out[wide & flat & (first[:, 1] <= _EDGE)] = FLOOR
    out[wide & flat & (last[:, 1] >= 1 - _EDGE)] = CEILING
    return out


def prior_cost(role: Tensor, lightness: np.ndarray, weight: float) -> np.ndarray:
    """(m,C) ``weight excess / 100`` of mean lightness (m,C), L, outside the range of the object's role."""
    low, high = np.array(LIGHTNESS)[role.numpy()].T
    excess = np.maximum(low[:, None] - lightness, 0.0) + np.maximum(lightness - high[:, None], 0.0)
    return weight * excess / 100.0
