"""Which see-through surfaces lie before what a picture shows: pixels with the same ones may share their light."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import VisibilityBuffer
from torchrender.raster import camera_passes
from torchrender.scene.model import Scene

_MIX = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))
"""Shifts and factors of splitmix64 (Steele, Lea and Flood, 2014): sums of what it makes of numbers tell these apart."""


def panes_before(scene: Scene, seen: VisibilityBuffer) -> Tensor:
    """(B,H,W) int32 sums of random numbers of the see-through objects before what cameras see, one for each surface.

    Zero where there is none; equal where the same objects lie before it, and, but for one in 2^32, nowhere else.

    Args:
        seen: of solid surfaces, by perspective cameras.
    """
    geometry = scene.geometry
    found = torch.zeros(seen.triangle.shape, dtype=torch.int32)
    if geometry.see_through is None:
        return found
    worth = _mixed(view(geometry.object_id, np.int64))
    for k in range(len(seen.cameras)):
        one = VisibilityBuffer(
            cameras=seen.cameras[k],
            **{name: getattr(seen, name)[k : k + 1] for name in ("depth", "triangle", "object_id", "barycentric")},
        )
        with camera_passes(geometry.panes, one.cameras, "none") as passes:
            found[k] = passes.count_nearer(one, (0.0, 0.0), worth=worth)[0][0]
    return found


def _mixed(numbers: np.ndarray) -> np.ndarray:
    """(N,) int32 that look random of numbers (N,) int64, equal ones of equal numbers."""
    mixed = (numbers + 1).astype(np.uint64)
    for shift, factor in _MIX:
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    return mixed.astype(np.uint32).view(np.int32)


def told_apart(scene: Scene, seen: VisibilityBuffer) -> VisibilityBuffer:
    """What cameras see, with other object ids for the parts of an object that other see-through objects lie before.

    Light found for a pixel then serves others through the same panes alone. The ids are those of no mesh any more.
    """
    if scene.geometry.see_through is None:
        return seen
    before = panes_before(scene, seen).long()
    return VisibilityBuffer(
        cameras=seen.cameras,
        depth=seen.depth,
        triangle=seen.triangle,
        object_id=seen.object_id ^ (before << 32),
        barycentric=seen.barycentric,
    )
