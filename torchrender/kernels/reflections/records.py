"""What :func:`~torchrender.kernels.reflections.gather.gather` takes and fills."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class KeyFrame(NamedTuple):
    """The pictures of a key frame."""

    surface: np.ndarray  # (H,W,8) float32
    ids: np.ndarray  # (H,W) int32 reflector, -1 elsewhere
    reached: np.ndarray  # (H,W,4) float32 reflected point and 1, or direction and 0
    span: np.ndarray  # (H,W) float32 distance
    colors: np.ndarray  # (H,W,3) float32
    breaks: np.ndarray  # (H,W) uint8
    source: np.ndarray  # (H,W,2) float32 of the moved reflections; see ``resolve_moved``
    certainty: np.ndarray  # (H,W) uint8


class KeyView(NamedTuple):
    """The key frame's camera."""

    eye: np.ndarray  # (3,)
    matrix: np.ndarray  # (3,3) pixel from world
    near: float


class Pixels(NamedTuple):
    """N pixels of a new view."""

    place: np.ndarray  # (N,2) float64 position (u, v) of their surface point in the key frame, or (0,2): its projection
    ids: np.ndarray  # (N,) int32 reflector
    tolerance: np.ndarray  # (N,) float64 of depth
    weight: np.ndarray  # (N,) float32 share of the reflection in the pixel's colour
    position: np.ndarray  # (N,3) float64
    direction: np.ndarray  # (N,3) float64 of the reflected ray, unit


class Limits(NamedTuple):
    """What a position in the key frame must keep."""

    correction: float  # largest, key pixels; 0: none is made
    contrast: float  # largest difference in the pixel's colour among the key pixels that it is interpolated from


class Gathered(NamedTuple):
    """What N pixels mirror."""

    color: np.ndarray  # (N,3) float32
    distance: np.ndarray  # (N,) float32
    source: np.ndarray  # (N,2) float32 key positions
    state: np.ndarray  # (N,) uint8
