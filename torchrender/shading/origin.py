"""Where float32 positions are counted from, so that they keep their digits near what is seen."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.buffers import RaySurface, VisibilityBuffer
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.shading.attributes import eye_of

_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()
LOOKED_AT = 4096
"""Vertices that the middle of a geometry is found from."""


def origin_of(scene: Scene, samples: VisibilityBuffer | RaySurface, k: int = 0) -> Tensor:
    """(3,) float64 in world space.

    A perspective camera ``k`` is there itself: what is near it must not suffer from a backdrop far away. An eye outside
    the scene's box counts as being at its side. Else it is the middle of the scene's vertices: the same for all rays
    of a picture, and a large ground with a few corners does not move it.
    """
    if isinstance(samples, RaySurface) or samples.cameras.orthographic:
        return middle(scene.geometry)
    bounds, eye = scene.bounds, torch.from_numpy(eye_of(samples.cameras, k).origin)
    return torch.minimum(torch.maximum(eye, bounds[0]), bounds[1])


def middle(geometry: Geometry) -> Tensor:
    """(3,) float64 median of the vertices."""
    known = _KEPT.get(geometry)
    if known is None:
        some = geometry.vertices[:: max(len(geometry.vertices) // LOOKED_AT, 1)]
        known = some.median(0).values if len(some) else torch.zeros(3, dtype=torch.float64)
        _KEPT[geometry] = known
    made: Tensor = known
    return made
