"""Rotations as quaternions x, y, z, w, and as matrices, float64."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]


def normalised(quaternions: Array) -> Array:
    """Unit quaternions (...,4); zero, which is none, means no rotation."""
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    unit: Array = np.where(usable, quaternions / np.where(usable, length, 1.0), [0.0, 0.0, 0.0, 1.0])
    return unit


def rotations(quaternions: Array) -> Array:
    """(N,3,3) of quaternions (N,4) x, y, z, w of any length."""
    x, y, z, w = normalised(quaternions).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
