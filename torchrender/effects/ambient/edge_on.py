"""Walls that an eye sees edge-on: they are in no depth image of that eye, and still hide light from what it sees."""

from __future__ import annotations

from weakref import ReferenceType, WeakKeyDictionary, ref

import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

LARGE = 0.05
"""Side of a square of a triangle's area, in diagonals of the scene, from which on it hides a share that shows."""
THIN = 2e-3
"""An eye this near to a plane, in its distance from the triangle, sees no more of it than a line."""

_PLANES: WeakKeyDictionary[Geometry, tuple[Tensor, Tensor]] = WeakKeyDictionary()
_ANSWERS: WeakKeyDictionary[Cameras, tuple[ReferenceType[Geometry], Tensor]] = WeakKeyDictionary()


def sees_edge_on(geometry: Geometry, cameras: Cameras) -> Tensor:
    """(B,) bool: the camera's eye lies in the plane of a large triangle. A plan asks many times: answers are kept."""
    about, answer = _ANSWERS.get(cameras, (None, None))
    if answer is None or about is None or about() is not geometry:
        answer = _find(geometry, cameras)
        _ANSWERS[cameras] = ref(geometry), answer
    return answer


def _find(geometry: Geometry, cameras: Cameras) -> Tensor:
    normals, centres = _planes(geometry)
    to_eye = cameras.eye[:, None] - centres
    across = (to_eye * normals).sum(dim=-1).abs()
    return (across < THIN * to_eye.norm(dim=-1)).any(dim=1)


def _planes(geometry: Geometry) -> tuple[Tensor, Tensor]:
    """Unit normals and centres (N,3) of the large triangles; found once."""
    if geometry not in _PLANES:
        low, high = geometry.bounds
        a, b, c = (geometry.vertices[geometry.faces[:, k].long()] for k in range(3))
        cross = torch.linalg.cross(b - a, c - a)
        double = cross.norm(dim=-1)
        large = double > 2.0 * (LARGE * float((high - low).norm())) ** 2
        _PLANES[geometry] = cross[large] / double[large, None], ((a + b + c) / 3.0)[large]
    return _PLANES[geometry]
