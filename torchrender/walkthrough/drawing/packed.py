"""A walkthrough as the kernels read it, made once."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from torchrender.kernels.walkthrough import splat
from torchrender.walkthrough.drawing.culling import Occluders
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.model import Walkthrough


@dataclass(frozen=True, eq=False)
class Packed:
    """Arrays that do not depend on the camera."""

    points: splat.Points
    origin: Array  # (3,) world position that the points are relative to
    plane_of: Array  # (F,) int64 patch of each triangle
    frames: Array  # (P,3,3) columns: texel column, texel row, origin
    occluders: Occluders
    diagonal: float


_PACKED: WeakKeyDictionary[Walkthrough, Packed] = WeakKeyDictionary()


def packed(walkthrough: Walkthrough) -> Packed:
    """The arrays of a walkthrough; the same ones for as long as it lives."""
    held = _PACKED.get(walkthrough)
    if held is None:
        held = _PACKED[walkthrough] = _pack(walkthrough)
    return held


def _pack(walkthrough: Walkthrough) -> Packed:
    p, planes = walkthrough.points, walkthrough.planes
    origin = 0.5 * (p.position.min(0) + p.position.max(0)) if len(p) else np.zeros(3)
    points = splat.Points(
        position=np.ascontiguousarray(p.position - origin, np.float32),
        normal=np.ascontiguousarray(p.normal, np.float32),
        color=np.ascontiguousarray(p.color),
        footprint=p.footprint.astype(np.float32),
    )
    counts = [len(patch.triangles) for patch in planes]
    frames = [np.stack([q.step * q.across, q.step * q.down, q.origin], axis=1) for q in planes]
    return Packed(
        points=points,
        origin=origin,
        plane_of=np.repeat(np.arange(len(counts)), counts),
        frames=np.stack(frames) if frames else np.zeros((0, 3, 3)),
        occluders=Occluders.of(planes),
        diagonal=walkthrough.diagonal,
    )
